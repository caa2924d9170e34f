from __future__ import annotations

import csv
import datetime
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from aquanav_tools.photograph import files
from aquanav_tools.photograph.conditions import CONDITIONS, ConditionName
from aquanav_tools.photograph.dive import Photographer, film, photograph
from aquanav_tools.photograph.lens import Lens
from aquanav_tools.photograph.options import CameraOptions, CaptureOptions, DiveOptions, LensName
from aquanav_tools.photograph.scene import SmoothScene
from aquanav_tools.photograph.trajectory import plan_capture
from aquanav_tools.synthetic.caves import SyntheticCave, tube
from aquanav_tools.types import rotation_matrix

SMALL = CameraOptions(width=96, height=72)
THREE = DiveOptions(camera=SMALL, capture=CaptureOptions(photos=3))


@pytest.fixture(scope="module")
def cave() -> SyntheticCave:
    return tube(1.5, 8.0)


@pytest.fixture(scope="module")
def folder(cave: SyntheticCave, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three small photos whose names roll over, with depth."""
    out = tmp_path_factory.mktemp("photographed")
    photograph(cave, out, replace(THREE, camera=replace(SMALL, first_number=9999)), with_depth=True)
    return out


def test_rays_meet_a_tube_at_its_radius_with_normals_out_of_the_water() -> None:
    scene = SmoothScene(tube(2.0, 20.0).mesh)
    across = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -2.0], [1.0, 0.0, 0.0]])
    steps, normals = scene.cast(np.array([10.1, 0.0, 0.0]), across)
    np.testing.assert_allclose(steps[:2], [2.0, 1.0], rtol=2e-3)  # the chord of a 64-gon is 0.12 % nearer
    np.testing.assert_allclose(normals[:2], [[0, 1, 0], [0, 0, -1]], atol=0.05)
    assert np.isnan(steps[2])


def test_the_cameras_counter_rolls_over_after_9999() -> None:
    assert files.photo_names(3, 9998) == ["IMG_9998.JPG", "IMG_9999.JPG", "IMG_0001.JPG"]
    assert files.photo_names(2, None) == ["dive_1.jpg", "dive_2.jpg"]


def test_a_folder_holds_photos_positions_and_truth(folder: Path) -> None:
    names = ["IMG_9999.JPG", "IMG_0001.JPG", "IMG_0002.JPG"]
    rows = list(csv.DictReader((folder / "positions.csv").open()))
    truth = json.loads((folder / "truth.json").read_text())
    assert [row["name"] for row in rows] == [camera["name"] for camera in truth["cameras"]] == names
    listed = np.array([[float(row[axis]) for axis in "xyz"] for row in rows])
    np.testing.assert_allclose(listed, [camera["centre"] for camera in truth["cameras"]], atol=1e-4)
    assert sorted(path.name for path in folder.glob("IMG*")) == sorted(names)


def test_the_truths_quaternions_and_translations_are_its_rotations_and_centres(folder: Path) -> None:
    for camera in json.loads((folder / "truth.json").read_text())["cameras"]:
        turn = np.array(camera["cam_from_world"])
        np.testing.assert_allclose(rotation_matrix(np.array(camera["quaternion"])), turn, atol=1e-12)
        np.testing.assert_allclose(turn @ camera["centre"] + camera["translation"], 0.0, atol=1e-12)


def test_quaternions_turn_back_into_their_rotations_also_near_half_turns(rng: np.random.Generator) -> None:
    half_turns = [np.diag([1.0, -1, -1]), np.diag([-1.0, 1, -1]), np.diag([-1.0, -1, 1]), np.eye(3)]
    random = [rotation_matrix(q / np.linalg.norm(q)) for q in rng.normal(size=(50, 4))]
    for rotation in [*half_turns, *random]:
        np.testing.assert_allclose(rotation_matrix(files.quaternion(rotation)), rotation, atol=1e-12)


def test_exif_tells_lens_shutter_and_time_to_the_millisecond(folder: Path) -> None:
    base = ExifTags.Base
    times = []
    for name in ("IMG_9999.JPG", "IMG_0001.JPG"):
        with Image.open(folder / name) as image:
            exif = image.getexif()
            assert (exif[base.Make], exif[base.Model]) == ("aquanav", "synthetic pinhole")
            inner = exif.get_ifd(ExifTags.IFD.Exif)
        assert inner[base.FocalLengthIn35mmFilm] == 16
        assert float(inner[base.ExposureTime]) == pytest.approx(SMALL.exposure_s)
        stamp = f"{inner[base.DateTimeOriginal]}.{inner[base.SubsecTimeOriginal]}"
        times.append(datetime.datetime.strptime(stamp, "%Y:%m:%d %H:%M:%S.%f"))
    first, second = (camera["time"] for camera in json.loads((folder / "truth.json").read_text())["cameras"][:2])
    assert (times[1] - times[0]).total_seconds() == pytest.approx(second - first, abs=1e-3)


def test_the_surfaces_are_the_caves(folder: Path, cave: SyntheticCave) -> None:
    import trimesh

    water = trimesh.load_mesh(folder / "truth_water.ply")
    assert water.is_watertight
    assert water.volume == pytest.approx(cave.truth.to_trimesh().volume, rel=1e-5)  # float32
    assert len(trimesh.load_mesh(folder / "truth_wall.ply").faces) == len(cave.mesh.faces)


def test_depth_and_pose_put_every_pixel_onto_the_tubes_wall(folder: Path) -> None:
    truth = json.loads((folder / "truth.json").read_text())
    lens = Lens(truth["width"], truth["height"], truth["focal_px"])
    for camera in truth["cameras"]:
        with np.load(folder / "truth_depth" / f"{Path(camera['name']).stem}.npz") as arrays:
            depth = arrays["depth"].astype(float).ravel()
        rays = lens.rays()
        points = rays * (depth / rays[:, 2])[:, None] @ np.array(camera["cam_from_world"]) + camera["centre"]
        radius = np.hypot(points[:, 1], points[:, 2])[np.isfinite(depth)]
        assert len(radius) > 1000
        np.testing.assert_allclose(radius, 1.5, rtol=2e-3)  # chords of a 64-gon


@pytest.mark.parametrize("lens", ["pinhole", "fisheye"])
def test_known_points_reproject_onto_the_same_rock_from_another_pose(cave: SyntheticCave, lens: LensName) -> None:
    """The rock's own texture marks the points: two photos show the same colours at a point's two projections."""
    steady = CaptureOptions("forward", 20, unsteady_m=0.0, unsteady_deg=0.0)
    options = DiveOptions(camera=CameraOptions(lens, 320, 240, exposure_s=1e-6), capture=steady)
    photographer = Photographer(cave.mesh, options)
    first, second = plan_capture(cave.centreline, steady)[8:10]
    (light, depth), (other, _) = photographer.expose(first), photographer.expose(second)
    rays = photographer.lens.rays()
    points = rays * (depth.ravel().astype(float) / rays[:, 2])[:, None] @ first.cam_from_world + first.centre
    pixels = photographer.lens.project((points - second.centre) @ second.cam_from_world.T)
    inside = np.all((pixels > 2) & (pixels < (318, 238)), axis=1) & np.isfinite(depth.ravel())
    near = np.linalg.norm(points - first.centre, axis=1) < 3.0
    chosen = inside & near
    assert chosen.sum() > 2000
    column, row = np.floor(pixels[chosen]).astype(int).T
    here, there = np.log(light.reshape(-1, 3)[chosen, 1]), np.log(other[row, column, 1])
    assert np.corrcoef(here, there)[0, 1] > 0.8
    assert np.corrcoef(here, np.log(other[row, (column + 8) % 320, 1]))[0, 1] < 0.7


def test_the_same_seed_gives_the_same_bytes_and_another_seed_others(cave: SyntheticCave, tmp_path: Path) -> None:
    first, again, other = (
        [path.read_bytes() for path in photograph(cave, tmp_path / name, replace(THREE, seed=seed))]
        for name, seed in (("a", 0), ("b", 0), ("c", 1))
    )
    assert first == again
    assert first != other


def test_a_video_has_the_frames_asked_for_and_repeats(cave: SyntheticCave, tmp_path: Path) -> None:
    import cv2

    options = replace(THREE, capture=CaptureOptions("sweep", 12))
    video, again = (film(cave, tmp_path / name, options) for name in "ab")
    assert video.read_bytes() == again.read_bytes()
    reader = cv2.VideoCapture(str(video))
    truth = json.loads((tmp_path / "a" / "truth.json").read_text())["cameras"]
    seconds = truth[-1]["time"] - truth[0]["time"]
    assert reader.get(cv2.CAP_PROP_FPS) == pytest.approx(11 / seconds, rel=1e-3)
    frames = []
    while (found := reader.read())[0]:
        frames.append(found[1])
    assert [frame.shape for frame in frames] == [(72, 96, 3)] * 12
    assert len(truth) == 12
    photographer = Photographer(cave.mesh, options)
    light, _ = photographer.expose(plan_capture(cave.centreline, options.capture)[5])
    grey = frames[5].mean(axis=2).ravel()
    assert np.corrcoef(grey, np.cbrt(light.mean(axis=2)).ravel())[0, 1] > 0.9


def test_stations_are_not_filmed(cave: SyntheticCave, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="continuous swim"):
        film(cave, tmp_path, THREE)


def test_a_second_dive_replaces_the_first_and_leaves_other_files_alone(cave: SyntheticCave, tmp_path: Path) -> None:
    photograph(cave, tmp_path, THREE, with_depth=True)
    (tmp_path / "notes.txt").write_text("mine")
    photograph(cave, tmp_path, replace(THREE, camera=replace(SMALL, first_number=5)))
    kept = {path.name for path in tmp_path.iterdir()}
    truths = {"positions.csv", "truth.json", "truth_water.ply", "truth_wall.ply"}
    assert kept == {"IMG_0005.JPG", "IMG_0006.JPG", "IMG_0007.JPG", "notes.txt"} | truths


@pytest.mark.parametrize("condition", CONDITIONS)
def test_every_condition_gives_photos_one_can_see_something_in(condition: ConditionName, cave: SyntheticCave) -> None:
    dive = CONDITIONS[condition].dive
    camera = replace(dive.camera, width=96, height=72)
    shots = plan_capture(cave.centreline, dive.capture)
    assert 40 <= len(shots) <= 150
    light, depth = Photographer(cave.mesh, replace(dive, camera=camera)).expose(shots[len(shots) // 2])
    assert np.isfinite(light).all()
    assert light.std() > 0.0
    assert np.isfinite(depth).mean() > 0.5


@pytest.mark.parametrize(
    "wrong",
    [
        {"width": 10},
        {"focal_35mm": -1},
        {"noise": -1.0},
        {"exposure_s": 0.0},
        {"quality": 100},
        {"first_number": 10_000},
        {"max_gain": 0.0},
    ],
)
def test_impossible_cameras_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=r"CameraOptions|quality|first_number"):
        CameraOptions(**wrong)  # type: ignore[arg-type]


def test_more_than_all_texture_is_refused() -> None:
    with pytest.raises(ValueError, match="texture = 2"):
        DiveOptions(texture=2.0)
