"""Reading scans into metres with z up, and refusing what cannot be the scan of a cave."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.cave.options import ScanOptions
from aquanav_tools.cave.scan.files import read_surface
from aquanav_tools.cave.scan.plausibility import METRES_PER_UNIT, check_size, upright_cautions
from aquanav_tools.cave.scan.stations import enclosed_stations
from aquanav_tools.cave.scan.thinning import MAX_POINTS, EvenThinner, thinned_caution
from aquanav_tools.cave.scan.wall_samples import sample_wall
from aquanav_tools.errors import InputError
from aquanav_tools.types import Array, IntArray, Mesh, PointCloud, Sim3

FAR_FROM_ORIGIN = 1000.0
"""Beyond this, float32 coordinates are coarser than 0.1 mm and the scan is moved to the origin, m."""


@dataclass(frozen=True, eq=False)
class Scan:
    """A scan in the world frame: metres, z up."""

    surface: Mesh | PointCloud
    offset: Array
    """(3,) what was subtracted to bring a far scan to the origin, world axes, m; zeros for most."""
    cautions: tuple[tuple[str, str], ...] = ()
    """Codes and sentences about what was changed while reading."""
    stations: Array = field(default_factory=lambda: np.zeros((0, 3)))
    """(K, 3) where scanners stood inside the cave, m; none where the files do not tell."""

    @property
    def points(self) -> Array:
        """(N, 3) vertices of its triangles, or its points where it has none, m."""
        return self.surface.vertices if isinstance(self.surface, Mesh) else self.surface.points

    @property
    def faces(self) -> IntArray | None:
        """(F, 3) vertex indices; None for a cloud of points."""
        return self.surface.faces if isinstance(self.surface, Mesh) else None

    @property
    def normals(self) -> Array | None:
        """(N, 3) of a cloud's points, None where unknown and for triangles."""
        return None if isinstance(self.surface, Mesh) else self.surface.normals


def read_scan(path: Path, options: ScanOptions, further: Sequence[Path] = ()) -> Scan:
    """Return the surface in a file, or in several of one cave together.

    Args:
        path: of the file.
        options: of all files; what they do not say is taken from each file, or its format.
        further: more files of the same cave, in the same coordinates; all have triangles, or all have points.

    Raises:
        InputError: a file is missing, of no known format, damaged, empty, has coordinates that are not finite, or a
            size that no cave has; or some have triangles and some points.
        ResourceError: one has more than MAX_LOADED points.
        LibraryError: what reads one is not installed.
    """
    parts, cautions = [], []
    for one in (path, *further):
        part, told = _read_part(one, options)
        parts.append(part)
        cautions += [caution for caution in told if caution not in cautions]
    surface = join_surfaces(parts, (path, *further))
    if isinstance(surface, PointCloud) and len(surface.points) > MAX_POINTS:
        surface, thinned = _thinned(surface, path.name if not further else f"The {len(parts)} files")
        cautions += thinned
    points = surface.vertices if isinstance(surface, Mesh) else surface.points
    centre = np.round(points.mean(axis=0))
    offset = centre if np.abs(centre).max() > FAR_FROM_ORIGIN else np.zeros(3)
    if isinstance(surface, Mesh):
        return Scan(Mesh(points - offset, surface.faces, surface.colours), offset, tuple(cautions))
    cloud = surface.moved(Sim3(1.0, np.eye(3), -offset))
    return Scan(cloud, offset, tuple(cautions), enclosed_stations(cloud))


def _read_part(path: Path, options: ScanOptions) -> tuple[Mesh | PointCloud, tuple[tuple[str, str], ...]]:
    """Return the surface in one file in metres with z up, and cautions; errors as in `read_scan`."""
    if path.is_dir():
        raise InputError(f"{path} is a folder. Name the scans in it, one after the other.")
    if not path.is_file():
        raise InputError(f"There is no file {path}. Check the path.")
    read = read_surface(path)
    surface = read.surface
    points = surface.vertices if isinstance(surface, Mesh) else surface.points
    _check_points(points, path)
    wall = sample_wall(surface)
    check_size(surface, wall, options.unit, read.metres_per_unit)
    cautions = read.cautions + upright_cautions(surface, wall, options, path, read.up)
    scale = METRES_PER_UNIT[options.unit] if options.unit else read.metres_per_unit or 1.0
    placement = Sim3(scale, world_from_file(options.up or read.up or "z"), np.zeros(3))
    if isinstance(surface, Mesh):
        return Mesh(placement.apply(points), surface.faces, surface.colours), cautions
    return surface.moved(placement), cautions


def join_surfaces(parts: Sequence[Mesh | PointCloud], paths: Sequence[Path]) -> Mesh | PointCloud:
    """Return one surface of several in the same coordinates; what not all of them have, as normals, is left out.

    Raises:
        InputError: some are triangles and some points.
    """
    if len(parts) == 1:
        return parts[0]
    meshes = [part for part in parts if isinstance(part, Mesh)]
    clouds = [part for part in parts if isinstance(part, PointCloud)]
    if meshes and clouds:
        mesh, cloud = (next(n for n, part in enumerate(parts) if isinstance(part, kind)) for kind in (Mesh, PointCloud))
        raise InputError(
            f"{paths[mesh].name} has triangles and {paths[cloud].name} points alone; several scans of one cave are all "
            "meshes or all point clouds. Give those of one kind."
        )
    if meshes:
        begins = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        faces = [mesh.faces + begin for mesh, begin in zip(meshes, begins[:-1], strict=True)]
        vertices = np.concatenate([mesh.vertices for mesh in meshes])
        return Mesh(vertices, np.concatenate(faces), _joined([mesh.colours for mesh in meshes]))
    seen_from = None
    if any(cloud.seen_from is not None for cloud in clouds):
        rows = [np.full(cloud.points.shape, np.nan) if cloud.seen_from is None else cloud.seen_from for cloud in clouds]
        seen_from = np.concatenate(rows)
    return PointCloud(
        np.concatenate([cloud.points for cloud in clouds]),
        _joined([cloud.normals for cloud in clouds]),
        _joined([cloud.colours for cloud in clouds]),
        seen_from=seen_from,
    )


def _joined(parts: Sequence[Any]) -> Any:
    return None if any(part is None for part in parts) else np.concatenate(parts)


def _thinned(cloud: PointCloud, name: str) -> tuple[PointCloud, tuple[tuple[str, str], ...]]:
    """Return an even choice of a large cloud's points, and the caution that says so."""
    thinner = EvenThinner()
    thinner.add(np.column_stack([cloud.points, np.arange(len(cloud.points))]))
    kept = thinner.result()[:, 3].astype(np.int64)
    normals = None if cloud.normals is None else cloud.normals[kept]
    colours = None if cloud.colours is None else cloud.colours[kept]
    seen_from = None if cloud.seen_from is None else cloud.seen_from[kept]
    thin = PointCloud(cloud.points[kept], normals, colours, seen_from=seen_from)
    return thin, thinned_caution(name, thinner, len(kept))


def _check_points(points: Array, path: Path) -> None:
    if len(points) < 4:
        raise InputError(f"{path} has {len(points)} points; a surface needs at least 4. The file is empty or cut off.")
    bad = ~np.isfinite(points).all(axis=1)
    if bad.any():
        raise InputError(
            f"{path} has {bad.sum()} of {len(points)} points with coordinates that are not finite, the first at index "
            f"{np.flatnonzero(bad)[0]}. The export went wrong; export it again or remove those points."
        )


def world_from_file(up: str) -> Array:
    """Return the rotation that takes the file's up axis to z by a cyclic permutation (and a half turn for '-')."""
    axis = "xyz".index(up[-1])
    rotation = np.eye(3)[[(axis + 1) % 3, (axis + 2) % 3, axis]]
    if up.startswith("-"):
        rotation = np.diag([1.0, -1.0, -1.0]) @ rotation
    return rotation
