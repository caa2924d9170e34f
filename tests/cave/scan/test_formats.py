"""E57, PTX, PTS, PCD, COLLADA, 3MF and USD: the same geometry in metres with z up, whatever unit and axes they have."""

from __future__ import annotations

import importlib
import struct
import zipfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.cave.options import ScanOptions
from aquanav_tools.cave.scan import e57, models
from aquanav_tools.cave.scan.cloud import surface_from_cloud
from aquanav_tools.cave.scan.files import read_surface
from aquanav_tools.cave.scan.pcd import _unpack_lzf
from aquanav_tools.cave.scan.read import read_scan
from aquanav_tools.errors import AquanavError, InputError, ResourceError
from aquanav_tools.libraries import is_installed
from aquanav_tools.types import Mesh, PointCloud
from tests.cave.scan import written

LIBRARY = {"e57": "pye57", "dae": "collada", "3mf": "lxml", "usda": "pxr", "usdc": "pxr", "usdz": "pxr", "usd": "pxr"}
AS_FILED = ScanOptions()


def need(suffix: str) -> None:
    if suffix in LIBRARY:
        pytest.importorskip(LIBRARY[suffix])


def need_open3d() -> None:
    if not is_installed("open3d"):
        pytest.skip("needs open3d, which is not installed")


Write = Callable[[Path], None]


@pytest.fixture
def decoded_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Decode in this process: one of its own, which the tests of bad files have, takes a second to start."""

    def decoded(module: str, path: Path, arguments: Sequence[str], *limits: int) -> Iterator[Any]:
        decoder = importlib.import_module(module)
        decoder.prepare()
        yield from decoder.decode(path, *arguments)

    for reader in (models, e57):
        monkeypatch.setattr(reader, "decoded", decoded)


MODELS: dict[str, tuple[str, Write]] = {
    "dae in cm, y up": ("dae", written.write_dae),
    "dae in feet, z up": ("dae", lambda path: written.write_dae(path, 0.3048, "Z_UP")),
    "3mf in mm": ("3mf", written.write_3mf),
    "3mf without a unit": ("3mf", lambda path: written.write_3mf(path, None)),
    "3mf in inches": ("3mf", lambda path: written.write_3mf(path, "inch")),
    "usda in cm, y up": ("usda", written.write_usd),
    "usdc in m, z up": ("usdc", lambda path: written.write_usd(path, 1.0, "Z")),
    "usd that says neither": ("usd", lambda path: written.write_usd(path, None, None)),
    "usdz in m, y up": ("usdz", lambda path: written.write_usd(path, 1.0, "Y")),
}


@pytest.mark.usefixtures("decoded_here")
@pytest.mark.parametrize("name", MODELS)
def test_models_are_read_in_the_unit_and_axes_that_they_name(tmp_path: Path, name: str) -> None:
    suffix, write = MODELS[name]
    need(suffix)
    write(tmp_path / f"box.{suffix}")
    surface = read_scan(tmp_path / f"box.{suffix}", AS_FILED).surface
    assert isinstance(surface, Mesh)
    # Files hold float32, or nine digits: a part in 1e7 of 8 m.
    assert surface.volume == pytest.approx(np.prod(written.BOX), rel=1e-5)
    assert np.allclose(surface.vertices.min(axis=0), written.CENTRE - 0.5 * np.array(written.BOX), atol=1e-5)
    assert np.allclose(surface.vertices.max(axis=0), written.CENTRE + 0.5 * np.array(written.BOX), atol=1e-5)
    if suffix.startswith("usd"):
        assert surface.colours is not None
        assert (surface.colours == written.RED).all()


def test_options_count_more_than_what_a_file_says(tmp_path: Path) -> None:
    need("dae")
    written.write_dae(tmp_path / "box.dae", 0.01, "Y_UP")  # its numbers are 100 times the metres
    surface = read_scan(tmp_path / "box.dae", ScanOptions(unit="dm", up="z")).surface
    assert isinstance(surface, Mesh)
    edges = 10.0 * np.array(written.BOX)[[1, 2, 0]]
    assert np.allclose(np.ptp(surface.vertices, axis=0), edges, atol=1e-4)


def test_a_unit_in_a_file_that_no_cave_fits_is_told_with_the_one_that_does(tmp_path: Path) -> None:
    need("3mf")
    written.write_3mf(tmp_path / "box.3mf", "micron")
    text = (tmp_path / "box.3mf").read_bytes()
    with zipfile.ZipFile(tmp_path / "box.3mf") as archive:
        model = archive.read(written.MODEL).decode().replace('unit="micron"', 'unit="meter"')
    with zipfile.ZipFile(tmp_path / "box.3mf", "w") as archive:
        archive.writestr(written.MODEL, model)
    assert (tmp_path / "box.3mf").read_bytes() != text
    with pytest.raises(InputError, match=r"With the unit that the file names \(1 m\) the cave is 4,000,000 m long"):
        read_scan(tmp_path / "box.3mf", AS_FILED)


CLOUDS: dict[str, tuple[str, Write]] = {
    "e57": ("e57", written.write_e57),
    "e57 without poses": ("e57", lambda path: written.write_e57(path, has_poses=False)),
    "ptx": ("ptx", written.write_ptx),
    "pts": ("pts", written.write_pts),
    "pcd as text": ("pcd", lambda path: written.write_pcd(path, "ascii")),
    "pcd": ("pcd", written.write_pcd),
    "packed pcd": ("pcd", lambda path: written.write_pcd(path, "binary_compressed")),
}
NUM_POINTS = {"e57": 400, "ptx": 200, "pts": 200, "pcd": 60}


@pytest.mark.usefixtures("decoded_here")
@pytest.mark.parametrize("name", CLOUDS)
def test_clouds_lie_where_they_were_scanned_with_their_colours(tmp_path: Path, name: str) -> None:
    suffix, write = CLOUDS[name]
    need(suffix)
    write(tmp_path / f"tube.{suffix}")
    cloud = read_scan(tmp_path / f"tube.{suffix}", AS_FILED).surface
    assert isinstance(cloud, PointCloud)
    expected = written.tube_points(NUM_POINTS[suffix])
    found, wanted = (rows[np.lexsort(rows.round(3).T)] for rows in (cloud.points, expected))
    assert found.shape == wanted.shape
    assert np.allclose(found, wanted, atol=2e-6)  # float32, or six digits after the point
    assert cloud.colours is not None
    assert (cloud.colours == written.RED).all()


@pytest.mark.usefixtures("decoded_here")
@pytest.mark.parametrize(("suffix", "write"), [("e57", written.write_e57), ("ptx", written.write_ptx)])
def test_each_point_knows_the_scanner_that_measured_it(tmp_path: Path, suffix: str, write: Write) -> None:
    need(suffix)
    write(tmp_path / f"tube.{suffix}")
    cloud = read_scan(tmp_path / f"tube.{suffix}", AS_FILED).surface
    assert isinstance(cloud, PointCloud)
    assert cloud.seen_from is not None
    nearest = np.linalg.norm(cloud.points[:, None] - written.STATIONS, axis=2).argmin(axis=1)
    assert np.allclose(cloud.seen_from, written.STATIONS[nearest], atol=2e-6)


def test_scanners_in_the_passage_are_known_to_be_in_the_water_and_one_before_a_wall_is_not(tmp_path: Path) -> None:
    need("e57")
    written.write_e57(tmp_path / "tube.e57", 20_000)
    scan = read_scan(tmp_path / "tube.e57", AS_FILED)
    assert np.allclose(scan.stations, written.STATIONS)
    cloud = scan.surface
    assert isinstance(cloud, PointCloud)
    from aquanav_tools.cave.scan.stations import enclosed_stations

    outside = np.tile([-3.0, 0.0, 0.0], (len(cloud.points), 1))
    assert not len(enclosed_stations(PointCloud(cloud.points, seen_from=outside)))
    assert cloud.seen_from is not None
    floor = cloud.points[:, 2] < cloud.seen_from[:, 2]
    assert not len(enclosed_stations(PointCloud(cloud.points[floor], seen_from=cloud.seen_from[floor])))


@pytest.mark.usefixtures("decoded_here")
def test_an_e57_without_poses_names_no_scanner(tmp_path: Path) -> None:
    need("e57")
    written.write_e57(tmp_path / "tube.e57", has_poses=False)
    cloud = read_scan(tmp_path / "tube.e57", AS_FILED).surface
    assert isinstance(cloud, PointCloud)
    assert cloud.seen_from is None


@pytest.mark.parametrize(("distance", "sign"), [(0.0, 1.0), (6.0, -1.0)])
def test_a_wall_faces_the_scanner_whichever_side_looks_more_like_water(
    rng: np.random.Generator, distance: float, sign: float
) -> None:
    need_open3d()
    radius = 2.0
    points = rng.normal(size=(20_000, 3))
    points *= radius / np.linalg.norm(points, axis=1, keepdims=True)
    corners = distance * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) / np.sqrt(3.0)
    seen_from = corners[np.linalg.norm(points[:, None] - corners, axis=2).argmin(axis=1)]
    surface = surface_from_cloud(PointCloud(points, seen_from=seen_from), 0.1)
    # Normals are out of the water: a ball seen from within has them outwards, a pillar seen from outside inwards.
    assert surface.mesh.volume == pytest.approx(sign * 4.0 / 3.0 * np.pi * radius**3, rel=0.05)


def test_several_files_of_one_cave_are_one_scan(tmp_path: Path) -> None:
    points = written.tube_points(400)
    np.savetxt(tmp_path / "a.xyz", points[:250])
    np.savetxt(tmp_path / "b.xyz", points[250:])
    scan = read_scan(tmp_path / "a.xyz", AS_FILED, [tmp_path / "b.xyz"])
    assert isinstance(scan.surface, PointCloud)
    assert np.allclose(scan.surface.points, points)


@pytest.mark.usefixtures("decoded_here")
def test_files_in_different_units_meet_in_metres_and_points_with_triangles_do_not(tmp_path: Path) -> None:
    need("3mf")
    written.write_3mf(tmp_path / "a.3mf", "millimeter")
    written.write_3mf(tmp_path / "b.3mf", "inch")
    surface = read_scan(tmp_path / "a.3mf", AS_FILED, [tmp_path / "b.3mf"]).surface
    assert isinstance(surface, Mesh)
    assert len(surface.faces) == 24
    assert np.allclose(np.ptp(surface.vertices, axis=0), written.BOX, atol=1e-5)
    written.write_pts(tmp_path / "c.pts")
    with pytest.raises(InputError, match=r"a\.3mf has triangles and c\.pts points alone; .* all meshes or all point"):
        read_scan(tmp_path / "a.3mf", AS_FILED, [tmp_path / "c.pts"])


def test_lzf_repeats_what_it_refers_to() -> None:
    # Two bytes as they are, then 9 + 255 from two back, then three from one back: by LibLZF's definition.
    packed = np.array([1, 7, 8, 0xE0, 255, 1, 0x20, 0], dtype=np.uint8)
    content = np.zeros(269, dtype=np.uint8)
    assert _unpack_lzf(packed, content) == 269
    assert content.tolist() == [7, 8] * 133 + [8] * 3
    assert _unpack_lzf(packed, content[:-1]) == -1
    assert _unpack_lzf(packed[:-1], content) == -1
    assert _unpack_lzf(packed[3:], content) == -1


def test_open3d_s_packed_pcd_has_the_same_points(tmp_path: Path) -> None:
    need_open3d()
    from aquanav_tools.libraries import load_open3d

    open3d = load_open3d()
    points = written.tube_points(500).round(1)  # of few values, so that LZF finds repeats
    cloud = open3d.geometry.PointCloud(open3d.utility.Vector3dVector(points))
    for name, settings in {"text": {"write_ascii": True}, "plain": {}, "packed": {"compressed": True}}.items():
        open3d.io.write_point_cloud(str(tmp_path / f"{name}.pcd"), cloud, **settings)
        surface = read_surface(tmp_path / f"{name}.pcd").surface
        assert isinstance(surface, PointCloud)
        assert np.allclose(surface.points, points, atol=1e-6)


SEEDS: dict[str, Write] = {
    "e57": written.write_e57, "ptx": written.write_ptx, "pts": written.write_pts, "pcd": written.write_pcd,
    "dae": written.write_dae, "3mf": written.write_3mf, "usda": written.write_usd, "usdc": written.write_usd,
    "usdz": written.write_usd,
}  # fmt: skip


def refusal(path: Path) -> str:
    with pytest.raises(AquanavError) as told:
        read_scan(path, AS_FILED)
    text = str(told.value)
    assert path.name in text
    assert "\n" not in text
    return text


@pytest.mark.parametrize("suffix", SEEDS)
def test_bad_files_of_every_format_are_refused_in_a_sentence(tmp_path: Path, suffix: str) -> None:
    need(suffix)
    path = tmp_path / f"scan.{suffix}"
    SEEDS[suffix](path)
    whole = path.read_bytes()
    contents = {"empty": b"", "wrong kind": b"%PDF-1.7\n" + bytes(2000), "cut off": whole[: len(whole) * 2 // 3]}
    for kind, content in contents.items():
        path.write_bytes(content)
        told = refusal(path)
        assert "xport it again" in told or "Export the scan" in told or "Save it again" in told, (kind, told)


def patched(path: Path, at: int, form: str, value: int) -> Path:
    content = bytearray(path.read_bytes())
    struct.pack_into(form, content, at, value)
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(("at", "words"), [(16, r"announces 1,152,921,504,606,846,976 bytes"), (32, "of them XML")])
def test_an_e57_header_is_held_against_the_file_s_size(tmp_path: Path, at: int, words: str) -> None:
    need("e57")
    written.write_e57(tmp_path / "a.e57")
    assert words in refusal(patched(tmp_path / "a.e57", at, "<Q", 1 << 60))


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.ptx", "1000000\n1000000\n", "announces|8 lines"),
        ("a.ptx", "9" * 5000 + "\n1\n", "stands where a number of points should"),
        ("a.pts", "99999999999\n1 2 3\n", "announces 99,999,999,999 points, and the 6 bytes that follow hold 1"),
        ("a.pts", "3\n1 2 3\n1 2 3\n", r"announces 3 points, and the 12 bytes"),
        ("a.pts", "2\n1 2 3 0 0 0 0\n1 2 x 0 0 0 0\n", "a point is not numbers"),
    ],
)
def test_texts_that_announce_more_than_they_hold_are_refused(
    tmp_path: Path, name: str, content: str, words: str
) -> None:
    (tmp_path / name).write_text(content)
    import re

    assert re.search(words, refusal(tmp_path / name))


def test_a_pcd_that_announces_more_than_it_holds_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.pcd"
    for encoding in ("ascii", "binary", "binary_compressed"):
        written.write_pcd(path, encoding)
        whole = path.read_bytes()
        path.write_bytes(whole.replace(b"POINTS 60", b"POINTS 9999999"))
        assert "announces 9,999,999 points" in refusal(path)
        path.write_bytes(whole.replace(b"POINTS 60", b"POINTS 99999999999"))
        with pytest.raises(ResourceError, match="more than the 20 million"):
            read_scan(path, AS_FILED)


@pytest.mark.parametrize("suffix", ["3mf", "usdz"])
def test_an_archive_that_announces_more_than_its_bytes_can_hold_is_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"a.{suffix}"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr(written.MODEL, bytes(1000))
    content = bytearray(path.read_bytes())
    at = content.index(b"PK\x01\x02") + 24  # the unpacked size in the central directory
    path.write_bytes(content)
    assert "unpacked 4,294,967,000" in refusal(patched(path, at, "<I", 4_294_967_000))


def test_a_3mf_of_more_points_than_can_be_loaded_is_refused_unread(tmp_path: Path) -> None:
    path = tmp_path / "a.3mf"
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
        archive.open(written.MODEL, "w") as member,
    ):
        for _ in range(410):
            member.write(bytes(1 << 20))
    with pytest.raises(ResourceError, match="more than the 20 million"):
        read_scan(path, AS_FILED)


@pytest.mark.usefixtures("decoded_here")
def test_a_usd_without_a_mesh_and_one_with_wrong_corners_are_refused(tmp_path: Path) -> None:
    need("usda")
    path = tmp_path / "a.usda"
    path.write_text('#usda 1.0\ndef Xform "nothing" {}\n')
    assert "has no mesh and no points that are shown" in refusal(path)
    mesh = "point3f[] points = [(0,0,0),(1,0,0),(0,1,0)]\nint[] faceVertexCounts = [{}]\nint[] faceVertexIndices = [{}]"
    for counts, corners, words in (("3", "0, 1, 9", "none of its 3 points"), ("4", "0, 1, 2", "4 corners and has 3")):
        path.write_text(f'#usda 1.0\ndef Mesh "m" {{\n{mesh.format(counts, corners)}\n}}\n')
        assert words in refusal(path)
