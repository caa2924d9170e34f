from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from aquanav_tools.cave.options import ScanOptions
from aquanav_tools.cave.scan.read import read_scan
from aquanav_tools.errors import InputError
from aquanav_tools.types import Mesh, PointCloud

METRES = ScanOptions()


@pytest.fixture
def points(rng: np.random.Generator) -> np.ndarray:
    return rng.uniform(-2, 2, (50, 3))


def test_every_mesh_format_gives_the_same_triangles(tmp_path: Path) -> None:
    box = trimesh.creation.box([1, 2, 3])
    for suffix in ("stl", "obj", "ply", "off", "glb"):
        path = tmp_path / f"box.{suffix}"
        box.export(path)
        surface = read_scan(path, METRES).surface
        assert isinstance(surface, Mesh)
        assert surface.to_trimesh().area == pytest.approx(22.0)


def test_unit_and_up_axis_are_applied(tmp_path: Path) -> None:
    trimesh.creation.box([100, 200, 300]).export(tmp_path / "box.stl")
    surface = read_scan(tmp_path / "box.stl", ScanOptions(unit="cm", up="y")).surface
    assert isinstance(surface, Mesh)
    assert np.allclose(np.ptp(surface.vertices, axis=0), [3.0, 1.0, 2.0])


def test_turning_up_keeps_right_handedness(tmp_path: Path) -> None:
    trimesh.creation.icosphere(2).export(tmp_path / "ball.stl")
    for up in ("x", "y", "z", "-x", "-y", "-z"):
        surface = read_scan(tmp_path / "ball.stl", ScanOptions(up=up)).surface  # type: ignore[arg-type]
        assert isinstance(surface, Mesh)
        assert surface.to_trimesh().volume > 0


def test_a_table_of_points_is_a_cloud(points: np.ndarray, tmp_path: Path) -> None:
    np.savetxt(tmp_path / "a.xyz", points)
    np.savetxt(tmp_path / "b.csv", points, delimiter=",")
    for name in ("a.xyz", "b.csv"):
        surface = read_scan(tmp_path / name, METRES).surface
        assert isinstance(surface, PointCloud)
        assert np.allclose(surface.points, points)
        assert surface.normals is None


def test_columns_four_to_six_are_normals_only_when_they_are_unit_vectors(points: np.ndarray, tmp_path: Path) -> None:
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    np.savetxt(tmp_path / "normals.xyz", np.hstack([points, normals]))
    np.savetxt(tmp_path / "colours.xyz", np.hstack([points, 255 * np.abs(normals)]))
    with_normals, with_colours = (read_scan(tmp_path / f"{n}.xyz", METRES).surface for n in ("normals", "colours"))
    assert isinstance(with_normals, PointCloud)
    assert isinstance(with_colours, PointCloud)
    assert with_normals.normals is not None
    assert np.allclose(with_normals.normals, normals)
    assert with_colours.normals is None


def test_ply_clouds_keep_their_normals(points: np.ndarray, tmp_path: Path) -> None:
    from aquanav_tools.libraries import load_open3d

    open3d = load_open3d()
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    cloud.normals = open3d.utility.Vector3dVector(normals)
    for ascii_ in (True, False):
        open3d.io.write_point_cloud(str(tmp_path / "cloud.ply"), cloud, write_ascii=ascii_)
        surface = read_scan(tmp_path / "cloud.ply", METRES).surface
        assert isinstance(surface, PointCloud)
        assert surface.normals is not None
        assert np.allclose(surface.normals, normals, atol=1e-6)


def test_las_files_are_read_in_their_scale(points: np.ndarray, tmp_path: Path) -> None:
    import laspy

    header = laspy.LasHeader(point_format=3, version="1.4")
    header.scales = np.full(3, 0.001)
    las = laspy.LasData(header)
    las.xyz = points + [500_000.0, 0.0, 0.0]
    las.write(tmp_path / "cave.laz")
    scan = read_scan(tmp_path / "cave.laz", METRES)
    assert isinstance(scan.surface, PointCloud)
    assert abs(scan.offset[0] - 500_000) < 2
    assert np.allclose(scan.surface.points + scan.offset, points + [500_000, 0, 0], atol=6e-4)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("missing.stl", None, "There is no file"),
        ("cave.docx", b"x", "cave.docx is a document, not a scan. .* save it as text"),
        (
            "map.PDF",
            b"%PDF-1.7",
            "map.PDF is a document or a drawing, not a scan. .* Give the survey it was drawn from",
        ),
        ("one.jpg", b"x", "a single picture. .* put them into a folder"),
        ("scan.rcp", b"x", "in a format that is not read. Export it as .e57, .las"),
        ("cave.plyy", b"x", r"no known scan format \('.plyy'\). Did you mean '.ply'"),
        ("cave.vtkx", b"x", r"no known scan format \('.vtkx'\). Scans are meshes"),
        ("cave", b"x", "no ending that tells its format. Scans are meshes"),
        (
            "cut.stl",
            b"solid x\nfacet normal 0 0 1\n outer loop\n vertex 0 0",
            "cannot be read|has 0 points|has . points",
        ),
        ("empty.ply", b"", "cannot be read as '.ply'"),
        ("words.xyz", b"one two three\n", "is not a table of numbers"),
        ("flat.xyz", b"1 2\n3 4\n", "has 2 columns"),
        ("few.xyz", b"1 2 3\n3 4 5\n", "has 2 points; a surface needs at least 4"),
        ("nan.xyz", b"0 0 0\n1 nan 0\n1 1 1\n2 2 2\n", "has 1 of 4 points with coordinates that are not finite"),
        ("cut.las", b"LASF\x00\x00", "cannot be read as LAS"),
    ],
)
def test_bad_files_are_refused_with_a_reason(name: str, content: bytes | None, message: str, tmp_path: Path) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=message):
        read_scan(tmp_path / name, METRES)
