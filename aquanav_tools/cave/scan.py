"""Reading scans: any mesh that trimesh reads, and point clouds (PLY, XYZ, LAS), into metres with z up."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.cave.options import ScanOptions
from aquanav_tools.errors import InputError, ResourceError, did_you_mean
from aquanav_tools.types import Array, Mesh, PointCloud

METRES_PER_UNIT = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "km": 1000.0, "ft": 0.3048, "in": 0.0254}
TABLE_SUFFIXES = (".xyz", ".txt", ".csv", ".pts", ".asc")
LAS_SUFFIXES = (".las", ".laz")
MAX_POINTS = 100_000_000
FAR_FROM_ORIGIN = 1000.0
"""Beyond this, float32 coordinates are coarser than 0.1 mm and the scan is moved to the origin, m."""


@dataclass(frozen=True, eq=False)
class Scan:
    """A scan in the world frame: metres, z up."""

    surface: Mesh | PointCloud
    offset: Array
    """(3,) what was subtracted to bring a far scan to the origin, world axes, m; zeros for most."""


def read_scan(path: Path, options: ScanOptions) -> Scan:
    """Return the surface in a file.

    Raises:
        InputError: the file is missing, of no known format, damaged, empty, or has coordinates that are not finite.
        ResourceError: it has more than MAX_POINTS points.
    """
    if not path.is_file():
        raise InputError(f"There is no file {path}. Check the path.")
    surface = _read_surface(path)
    points = surface.vertices if isinstance(surface, Mesh) else surface.points
    _check_points(points, path)
    rotation = _world_from_file(options.up)
    moved = METRES_PER_UNIT[options.unit] * points @ rotation.T
    centre = np.round(moved.mean(axis=0))
    offset = centre if np.abs(centre).max() > FAR_FROM_ORIGIN else np.zeros(3)
    if isinstance(surface, Mesh):
        return Scan(Mesh(moved - offset, surface.faces), offset)
    normals = None if surface.normals is None else surface.normals @ rotation.T
    return Scan(PointCloud(moved - offset, normals, surface.colours), offset)


def _read_surface(path: Path) -> Mesh | PointCloud:
    suffix = path.suffix.lower()
    if suffix in TABLE_SUFFIXES:
        return _read_table(path)
    if suffix in LAS_SUFFIXES:
        return _read_las(path)
    import trimesh

    known = {f".{name}" for name in trimesh.available_formats()}
    if suffix not in known:
        every = known | {*TABLE_SUFFIXES, *LAS_SUFFIXES}
        raise InputError(f"{path.name} has no known scan format ('{suffix}').{did_you_mean(suffix, every)}")
    try:
        loaded = trimesh.load(path, process=False)
        if isinstance(loaded, trimesh.Scene):
            loaded = loaded.to_mesh()
    except Exception as cause:  # whatever a damaged file makes one of the many parsers raise
        raise InputError(
            f"{path} cannot be read as '{suffix}': {cause}. The file is damaged or of another format."
        ) from cause
    faces = np.array(getattr(loaded, "faces", ()), dtype=np.int64)
    if len(faces):
        return Mesh(np.array(loaded.vertices, dtype=np.float64), faces)
    return PointCloud(np.array(loaded.vertices, dtype=np.float64), _ply_normals(loaded))


def _ply_normals(cloud: object) -> Array | None:
    """Return the normals of a PLY point cloud, which trimesh keeps only in its raw data."""
    raw = getattr(cloud, "metadata", {}).get("_ply_raw", {}).get("vertex", {}).get("data")
    names = getattr(getattr(raw, "dtype", None), "names", None) or tuple(raw or ())
    if not {"nx", "ny", "nz"} <= set(names):
        return None
    return _unit(np.stack([np.asarray(raw[axis], dtype=np.float64).ravel() for axis in ("nx", "ny", "nz")], axis=1))


def _read_table(path: Path) -> PointCloud:
    """Read rows of x y z, with nx ny nz after them when those are unit vectors; other columns are left out."""
    try:
        with path.open(encoding="utf-8") as stream:
            delimiter = "," if "," in stream.readline() else None
        rows = np.loadtxt(path, delimiter=delimiter, ndmin=2, comments=("#", "//"), max_rows=MAX_POINTS + 1)
    except (ValueError, UnicodeDecodeError) as cause:
        raise InputError(
            f"{path} is not a table of numbers 'x y z [nx ny nz]': {cause}. Correct the file there."
        ) from cause
    if rows.shape[1] < 3:
        raise InputError(f"{path} has {rows.shape[1]} columns; a point needs x y z. Export it again with coordinates.")
    has_normals = rows.shape[1] >= 6 and np.allclose(np.linalg.norm(rows[:, 3:6], axis=1), 1.0, atol=0.01)
    return PointCloud(rows[:, :3], _unit(rows[:, 3:6]) if has_normals else None)


def _read_las(path: Path) -> PointCloud:
    import laspy

    try:
        las = laspy.read(path)
    except Exception as cause:  # laspy raises its own and struct's errors on damaged files
        raise InputError(f"{path} cannot be read as LAS: {cause}. The file is damaged or of another format.") from cause
    names = {name.lower(): name for name in las.point_format.dimension_names}
    for keys in (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"), ("normalx", "normaly", "normalz")):
        if all(key in names for key in keys):
            normals = np.stack([np.asarray(las[names[key]], dtype=np.float64) for key in keys], axis=1)
            return PointCloud(np.array(las.xyz), _unit(normals))
    return PointCloud(np.array(las.xyz))


def _check_points(points: Array, path: Path) -> None:
    if len(points) > MAX_POINTS:
        raise ResourceError(f"{path} has {len(points)} points, more than {MAX_POINTS}. Thin the scan first.")
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


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    return unit
