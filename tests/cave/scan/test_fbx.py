"""Reading binary FBX: triangles, transforms and axes; and what is refused."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.cave.options import ScanOptions
from aquanav_tools.cave.scan.fbx import MAX_ARRAY_BYTES, read_fbx, triangulate
from aquanav_tools.cave.scan.read import read_scan, world_from_file
from aquanav_tools.errors import InputError
from aquanav_tools.synthetic.caves import tube
from aquanav_tools.types import Mesh
from tests.build.original.files import MAGIC, write_fbx

CORNERS = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [0.0, 2.0, 0.0], [0.0, 0.0, 1.0]])
FACES = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
TETRAHEDRON = Mesh(CORNERS, FACES)
Z_UP = {"UpAxis": 2}


def upright(path: Path) -> Mesh:
    """Return the mesh in a file in metres, z up, as the file says its frame is."""
    read = read_fbx(path)
    assert isinstance(read.surface, Mesh)
    assert read.metres_per_unit is not None
    assert read.up is not None
    vertices = read.metres_per_unit * read.surface.vertices @ world_from_file(read.up).T
    return Mesh(vertices, read.surface.faces)


def test_a_cave_is_read_in_the_files_own_frame_and_flags_win(tmp_path: Path) -> None:
    cave = tube(1.0, 8.0).mesh  # along x; volume pi r^2 l, by its lids
    y_up = Mesh(100.0 * cave.vertices[:, [1, 2, 0]], cave.faces)
    write_fbx(tmp_path / "cave.fbx", y_up)
    scan = read_scan(tmp_path / "cave.fbx", ScanOptions())
    np.testing.assert_allclose(scan.points, cave.vertices, atol=1e-9)
    halved = read_scan(tmp_path / "cave.fbx", ScanOptions(unit="mm", up="z"))
    np.testing.assert_allclose(halved.points, 0.1 * cave.vertices[:, [1, 2, 0]], atol=1e-9)


@pytest.mark.parametrize("version", [7100, 7400, 7500, 7700])
@pytest.mark.parametrize("is_packed", [False, True])
def test_corners_and_faces_come_back_in_metres(version: int, is_packed: bool, tmp_path: Path) -> None:
    write_fbx(tmp_path / "a.fbx", TETRAHEDRON, version, is_packed, Z_UP)
    mesh = upright(tmp_path / "a.fbx")
    np.testing.assert_allclose(mesh.vertices, 0.01 * CORNERS, atol=1e-15)  # the unit is the centimetre
    np.testing.assert_array_equal(mesh.faces, FACES)


@pytest.mark.parametrize(("axis", "sign"), [(0, 1), (1, 1), (2, 1), (0, -1), (1, -1), (2, -1)])
def test_the_files_up_axis_becomes_z_and_nothing_is_mirrored(axis: int, sign: int, tmp_path: Path) -> None:
    write_fbx(tmp_path / "a.fbx", TETRAHEDRON, globals_={"UpAxis": axis, "UpAxisSign": sign, "UnitScaleFactor": 100.0})
    mesh = upright(tmp_path / "a.fbx")
    np.testing.assert_allclose(mesh.vertices[:, 2], sign * CORNERS[:, axis], atol=1e-12)
    assert mesh.volume == pytest.approx(1.0, rel=1e-12)  # 3 * 2 * 1 / 6


def test_models_scale_turn_and_move_their_mesh(tmp_path: Path) -> None:
    model = {"Lcl Scaling": [100.0, 200.0, 300.0], "Lcl Rotation": [0.0, 0.0, 90.0], "Lcl Translation": [7.0, 0.0, 0.0]}
    write_fbx(tmp_path / "a.fbx", TETRAHEDRON, globals_=Z_UP, model=model)
    x, y, z = CORNERS.T
    expected = np.stack([-2.0 * y + 0.07, x, 3.0 * z], axis=1)
    np.testing.assert_allclose(upright(tmp_path / "a.fbx").vertices, expected, atol=1e-12)


def test_polygons_become_fans_of_triangles() -> None:
    triangles = triangulate(np.array([4, 5, 6, -8, 1, 2, -4, 0, -2]))  # a square, a triangle, and an edge
    np.testing.assert_array_equal(triangles, [[4, 5, 6], [4, 6, 7], [1, 2, 3]])


def test_a_file_cut_off_anywhere_is_refused(tmp_path: Path) -> None:
    write_fbx(tmp_path / "a.fbx", TETRAHEDRON)
    content = (tmp_path / "a.fbx").read_bytes()
    for length in range(0, len(content) - 200, 37):
        (tmp_path / "cut.fbx").write_bytes(content[:length])
        with pytest.raises(InputError, match=r"cut\.fbx"):
            read_fbx(tmp_path / "cut.fbx")


@pytest.mark.parametrize(
    ("content", "advice"),
    [
        (b"; FBX 7.4.0 project file", "Text FBX is not read"),
        (b"version https://git-lfs.github.com/spec/v1\noid sha256:ab", "git lfs pull"),
        (MAGIC + struct.pack("<I", 6100) + bytes(40), "version 6100; 7000 to 7999 are read"),
        (MAGIC + struct.pack("<I", 7400) + bytes(40), "holds no mesh"),
    ],
)
def test_other_files_are_refused_with_advice(content: bytes, advice: str, tmp_path: Path) -> None:
    (tmp_path / "a.fbx").write_bytes(content)
    with pytest.raises(InputError, match=advice):
        read_fbx(tmp_path / "a.fbx")


def test_faces_with_corners_that_are_not_there_are_refused(tmp_path: Path) -> None:
    write_fbx(tmp_path / "a.fbx", Mesh(CORNERS[:3], FACES))
    with pytest.raises(InputError, match="faces with corners that it has not"):
        read_fbx(tmp_path / "a.fbx")


def test_an_array_that_promises_too_much_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    write_fbx(tmp_path / "a.fbx", TETRAHEDRON)
    content = (tmp_path / "a.fbx").read_bytes()
    promise = struct.pack("<I", len(CORNERS) * 3)
    place = content.index(b"d" + promise) + 1
    (tmp_path / "a.fbx").write_bytes(content[:place] + struct.pack("<I", MAX_ARRAY_BYTES) + content[place + 4 :])
    with pytest.raises(InputError, match="does not fit its record"):
        read_fbx(tmp_path / "a.fbx")
