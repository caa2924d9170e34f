"""The command aquanav-build-cave on photos."""

from __future__ import annotations

import functools
import html
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from aquanav_tools.build.accept_open import accepting
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions, PhotoScaleOptions
from aquanav_tools.build.photo_stages import (
    check_is_cave,
    filmed_directions,
    in_metres,
    look_for_cave,
    preview_surface,
    write_found,
)
from aquanav_tools.cave.closing.ambient_occlusion import MIN_FACING, seen_height
from aquanav_tools.cave.closing.solid import refuse
from aquanav_tools.cave.options import ClosingOptions
from aquanav_tools.cave.scan.sight import Sight, make_sight
from aquanav_tools.errors import MeshError, ReconstructionError, UnseenWallsError
from aquanav_tools.photograph.dive import photograph
from aquanav_tools.photograph.trajectory import look
from aquanav_tools.reconstruct.diagnosis import Caution
from aquanav_tools.reconstruct.features import extract_features
from aquanav_tools.reconstruct.images import PhotoSet, read_photos
from aquanav_tools.reconstruct.reconstruction import Reconstruction
from aquanav_tools.synthetic.caves import demo_cave, tube
from aquanav_tools.types import Mesh, PointCloud, Sim3, silent
from tests.build.test_scan_build import run
from tests.disks import fill, small_disk
from tests.reconstruct.scenes import SMALL_CAVE, SMALL_DIVE


@pytest.fixture
def photos(rng: np.random.Generator, tmp_path: Path) -> PhotoSet:
    folder = tmp_path / "photos"
    folder.mkdir()
    for n in range(4):
        Image.fromarray(rng.integers(0, 255, (60, 80, 3), dtype=np.uint8)).save(folder / f"p{n}.png")
    return read_photos(folder)


HEIGHT = ("--passage-height", "2.5")
UPRIGHT = np.tile(np.eye(3), (9, 1, 1))


def in_a_tube(scale: float, rng: np.random.Generator) -> Reconstruction:
    """What photos of a tube of radius 1 give, in arbitrary units: `scale` times too large."""
    points, _ = trimesh.sample.sample_surface(tube(1.0, 8.0).mesh.to_trimesh(), 20_000, seed=1)
    normals = np.asarray(points) * [0.0, -1.0, -1.0]
    cameras = np.stack([np.linspace(1, 7, 9), rng.uniform(-0.2, 0.2, 9), rng.uniform(-0.2, 0.2, 9)], axis=1)
    cloud = PointCloud(scale * np.asarray(points), normals / np.linalg.norm(normals, axis=1, keepdims=True))
    return Reconstruction(cloud, scale * cameras, UPRIGHT, tuple(f"{n}.jpg" for n in range(9)), (), {})


def test_cameras_inside_a_tube_are_in_a_cave_at_any_scale(tube_of_ten: tuple[Reconstruction, Mesh]) -> None:
    assert check_is_cave(*tube_of_ten) > 0.9


def test_cameras_see_the_cloud_in_the_same_place_after_it_was_moved(
    tube_of_ten: tuple[Reconstruction, Mesh], tmp_path: Path
) -> None:
    before = tube_of_ten[0]
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    write_found(before.moved(Sim3(2.0, quarter, np.array([1.0, 2.0, 3.0]))), tmp_path)
    camera = json.loads((tmp_path / "cameras.json").read_text())["cameras"][4]
    points = trimesh.load(tmp_path / "cloud.ply").vertices
    seen = (points - camera["centre"]) @ np.transpose(camera["cam_from_world"])
    expected = 2.0 * (before.cloud.points - before.camera_centres[4]) @ before.camera_rotations[4].T
    assert camera["name"] == "4.jpg"
    np.testing.assert_allclose(seen, expected, atol=1e-4)  # PLY keeps float32


def test_cameras_before_a_facade_are_in_no_cave(rng: np.random.Generator) -> None:
    flat = np.stack([rng.uniform(-5, 5, 8000), np.zeros(8000), rng.uniform(0, 8, 8000)], axis=1)
    facade = flat + [0.0, 0.2, 0.0] * np.sin(flat[:, :1])
    cameras = np.stack([np.linspace(-4, 4, 9), np.full(9, -6.0), np.full(9, 1.7)], axis=1)
    cloud = PointCloud(facade, np.tile([0.0, -1.0, 0.0], (8000, 1)))
    reconstruction = Reconstruction(cloud, cameras, UPRIGHT, tuple("abcdefghi"), (), {})
    with pytest.raises(MeshError, match=r"no cave.*: from the cameras, the scanned surface fills only \d+%"):
        check_is_cave(reconstruction, preview_surface(cloud))
    accepted: list[UnseenWallsError] = []
    found = look_for_cave(reconstruction, accepted.append)
    assert found.is_inside.all()  # walls that are missing tell of nobody that he stood outside
    assert 0.1 < found.occlusion < 0.5  # a facade 10 m wide and 8 m high, 6 m away
    assert found.facing == 0.0
    assert [error.code for error in accepted] == ["open-walls"]
    assert "in the model's own unit" in accepted[0].facts  # nothing gave these photos a scale


def seen_faces(solid: trimesh.Trimesh, is_seen: Any, cameras: Any) -> Reconstruction:
    """What photos taken at (9, 3) places give that show some of a solid's faces from within."""
    samples, faces = trimesh.sample.sample_surface(solid, 40_000, seed=1)
    kept = is_seen(np.asarray(samples))
    normals = np.asarray(-solid.face_normals[faces][kept])
    cloud = PointCloud(np.asarray(samples)[kept], normals, None, np.full(kept.sum(), 3), np.zeros(kept.sum()))
    return Reconstruction(cloud, cameras, UPRIGHT, tuple("abcdefghi"), (), {})


def test_a_hall_of_which_ceiling_and_ends_were_not_seen_is_a_cave_half_seen() -> None:
    hall = trimesh.creation.box(bounds=[[0.0, -2.0, 0.0], [8.0, 2.0, 6.0]]).subdivide_to_size(0.5)
    cameras = np.stack([np.linspace(2.0, 6.0, 9), np.zeros(9), np.full(9, 1.6)], axis=1)
    found = look_for_cave(seen_faces(hall, lambda p: (abs(p[:, 0] - 4.0) < 3.99) & (p[:, 2] < 2.6), cameras), refuse)
    assert found.is_half_seen
    assert found.is_inside.all()
    # The median camera stands 3 m from one end of the seen walls, 1 m below their upper rim, 2 m from either wall. A
    # rectangle's solid angle: 4 asin(a b / sqrt((a^2 + d^2) (b^2 + d^2))), a and b half its sides, d the distance.
    expected = 2.0 * np.arcsin(3.0 * 1.0 / np.sqrt((3.0**2 + 2.0**2) * (1.0**2 + 2.0**2))) / np.pi
    assert found.facing == pytest.approx(expected, abs=0.02)  # 128 lines
    assert found.facing > MIN_FACING
    code, sentence = found.caution
    assert code == "half-seen"
    assert f"{found.facing:.0%} of all lines meet walls that face each other" in sentence


def test_photos_all_around_an_object_on_the_ground_show_no_cave() -> None:
    boulder = trimesh.creation.icosphere(4, 1.0)
    ground = trimesh.creation.box(bounds=[[-6.0, -6.0, -1.2], [6.0, 6.0, -1.0]]).subdivide_to_size(0.5)
    angles = np.linspace(0.0, 2.0 * np.pi, 9, endpoint=False)
    cameras = np.stack([3.0 * np.cos(angles), 3.0 * np.sin(angles), np.full(9, 0.5)], axis=1)
    around = seen_faces(trimesh.util.concatenate(boulder, ground), lambda p: p[:, 2] > -1.01, cameras)
    turned = replace(around.cloud, normals=-around.cloud.normals)
    with pytest.raises(
        UnseenWallsError, match=r"Nor were these between walls: .* 0% of all lines meet walls that face"
    ):
        look_for_cave(replace(around, cloud=turned), refuse)


def looking(ways: list[tuple[float, float]]) -> Sight:
    """Photos with a frame of 90 degrees squared, sure of a wall 2 m away, from one place in given ways."""
    poses = np.array([np.column_stack([look(*way), np.zeros(3)]) for way in ways])
    return make_sight(
        poses, np.tile([8.0, 8.0, 8.0, 8.0], (len(ways), 1)), [np.full((16, 16), 2.0, np.float32)] * len(ways)
    )


@pytest.mark.parametrize("count", [1, 2, 6])
def test_each_face_of_a_cube_that_photos_look_at_is_a_sixth_of_all_directions(count: int) -> None:
    quarter = np.pi / 2.0
    ways = [(0.0, 0.0), (quarter, 0.0), (2 * quarter, 0.0), (3 * quarter, 0.0), (0.0, quarter), (0.0, -quarter)]
    assert filmed_directions(looking(ways[:count] * 2)) == pytest.approx(count / 6, abs=0.02)  # 256 directions


def test_photos_that_look_one_way_are_refused_by_that() -> None:
    wall = np.random.default_rng(0).uniform(-4.0, 4.0, (8000, 2))
    points = np.column_stack([2.0 + 0.1 * np.sin(wall[:, 0]), wall])
    cloud = PointCloud(points, np.tile([-1.0, 0.0, 0.0], (8000, 1)))
    cameras = np.column_stack([np.zeros(9), np.linspace(-1.0, 1.0, 9), np.zeros(9)])
    found = Reconstruction(cloud, cameras, UPRIGHT, tuple("abcdefghi"), (), {}, sight=looking([(0.0, 0.0)] * 9))
    sentence = r"into only 1\d% of all directions.* take photos that look the other ways too.* --accept-open"
    with pytest.raises(UnseenWallsError, match=sentence):
        look_for_cave(found, refuse)


@pytest.fixture(scope="module")
def tube_of_ten() -> tuple[Reconstruction, Mesh]:
    """A reconstruction of a passage that is 10 units high, and its preview."""
    reconstruction = in_a_tube(5.0, np.random.default_rng(0))
    return reconstruction, preview_surface(reconstruction.cloud)


def test_the_passage_height_gives_the_scale(tube_of_ten: tuple[Reconstruction, Mesh]) -> None:
    (reconstruction, preview), journal = tube_of_ten, Journal(silent)
    scaled = in_metres(reconstruction, preview, PhotoScaleOptions(passage_height=2.0), journal)
    # Through a camera 0.1 m off the axis the tube is 1 % lower; the coarse surface adds as much.
    assert np.ptp(scaled.cloud.points[:, 0]) == pytest.approx(8.0, rel=0.04)
    assert [code for code, _ in journal.notices] == ["rough-scale"]
    assert scaled.statistics["scale_error_percent_95"] == 33.0


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        (-np.inf, 3.0, 10.0),  # the axis lies 5 above the floor, so that the passage is 10 high
        (-np.inf, 1.0, 10.0),
        (-3.0, 3.0, 6.0),  # neither floor nor ceiling: as high as what was seen
    ],
)
def test_where_no_ceiling_was_seen_the_floor_or_what_was_seen_gives_the_scale_if_that_is_accepted(
    tube_of_ten: tuple[Reconstruction, Mesh], low: float, high: float, expected: float
) -> None:
    whole = tube_of_ten[0]
    z = whole.cloud.points[:, 2]
    is_seen = (z > low) & (z < high)  # of a tube of radius 5
    assert whole.cloud.normals is not None
    open_above = replace(whole, cloud=PointCloud(whole.cloud.points[is_seen], whole.cloud.normals[is_seen]))
    preview, scale = preview_surface(open_above.cloud), PhotoScaleOptions(passage_height=4.0)
    journal = Journal(silent)
    with pytest.raises(UnseenWallsError, match=r"straight above 0 of them there is .*, straight below [09]"):
        in_metres(open_above, preview, scale, journal)
    scaled = in_metres(open_above, preview, scale, journal, accepting(ClosingOptions(accept_open=True), journal))
    # Less the 2 % of what was seen that is left out below and above; the coarse surface adds as much.
    assert np.ptp(scaled.cloud.points[:, 0]) == pytest.approx(4.0 / expected * 40.0, rel=0.1)
    assert [code for code, _ in journal.notices] == ["height-unknown", "rough-scale"]
    assert scaled.statistics["scale_error_percent_95"] == 50.0


def test_a_low_thing_beside_the_cameras_is_not_the_height_of_the_room() -> None:
    """A table below the cameras, where they stand, and a wall 6 high that they look at, 4 away."""
    rng = np.random.default_rng(0)
    table = rng.uniform([-1.0, -1.0, -1.2], [1.0, 1.0, -1.0], (5_000, 3))
    wall = rng.uniform([4.0, -4.0, -3.0], [4.1, 4.0, 3.0], (20_000, 3))
    cameras = np.column_stack([np.zeros(9), np.linspace(-1.0, 1.0, 9), np.zeros(9)])
    elsewhere = Mesh(wall[:3], np.array([[0, 1, 2]]))  # neither below the cameras nor above
    height, what = seen_height(elsewhere, np.concatenate([table, wall]), cameras, 6.0)
    assert height == pytest.approx(6.0, rel=0.1)  # 2 % are left out below and above, of all points
    assert what == "the height of what was seen"


def test_a_passage_height_that_differs_from_the_model_is_noted(tube_of_ten: tuple[Reconstruction, Mesh]) -> None:
    reconstruction, journal = replace(tube_of_ten[0], is_metric=True), Journal(silent)
    preview = tube_of_ten[1]
    assert in_metres(reconstruction, preview, PhotoScaleOptions(passage_height=11.0), journal) is reconstruction
    assert not journal.notices
    assert in_metres(reconstruction, preview, PhotoScaleOptions(passage_height=40.0), journal) is reconstruction
    assert [code for code, _ in journal.notices] == ["passage-height-differs"]


def test_without_any_scale_the_build_asks_for_one_before_it_does_anything(photos: PhotoSet, tmp_path: Path) -> None:
    result = run(photos.folder, "-o", tmp_path / "out")
    assert result.returncode == 2
    ways = r"--passage-height.*--marker-size.*--distance.*--stations.*--positions.*--depth-track.*--rig"
    assert re.fullmatch(rf"error: Nothing tells how large the place in .* is: .*{ways}.*\n", result.stderr)
    assert "--gps" not in result.stderr  # these photos have no satellite positions
    assert not (tmp_path / "out").exists()


def test_where_there_are_no_photos_that_is_said_and_not_that_they_have_no_scale(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("none yet")
    assert "holds 0 photos" in run(tmp_path, "-o", tmp_path / "out").stderr


def test_satellite_positions_in_the_photos_are_named_among_the_ways_to_a_scale(tmp_path: Path) -> None:
    for n in range(3):
        exif = Image.Exif()
        if n:
            exif.get_ifd(0x8825).update({1: "N", 2: (46.0, 30.0, n / 100.0), 3: "E", 4: (7.0, 0.0, 0.0)})
        Image.new("RGB", (80, 60)).save(tmp_path / f"p{n}.jpg", exif=exif)
    (tmp_path / "broken.jpg").write_bytes(b"no photo")
    result = run(tmp_path, "-o", tmp_path / "out")
    assert "--gps for the satellite positions in 2 of 4 files (above ground only)" in result.stderr


def test_photos_without_the_markers_they_should_show_are_refused_before_features_are_sought(
    photos: PhotoSet, tmp_path: Path
) -> None:
    result = run(photos.folder, "-o", tmp_path / "out", "--marker-size", "0.2")
    assert result.returncode == 2
    assert "No apriltag-36h11 marker of 0.2 m was found in 4 photos" in result.stderr
    assert not list((tmp_path / "out" / "work").glob("features-*"))


def test_sources_that_tell_no_scale_are_named_where_the_build_stops(
    tube_of_ten: tuple[Reconstruction, Mesh],
) -> None:
    reconstruction, preview = tube_of_ten
    unused = replace(reconstruction, warnings=(Caution("unused-scale-source", "The depths are not used."),))
    with pytest.raises(ReconstructionError, match=r"does not tell its size\. The depths are not used\. What was found"):
        in_metres(unused, preview, PhotoScaleOptions(), Journal(silent))


def test_a_missing_positions_file_is_noticed_before_any_work(photos: PhotoSet, tmp_path: Path) -> None:
    result = run(photos.folder, "-o", tmp_path / "out", "--positions", tmp_path / "none.csv")
    assert result.returncode == 2
    assert "none.csv" in result.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("name", ["dive.mp4", "dive.MOV", "dive.avi", "dive.mkv"])
def test_a_video_is_built_from_its_frames(name: str) -> None:
    assert BuildOptions(Path(name), Path("out")).kind == "photos"


def test_a_build_names_bad_photos_before_the_work_and_in_its_report(photos: PhotoSet, tmp_path: Path) -> None:
    (photos.folder / "cut.jpg").write_text("no photo")
    result = run(photos.folder, "-o", tmp_path / "out", "--housing", "flat-port", *HEIGHT)
    told = result.stderr
    assert told.index("cut.jpg (the file holds no picture") < told.index("4 photos, standard quality. On")
    assert "the focal length grows by 33%" in result.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert [one["name"] for one in report["left_out"]] == ["cut.jpg"]
    assert {"photos-left-out", "refraction", "little-overlap"} <= {warning["code"] for warning in report["warnings"]}
    assert set(report["forecast"]["seconds"]) == {"features", "matching", "cameras", "depth", "fusion"}
    assert "Photos with something wrong at first look" in (tmp_path / "out" / "report.html").read_text()


def test_photos_that_do_not_register_leave_a_report_and_no_scenario(photos: PhotoSet, tmp_path: Path) -> None:
    result = run(photos.folder, "-o", tmp_path / "out", *HEIGHT)
    assert result.returncode == 3
    assert "Traceback" not in result.stderr
    left = {path.name for path in (tmp_path / "out").iterdir()}
    assert left == {"work", "drawings", "report.html", "report.json", "build.json"}
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["error"] in result.stderr
    assert [photo["name"] for photo in report["unregistered"]] == photos.names
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Photos that did not register" in page
    assert all(html.escape(photo["sentence"]) in page for photo in report["unregistered"])


def test_a_disk_without_room_is_noticed_before_any_work(photos: PhotoSet, tmp_path: Path) -> None:
    with small_disk(tmp_path / "disk", 90) as disk:
        result = run(photos.folder, "-o", disk / "out", *HEIGHT)
        assert result.returncode == 6
        assert "is full: 94 MB are free" in result.stderr
        assert not (disk / "out").exists()


def test_a_disk_that_fills_up_stops_the_work_and_the_same_command_goes_on(
    photos: PhotoSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from aquanav_tools.reconstruct import reconstruction

    with small_disk(tmp_path / "disk", 150) as disk:

        @functools.wraps(extract_features)
        def find_and_fill(*arguments: Any) -> None:
            extract_features(*arguments)
            fill(disk, leave_megabytes=50)

        monkeypatch.setattr(reconstruction, "extract_features", find_and_fill)
        result = run(photos.folder, "-o", disk / "out", *HEIGHT)
        assert result.returncode == 6
        assert re.search(r"is full: \d+ MB are free, and 100 MB must stay so\. Make room there", result.stderr)
        (disk / "filler").unlink()
        monkeypatch.setattr(reconstruction, "extract_features", extract_features)
        assert run(photos.folder, "-o", disk / "out", *HEIGHT).returncode == 3  # photos of noise do not register
        assert "Only 0 of 4 photos registered" in json.loads((disk / "out" / "report.json").read_text())["error"]


@pytest.mark.slow
def test_the_fountain_is_reconstructed_and_then_refused_as_no_cave(data_dir: Path, tmp_path: Path) -> None:
    folder = data_dir / "img_strecha_fountain_p11_half" / "images"
    if not folder.is_dir():
        pytest.skip(f"No real data: {folder} does not exist.")
    result = run(folder, "-o", tmp_path / "out", *HEIGHT)
    assert result.returncode == 4
    assert "the scanned surface fills only" in result.stderr
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["registered"] == 11
    assert (tmp_path / "out" / "cloud.ply").stat().st_size > 1_000_000
    assert not (tmp_path / "out" / "scenario.toml").exists()


@pytest.mark.slow
def test_of_photos_of_two_places_the_larger_is_used_and_the_other_named(tmp_path: Path) -> None:
    folder = tmp_path / "photos"
    folder.mkdir()
    for seed, (place, photos) in enumerate((("pool", 12), ("shaft", 8))):
        cave, capture = demo_cave(replace(SMALL_CAVE, seed=seed)), replace(SMALL_DIVE.capture, photos=photos)
        photograph(cave, tmp_path / place, replace(SMALL_DIVE, capture=capture, seed=seed))
        for path in sorted((tmp_path / place).glob("*.jpg")):
            path.rename(folder / f"{place}_{path.name}")
    result = run(folder, "-o", tmp_path / "out", "--passage-height", "2.4", "--quality", "draft")
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    other = {row["name"]: row["cause"] for row in report["unregistered"] if row["name"].startswith("shaft")}
    assert len(other) == 8
    assert set(other.values()) == {"detached"}
    assert 10 <= report["registered"] <= 12
    assert result.returncode == 0, result.stderr
    assert any("They may show two places" in warning["text"] for warning in report["warnings"])
    assert (tmp_path / "out" / "cloud.ply").exists()
