from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.report.camera import SUPERSAMPLING, Camera, Scene, is_visible, pixel_of, shrink
from aquanav_tools.scenario.schema import Scenario
from tests.caves import TUBE_LENGTH, TUBE_RADIUS

X, Y, Z = np.eye(3)
WIDTH = 400


def pinhole(position: tuple[float, float, float]) -> Camera:
    """Looks along +x with left on the left, 90 degrees wide."""
    return Camera(np.array(position), -Y, Z, 1.0, 4 / 3, is_parallel=False)


def from_above() -> Camera:
    return Camera(np.array([TUBE_LENGTH / 2, 0.0, 10.0]), X, Y, 12.0, 4 / 3, is_parallel=True)


@pytest.mark.parametrize("camera", [pinhole((2.0, 0.0, 0.0)), from_above()])
def test_what_a_ray_hits_is_projected_back_to_its_pixel(tube: Scenario, camera: Camera) -> None:
    shot = Scene(tube.cavity.mesh).look(camera, WIDTH)
    origins, ways = camera.rays(WIDTH)
    rows, columns = np.nonzero(shot.is_hit)
    chosen = slice(None, None, 997)
    rows, columns = rows[chosen], columns[chosen]
    points = origins[rows, columns] + shot.distance[rows, columns, None] * ways[rows, columns]
    pixels, distance = pixel_of(shot, camera, points)
    np.testing.assert_allclose(pixels, np.stack([rows, columns], axis=1) + 0.5, atol=1e-6)
    np.testing.assert_allclose(distance, shot.distance[rows, columns], rtol=1e-6)  # float32 distances


def test_a_camera_on_the_axis_sees_the_far_lid_as_a_small_disc(tube: Scenario) -> None:
    shot = Scene(tube.cavity.mesh).look(pinhole((2.0, 0.0, 0.0)), WIDTH)
    is_lid = shot.is_hit & (tube.cavity.labels[shot.faces] == 2)
    # The lid of radius 2 is 18 m away: 400 / 2 * 2 / 18 pixels across its radius.
    radius = 0.5 * WIDTH * TUBE_RADIUS / (TUBE_LENGTH - 2.0)
    assert is_lid.sum() == pytest.approx(np.pi * radius**2, rel=0.02)  # a 64-sided disc of 22 pixels' radius
    assert shot.distance[is_lid].min() == pytest.approx(18.0, abs=0.01)
    assert shot.facing[is_lid].min() > 0.99


def test_left_is_left_and_up_is_up() -> None:
    camera = pinhole((0.0, 0.0, 0.0))
    flat, _ = camera.project(np.array([[5.0, 1.0, 0.0], [5.0, 0.0, 1.0], [-5.0, 0.0, 0.0]]))
    np.testing.assert_allclose(flat[:2], [[-0.2, 0.0], [0.0, 0.2]], atol=1e-12)
    assert np.isnan(flat[2]).all()  # behind the camera


def test_a_point_behind_the_wall_is_not_visible(tube: Scenario) -> None:
    camera = pinhole((2.0, 0.0, 0.0))
    shot = Scene(tube.cavity.mesh).look(camera, WIDTH)
    points = np.array([[10.0, 0.0, 0.0], [10.0, 1.99, 0.0], [10.0, 2.5, 0.0], [-3.0, 0.0, 0.0], [3.0, 1.9, 0.0]])
    assert is_visible(shot, camera, points, 0.05).tolist() == [True, True, False, False, False]


def test_a_shrunk_picture_keeps_its_mean(rng: np.random.Generator) -> None:
    colours = rng.random((20 * SUPERSAMPLING, 30 * SUPERSAMPLING, 3))
    small = shrink(colours)
    assert small.shape == (20, 30, 3)
    np.testing.assert_allclose(small.mean(axis=(0, 1)), colours.mean(axis=(0, 1)))
