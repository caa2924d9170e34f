from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.cave.synthetic.caves import SyntheticCave, tube
from aquanav_tools.reconstruct.capture import CaptureOptions, look, plan_capture
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.render import RayScene, RenderOptions, pixel_rays, render_photos
from tests.reconstruct.scenes import true_centres


def test_a_level_camera_looking_along_x_has_right_at_minus_y_and_down_at_minus_z() -> None:
    np.testing.assert_allclose(look(0.0, 0.0), [[0, -1, 0], [0, 0, -1], [1, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(look(0.0, 0.4)[2], [np.cos(0.4), 0.0, np.sin(0.4)])
    np.testing.assert_allclose(look(0.3, 0.2, 0.1) @ look(0.3, 0.2, 0.1).T, np.eye(3), atol=1e-12)


def test_five_photos_are_taken_at_every_station_inside_the_passage() -> None:
    cave = tube(2.0, 10.0)
    cameras = plan_capture(cave.centreline, CaptureOptions(stations=5))
    centres = np.array([camera.centre for camera in cameras])
    assert len(cameras) == 25
    assert np.linalg.norm(centres[:, 1:], axis=1).max() < 0.5


def test_rays_meet_a_tube_at_its_radius_with_normals_out_of_the_water() -> None:
    scene = RayScene(tube(2.0, 20.0).mesh)
    across = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -2.0], [1.0, 0.0, 0.0]])
    steps, normals = scene.cast(np.array([10.1, 0.0, 0.0]), across)
    np.testing.assert_allclose(steps[:2], [2.0, 1.0], rtol=2e-3)  # the chord of a 64-gon is 0.12 % nearer
    np.testing.assert_allclose(normals[:2], [[0, 1, 0], [0, 0, -1]], atol=0.05)
    assert np.isnan(steps[2])


def test_pixel_rays_pass_through_pixel_centres() -> None:
    rays = pixel_rays(4, 2, 10.0)
    np.testing.assert_allclose(rays[0], [-0.15, -0.05, 1.0])
    np.testing.assert_allclose(rays[-1], [0.15, 0.05, 1.0])


def test_positions_file_lists_the_true_camera_of_every_photo(small_photos: tuple[SyntheticCave, PhotoSet]) -> None:
    _, photos = small_photos
    rows = list(csv.DictReader((photos.folder / "positions.csv").open()))
    assert [row["name"] for row in rows] == photos.names
    listed = np.array([[float(row[axis]) for axis in "xyz"] for row in rows])
    np.testing.assert_allclose(listed, true_centres(photos.folder, tuple(photos.names)), atol=1e-4)


def test_photos_are_lit_in_the_middle_and_textured(small_photos: tuple[SyntheticCave, PhotoSet]) -> None:
    _, photos = small_photos
    for name in photos.names:
        grey = np.asarray(Image.open(photos.path(name)).convert("L"), dtype=float)
        assert 40 < grey.mean() < 200
        assert np.abs(np.diff(grey, axis=1)).mean() > 2.0


def test_the_same_seed_gives_the_same_photos_and_another_seed_others(tmp_path: Path) -> None:
    cave = tube(1.5, 8.0)
    options = RenderOptions(width=96, height=72, capture=CaptureOptions(stations=1))
    first = [p.read_bytes() for p in sorted(render_photos(cave, tmp_path / "a", options).folder.glob("*.jpg"))]
    again = [p.read_bytes() for p in sorted(render_photos(cave, tmp_path / "b", options).folder.glob("*.jpg"))]
    other = render_photos(cave, tmp_path / "c", replace(options, seed=1))
    assert first == again
    assert first != [p.read_bytes() for p in sorted(other.folder.glob("*.jpg"))]


@pytest.mark.parametrize("wrong", [{"width": 10}, {"focal_35mm": 0}, {"noise": -1.0}])
def test_impossible_cameras_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="RenderOptions"):
        RenderOptions(**wrong)  # type: ignore[arg-type]
