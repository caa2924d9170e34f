"""Reading the files that scans come in: any mesh that trimesh reads, and point clouds (PLY, XYZ, LAS)."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.scan.foreign import told_instead
from aquanav_tools.cave.scan.thinning import EvenThinner, thinned_caution
from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.types import Array, Mesh, PointCloud

TABLE_SUFFIXES = (".xyz", ".txt", ".csv", ".pts", ".asc")
LAS_SUFFIXES = (".las", ".laz")
LAS_CHUNK = 1_000_000
COLOUR_NAMES = ("red", "green", "blue")
NORMAL_NAMES = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"), ("normalx", "normaly", "normalz"))
MAX_LOADED = 20_000_000
"""More points than this take over 4 GB; LAS files are thinned while they are read, other formats are refused before."""


def read_surface(path: Path) -> tuple[Mesh | PointCloud, tuple[tuple[str, str], ...]]:
    """Return the surface in a file, in the file's own coordinates, and cautions (codes and sentences).

    Raises:
        InputError: the file is of no known format, or damaged.
        ResourceError: it has too many points.
    """
    suffix = path.suffix.lower()
    if suffix in TABLE_SUFFIXES:
        return _read_table(path), ()
    if suffix in LAS_SUFFIXES:
        return _read_las(path)
    import trimesh

    known = {f".{name}" for name in trimesh.available_formats()}
    if suffix not in known:
        raise InputError(told_instead(path, known | {*TABLE_SUFFIXES, *LAS_SUFFIXES}))
    _check_announced(path, suffix)
    try:
        loaded = trimesh.load(path, process=False)
        if isinstance(loaded, trimesh.Scene):
            loaded = loaded.to_mesh()
    except Exception as cause:  # whatever a damaged file makes one of the many parsers raise
        raise InputError(
            f"{path} cannot be read as '{suffix}': {cause}. The file is damaged or of another format."
        ) from cause
    vertices = np.array(loaded.vertices, dtype=np.float64)
    faces = np.array(getattr(loaded, "faces", ()), dtype=np.int64)
    colours = _vertex_colours(loaded)
    if len(faces):
        return Mesh(vertices, faces, colours), ()
    return PointCloud(vertices, _ply_normals(loaded), colours), ()


def _vertex_colours(loaded: Any) -> npt.NDArray[np.uint8] | None:
    """Return the RGB of every vertex, sampled from the texture where there is one; None where nothing is defined."""
    visual: Any = getattr(loaded, "visual", None)
    if getattr(visual, "kind", None) == "texture":
        visual = visual.to_color()
    if getattr(visual, "kind", None) in ("vertex", "face"):
        colours = np.asarray(visual.vertex_colors, dtype=np.uint8)
    elif getattr(loaded, "colors", None) is not None and visual is None:
        colours = np.asarray(loaded.colors, dtype=np.uint8)
    else:
        return None
    return colours[:, :3].copy() if colours.shape == (len(loaded.vertices), 4) else None


def _check_announced(path: Path, suffix: str) -> None:
    """Refuse a file by the number of points its header announces, before it is loaded.

    Raises:
        ResourceError: more than MAX_LOADED.
    """
    announced = 0
    if suffix == ".ply":
        with path.open("rb") as stream:
            header = stream.read(4096).split(b"end_header")[0].split()
        counts = [word for before, word in pairwise(header) if before == b"vertex"]
        announced = int(counts[0]) if counts and counts[0].isdigit() else 0
    elif suffix == ".stl":
        # 50 bytes per triangle, more in ASCII; equal corners are merged, about half a vertex remains per triangle.
        announced = path.stat().st_size // 50 // 2
    if announced > MAX_LOADED:
        raise _too_many(path, announced)


def _too_many(path: Path, count: int) -> ResourceError:
    return ResourceError(
        f"{path} has about {count / 1e6:.0f} million points, more than the {MAX_LOADED / 1e6:.0f} million that fit "
        "into 4 GB. Thin it to one point per centimetre first, or save it as LAS, which is thinned while it is read."
    )


def _ply_normals(cloud: object) -> Array | None:
    """Return the normals of a PLY point cloud, which trimesh keeps only in its raw data."""
    raw = getattr(cloud, "metadata", {}).get("_ply_raw", {}).get("vertex", {}).get("data")
    names = getattr(getattr(raw, "dtype", None), "names", None) or tuple(raw or ())
    if not {"nx", "ny", "nz"} <= set(names):
        return None
    return _unit(np.stack([np.asarray(raw[axis], dtype=np.float64).ravel() for axis in ("nx", "ny", "nz")], axis=1))


def _read_table(path: Path) -> PointCloud:
    """Read rows of x y z, with nx ny nz after them when those are unit vectors; other columns are left out."""
    with path.open("rb") as stream:
        start = stream.read(65536)
    if not start.strip():
        raise InputError(f"{path} is empty: it has 0 points, and a surface needs at least 4. Export the scan again.")
    announced = path.stat().st_size * len(start.splitlines()) // max(len(start), 1)
    if announced > MAX_LOADED:
        raise _too_many(path, announced)
    try:
        with path.open(encoding="utf-8") as stream:
            delimiter = "," if "," in stream.readline() else None
        rows = np.loadtxt(path, delimiter=delimiter, ndmin=2, comments=("#", "//"))
    except (ValueError, UnicodeDecodeError) as cause:
        raise InputError(
            f"{path} is not a table of numbers 'x y z [nx ny nz]': {cause}. Correct the file there."
        ) from cause
    if rows.shape[1] < 3:
        raise InputError(f"{path} has {rows.shape[1]} columns; a point needs x y z. Export it again with coordinates.")
    has_normals = rows.shape[1] >= 6 and np.allclose(np.linalg.norm(rows[:, 3:6], axis=1), 1.0, atol=0.01)
    return PointCloud(rows[:, :3], _unit(rows[:, 3:6]) if has_normals else None)


def _read_las(path: Path) -> tuple[PointCloud, tuple[tuple[str, str], ...]]:
    """Read a LAS or LAZ file in chunks, and thin a large one meanwhile."""
    import laspy

    thinner = EvenThinner()
    try:
        with laspy.open(path) as reader:
            names = {name.lower(): name for name in reader.header.point_format.dimension_names}
            normals: tuple[str, ...] = next((keys for keys in NORMAL_NAMES if all(key in names for key in keys)), ())
            colours = tuple(key for key in COLOUR_NAMES if key in names)
            for chunk in reader.chunk_iterator(LAS_CHUNK):
                extras = [chunk[names[key]] for key in (*normals, *colours)]
                thinner.add(np.stack([chunk.x, chunk.y, chunk.z, *extras], axis=1).astype(np.float64))
    except Exception as cause:  # laspy raises its own and struct's errors on damaged files
        raise InputError(f"{path} cannot be read as LAS: {cause}. The file is damaged or of another format.") from cause
    if not thinner.num_seen:
        raise InputError(f"{path} has 0 points; a surface needs at least 4. The file is empty or cut off.")
    table = thinner.result()
    cloud = PointCloud(table[:, :3], _unit(table[:, 3:6]) if normals else None, _las_colours(table[:, -3:], colours))
    return cloud, thinned_caution(path.name, thinner, len(table))


def _las_colours(channels: Array, names: tuple[str, ...]) -> npt.NDArray[np.uint8] | None:
    """Return the (N, 3) RGB of three channels; LAS means 16 bits, many programs write 8."""
    if names != COLOUR_NAMES or not channels.any():
        return None
    return (channels // 256 if channels.max() > 255 else channels).astype(np.uint8)


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    return unit
