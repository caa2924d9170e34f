"""Reading the files that scans come in: meshes, models and point clouds, by the ending of their names."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from aquanav_tools.cave.scan import trimesh_files
from aquanav_tools.cave.scan.announced import check_announced
from aquanav_tools.cave.scan.e57 import read_e57
from aquanav_tools.cave.scan.fbx import read_fbx
from aquanav_tools.cave.scan.foreign import told_instead
from aquanav_tools.cave.scan.las import read_las
from aquanav_tools.cave.scan.models import LIBRARIES, read_model
from aquanav_tools.cave.scan.pcd import read_pcd
from aquanav_tools.cave.scan.surface_file import SurfaceFile
from aquanav_tools.cave.scan.tables import read_pts, read_ptx, read_table
from aquanav_tools.errors import InputError

Reader = Callable[[Path], SurfaceFile]


def read_surface(path: Path) -> SurfaceFile:
    """Return the surface in a file, in the file's own coordinates.

    Raises:
        InputError: the file is of no known format, or damaged.
        ResourceError: it has too many points.
        LibraryError: what reads it is not installed.
    """
    suffix = path.suffix.lower()
    if suffix not in READERS:
        raise InputError(told_instead(path, set(READERS)))
    return READERS[suffix](path)


def _read_mesh(path: Path) -> SurfaceFile:
    check_announced(path, path.suffix.lower())
    return SurfaceFile(trimesh_files.surface_of(path, trimesh_files.load(path)))


def _read_las(path: Path) -> SurfaceFile:
    return SurfaceFile(*read_las(path))


READERS: dict[str, Reader] = {
    # Of what trimesh reads, what scanners and their programs write; archives, for one, unpack to any size.
    **dict.fromkeys((".ply", ".obj", ".stl", ".off", ".glb", ".gltf"), _read_mesh),
    **dict.fromkeys(LIBRARIES, read_model),
    **dict.fromkeys((".xyz", ".txt", ".csv", ".asc"), read_table),
    **dict.fromkeys((".las", ".laz"), _read_las),
    ".e57": read_e57,
    ".fbx": read_fbx,
    ".pcd": read_pcd,
    ".pts": read_pts,
    ".ptx": read_ptx,
}
"""By the ending of a file's name."""
