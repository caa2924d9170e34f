"""Reading the files that scans come in: meshes (PLY, OBJ, STL, OFF, glTF) and point clouds (PLY, XYZ, LAS, LAZ)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.scan.announced import check_announced, check_count
from aquanav_tools.cave.scan.foreign import told_instead
from aquanav_tools.cave.scan.las import read_las
from aquanav_tools.errors import AquanavError, InputError
from aquanav_tools.text_files import check_utf8
from aquanav_tools.types import Array, Mesh, PointCloud

TABLE_SUFFIXES = (".xyz", ".txt", ".csv", ".pts", ".asc")
LAS_SUFFIXES = (".las", ".laz")
MESH_SUFFIXES = (".ply", ".obj", ".stl", ".off", ".glb", ".gltf")
"""Of what trimesh reads, what scanners and their programs write; archives, for one, unpack to any size."""


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
        return read_las(path)
    if suffix not in MESH_SUFFIXES:
        raise InputError(told_instead(path, {*MESH_SUFFIXES, *TABLE_SUFFIXES, *LAS_SUFFIXES}))
    check_announced(path, suffix)
    loaded = _loaded(path, suffix)
    vertices = np.array(loaded.vertices, dtype=np.float64)
    faces = np.array(getattr(loaded, "faces", ()), dtype=np.int64)
    colours = _vertex_colours(loaded)
    if len(faces):
        return Mesh(vertices, faces, colours), ()
    return PointCloud(vertices, _ply_normals(loaded), colours), ()


def _loaded(path: Path, suffix: str) -> Any:
    """Return what trimesh makes of a file: a mesh or a cloud.

    Raises:
        InputError: it is damaged.
        ResourceError: it places its meshes so often that they have too many points together.
    """
    import trimesh

    try:
        loaded: Any = trimesh.load(path, process=False)
        if not isinstance(loaded, trimesh.Scene):
            return loaded
        copies = [loaded.geometry[loaded.graph[node][1]] for node in loaded.graph.nodes_geometry]
        check_count(path, sum(len(each.vertices) for each in copies))
        return loaded.to_mesh()
    except AquanavError:
        raise
    except Exception as cause:  # whatever a damaged file makes one of the many parsers raise
        raise InputError(
            f"{path} cannot be read as '{suffix}': {cause}. The file is damaged or of another format."
        ) from cause


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
    check_count(path, path.stat().st_size * len(start.splitlines()) // len(start))
    check_utf8(path)
    delimiter = "," if b"," in start.splitlines()[0] else None
    try:
        rows = np.loadtxt(path, delimiter=delimiter, ndmin=2, comments=("#", "//"), encoding="utf-8")
    except ValueError as cause:
        raise InputError(
            f"{path} is not a table of numbers 'x y z [nx ny nz]': {cause}. Correct the file there."
        ) from cause
    if rows.shape[1] < 3:
        raise InputError(f"{path} has {rows.shape[1]} columns; a point needs x y z. Export it again with coordinates.")
    has_normals = rows.shape[1] >= 6 and np.allclose(np.linalg.norm(rows[:, 3:6], axis=1), 1.0, atol=0.01)
    return PointCloud(rows[:, :3], _unit(rows[:, 3:6]) if has_normals else None)


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    return unit
