"""Reading scans into metres with z up, and refusing what cannot be the scan of a cave."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.cave.options import ScanOptions
from aquanav_tools.cave.scan.files import read_surface
from aquanav_tools.cave.scan.plausibility import METRES_PER_UNIT, check_size, upright_cautions
from aquanav_tools.cave.scan.thinning import MAX_POINTS, EvenThinner, thinned_caution
from aquanav_tools.cave.scan.wall_samples import sample_wall
from aquanav_tools.errors import InputError
from aquanav_tools.types import Array, Mesh, PointCloud

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


def read_scan(path: Path, options: ScanOptions) -> Scan:
    """Return the surface in a file.

    Raises:
        InputError: the file is missing, of no known format, damaged, empty, has coordinates that are not finite, or a
            size that no cave has.
        ResourceError: it has more than MAX_LOADED points.
    """
    if not path.is_file():
        raise InputError(f"There is no file {path}. Check the path.")
    surface, cautions = read_surface(path)
    points = surface.vertices if isinstance(surface, Mesh) else surface.points
    _check_points(points, path)
    wall = sample_wall(surface)
    check_size(surface, wall, options.unit)
    cautions += upright_cautions(surface, wall, options, path)
    if isinstance(surface, PointCloud) and len(points) > MAX_POINTS:
        surface, thinned = _thinned(surface, path.name)
        cautions += thinned
        points = surface.points
    rotation = _world_from_file(options.up)
    moved = METRES_PER_UNIT[options.unit or "m"] * points @ rotation.T
    centre = np.round(moved.mean(axis=0))
    offset = centre if np.abs(centre).max() > FAR_FROM_ORIGIN else np.zeros(3)
    if isinstance(surface, Mesh):
        return Scan(Mesh(moved - offset, surface.faces, surface.colours), offset, cautions)
    normals = None if surface.normals is None else surface.normals @ rotation.T
    return Scan(PointCloud(moved - offset, normals, surface.colours), offset, cautions)


def _thinned(cloud: PointCloud, name: str) -> tuple[PointCloud, tuple[tuple[str, str], ...]]:
    """Return an even choice of a large cloud's points, and the caution that says so."""
    thinner = EvenThinner()
    thinner.add(np.column_stack([cloud.points, np.arange(len(cloud.points))]))
    kept = thinner.result()[:, 3].astype(np.int64)
    normals = None if cloud.normals is None else cloud.normals[kept]
    colours = None if cloud.colours is None else cloud.colours[kept]
    return PointCloud(cloud.points[kept], normals, colours), thinned_caution(name, thinner, len(kept))


def _check_points(points: Array, path: Path) -> None:
    if len(points) < 4:
        raise InputError(f"{path} has {len(points)} points; a surface needs at least 4. The file is empty or cut off.")
    bad = ~np.isfinite(points).all(axis=1)
    if bad.any():
        raise InputError(
            f"{path} has {bad.sum()} of {len(points)} points with coordinates that are not finite, the first at index "
            f"{np.flatnonzero(bad)[0]}. The export went wrong; export it again or remove those points."
        )


def _world_from_file(up: str) -> Array:
    """Return the rotation that takes the file's up axis to z by a cyclic permutation (and a half turn for '-')."""
    axis = "xyz".index(up[-1])
    rotation = np.eye(3)[[(axis + 1) % 3, (axis + 2) % 3, axis]]
    if up.startswith("-"):
        rotation = np.diag([1.0, -1.0, -1.0]) @ rotation
    return rotation
