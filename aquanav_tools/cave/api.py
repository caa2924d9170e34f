"""The functions of `aquanav_tools.cave`: from a scan to a closed mesh, and what is measured in it.

Frame of all of them: metres, right-handed, z up.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.centreline.find import find_centreline
from aquanav_tools.cave.centreline.graph import CentrelineGraph
from aquanav_tools.cave.closing.free_space import FreeSpace
from aquanav_tools.cave.closing.portals import Cut
from aquanav_tools.cave.closing.reconstruct import ReconstructionOptions, close_scan
from aquanav_tools.cave.measure.sections import Section, cross_sections
from aquanav_tools.cave.options import ScanOptions
from aquanav_tools.cave.route.passability import measure_passability
from aquanav_tools.cave.scan import read
from aquanav_tools.cave.scan.cloud import surface_from_cloud
from aquanav_tools.cave.scan.read import Scan
from aquanav_tools.cave.scan.resolution import choose_resolution
from aquanav_tools.cave.scan.surface import surface_from_mesh
from aquanav_tools.errors import InputError
from aquanav_tools.geometry.volume.distance import choose_spacing, distance_field
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.store import write_whole
from aquanav_tools.types import Array, Mesh, PointCloud

NARROWEST = 0.35
"""Width of passages that must stay open where nobody says, m: a BlueROV2's hull."""
INTO = 1e-3
"""Sections at a portal are taken this far inside, m."""
SUFFIXES = (".glb", ".obj", ".off", ".ply", ".stl")
"""What `write` writes."""
Floats = npt.ArrayLike
"""Whatever NumPy makes an array of floats of."""


def read_scan(
    path: str | Path,
    *further: str | Path,
    unit: Literal["m", "dm", "cm", "mm", "km", "ft", "in"] | None = None,
    up: Literal["x", "y", "z", "-x", "-y", "-z"] | None = None,
) -> Scan:
    """Return the surface in a file, or in several of one cave together, in metres with z up.

    Its `points` are (N, 3); its `faces` (F, 3) vertex indices, or None for a cloud of points. What lies far from the
    origin, as in map coordinates, is moved there: `points + offset` are where the file has it.

    Args:
        path: A mesh (PLY, OBJ, STL, OFF, GLB, DAE, 3MF, USD) or a point cloud (PLY, LAS, LAZ, E57, PTX, PTS, PCD, XYZ).
        further: More files of the same cave, in the same coordinates.
        unit: Length unit of the files. When not given, what the file or its format says, else metres.
        up: Axis of the files that points up. When not given, what the file says, else z.

    Raises:
        InputError: a file is missing, damaged, of no known format, or of a size that no cave has.
        ResourceError: it has too many points.
        LibraryError: what reads it is not installed.
    """
    return read.read_scan(Path(path), ScanOptions(unit, up), [Path(one) for one in further])


def close(
    points: Floats,
    faces: npt.ArrayLike | None = None,
    *,
    normals: Floats | None = None,
    inside: Floats = (),
    cuts: Floats = (),
    narrowest: float = NARROWEST,
    voxel: float | None = None,
    memory: float = 4.0,
    accept_open: bool = False,
) -> Cavity:
    """Return the water that a scan encloses, proven to be closed, without crossing faces, and in one piece.

    Of what comes back, `mesh.vertices` (V, 3) and `mesh.faces` (F, 3) are the closed surface with normals out of the
    water, `volume` its m3, and `portals` its open ends (`centre` (3,), `normal` (3,) outwards, `area` in m2). Holes
    in the wall are filled. `labels` (F,) are 0 for wall and the portal's label for its lid; `observed` (F,) tells
    scanned from invented wall.

    Args:
        points: (N, 3) vertices of triangles, or points on the wall, m.
        faces: (F, 3) vertex indices, wound any way; None for a cloud of points.
        normals: (N, 3) of a cloud's points, where known; their signs are not believed.
        inside: (K, 3) places that are water, m: to choose one of two caves, or to keep a passage open.
        cuts: (C, 6) rows X Y Z NX NY NZ: planes that end the cave, through a point in the water, with the direction
            that is cut away.
        narrowest: Width of the narrowest passage that must stay open, m. Openings twice as wide are portals, cells are
            an eighth of it or larger.
        voxel: Size of the cells that a damaged surface is resampled with, m; chosen from the scan when not given.
        memory: GB that closing may take; the cells are enlarged until it does.
        accept_open: Go on where so little wall was scanned that it may be no cave.

    Raises:
        InputError: an array has another shape or holds what is not finite, or no triangle has an area.
        MeshError: no water is enclosed, two caves are, or a cut meets no water.
        ResourceError: the cells do not fit into the memory.
    """
    scan = _surface(points, faces, normals)
    width, known = _positive(narrowest, "narrowest"), _rows(inside, 3, "inside")
    planes = _rows(cuts, 6, "cuts")
    if not np.linalg.norm(planes[:, 3:], axis=1).all():
        raise InputError("A row of cuts has no direction: its last three numbers are all 0.")
    size = choose_resolution(scan, 0.5 * width, _positive(memory, "memory"), voxel).voxel
    if isinstance(scan, Mesh):
        surface = surface_from_mesh(scan, size, known)
    else:
        surface = surface_from_cloud(scan, size, known, accept_thick=accept_open)
    options = ReconstructionOptions(
        size,
        2.0 * width,
        keep_triangles=isinstance(scan, Mesh),
        cuts=tuple(Cut(plane[:3], plane[3:] / np.linalg.norm(plane[3:])) for plane in planes),
        accept_open=accept_open,
    )
    return close_scan(surface, options, FreeSpace(known)).cavity


def centreline(water: Cavity, *, narrowest: float = NARROWEST) -> CentrelineGraph:
    """Return the centreline of a cave as a graph of nodes and branches, from portals to dead ends.

    `branches` have `points` (K, 3) and `clearance` (K,), the distance to the nearest wall, in metres; `nodes` a
    `position` (3,) and a `kind`; `path(start, end)` is the way along it between two places, `length` all its metres.

    Args:
        water: From `close`.
        narrowest: Width of the narrowest passage of interest, m; samples lie a sixth of it apart, or wider in a cave so
            large that they would not fit into memory.

    Raises:
        MeshError: no water is wide enough for the samples.
        ResourceError: the cave is too large for any.
    """
    return find_centreline(water, _field(water, narrowest))


def sections(water: Cavity, line: Floats, spacing: float) -> tuple[Section, ...]:
    """Return the cross-sections at 0, `spacing`, 2 `spacing`, ... metres along a line through the water.

    Each has `left`, `right`, `up` and `down` (m, from the line to the first wall, looking along it), `area` (m2),
    `perimeter`, `arc_length` (m along the line), `centre` (3,), `normal` (3,) and `outline` (K, 2). Where the line
    leaves the water there is none; an end on a portal counts as a millimetre inside.

    Args:
        water: From `close`.
        line: (C, 3) points of it, for example of a branch of the centreline, m.
        spacing: Between stations, m.

    Raises:
        InputError: the line has fewer than two points, or the spacing is not positive.
    """
    points = _line(line)
    for portal in water.portals:  # on its lid the water has no section of its own
        offsets = points[[0, -1]] - portal.centre
        is_at = (np.abs(offsets @ portal.normal) < INTO) & (np.einsum("nk,nk->n", offsets, offsets) <= portal.area)
        points[[0, -1]] -= np.outer(is_at * INTO, portal.normal)
    return cross_sections(water, points, _positive(spacing, "spacing"))


def largest_vehicle(water: Cavity, line: Floats, *, narrowest: float = NARROWEST) -> float:
    """Return the diameter of the largest sphere that gets from a line's first point to its last, on any way, m.

    Args:
        water: From `close`.
        line: (C, 3) points of it, for example of a path along the centreline from portal to portal, m.
        narrowest: Width of the narrowest passage of interest, m; as of `centreline`.

    Raises:
        InputError: the line has fewer than two points.
        MeshError: no water joins its ends.
        ResourceError: the cave is too large for the samples.
    """
    return measure_passability(water, _field(water, narrowest), _line(line), narrowest).largest_vehicle


def write(water: Cavity | Mesh, path: str | Path) -> Path:
    """Return the file that a closed surface was written to, in metres with z up; it is there whole or not at all.

    Args:
        water: From `close`, or any triangles.
        path: Ends in .ply, .obj, .stl, .off or .glb. The folder must exist.

    Raises:
        InputError: there is no such folder, or the ending is another.
    """
    target = Path(path)
    if target.suffix.lower() not in SUFFIXES:
        raise InputError(f"'{target.name}' ends in none of {', '.join(SUFFIXES)}. Give another name.")
    if not target.parent.is_dir():
        raise InputError(f"There is no folder {target.parent}. Make it, or name another.")
    mesh = water.mesh if isinstance(water, Cavity) else water
    content: str | bytes = mesh.to_trimesh().export(file_type=target.suffix.lower()[1:])
    write_whole(target, content)
    return target


def _field(water: Cavity, narrowest: float) -> DistanceField:
    return distance_field(water.mesh, choose_spacing(water.mesh, 0.5 * _positive(narrowest, "narrowest")))


def _surface(points: Floats, faces: npt.ArrayLike | None, normals: Floats | None) -> Mesh | PointCloud:
    """Return arrays as a surface, checked."""
    places = _rows(points, 3, "points")
    if len(places) < 4:
        raise InputError(f"points has {len(places)} rows; a surface needs at least 4.")
    if faces is None:
        directions = None if normals is None else _rows(normals, 3, "normals")
        if directions is not None and len(directions) != len(places):
            raise InputError(f"There are {len(directions)} normals for {len(places)} points. Give one for each.")
        return PointCloud(places, directions)
    corners = np.asarray(faces)
    if corners.ndim != 2 or corners.shape[1] != 3 or not np.issubdtype(corners.dtype, np.integer):
        raise InputError(f"faces has shape {corners.shape} and type {corners.dtype}; it must be (F, 3) whole numbers.")
    if not len(corners) or corners.min() < 0 or corners.max() >= len(places):
        raise InputError(f"faces names other than the {len(places)} points from 0, or is empty. Check what it indexes.")
    return Mesh(places, corners.astype(np.int64))


def _rows(values: Floats, width: int, name: str) -> Array:
    """Return (N, `width`) floats; one row may come without its brackets, and no row as an empty list."""
    try:
        rows = np.atleast_2d(np.asarray(values, dtype=np.float64))
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} is no array of numbers: {error}. Give rows of {width}.") from error
    if rows.size == 0:
        return np.zeros((0, width))
    if rows.ndim != 2 or rows.shape[1] != width:
        raise InputError(f"{name} has shape {rows.shape}; it must be (N, {width}).")
    if not np.isfinite(rows).all():
        raise InputError(f"{name} holds {np.sum(~np.isfinite(rows))} numbers that are not finite. Remove those rows.")
    return rows


def _line(points: Floats) -> Array:
    """Return a copy of a line's (C, 3) points, checked."""
    line = _rows(points, 3, "line").copy()
    if len(line) < 2 or not np.ptp(line, axis=0).any():
        raise InputError(f"The line has {len(line)} points in one place. Give at least two that lie apart.")
    return line


def _positive(value: float, name: str) -> float:
    if not 0.0 < value < np.inf:
        raise InputError(f"{name} is {value}; it must be a positive number.")
    return float(value)
