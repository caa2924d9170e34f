from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.photograph.lens import Lens
from aquanav_tools.photograph.options import CameraOptions
from aquanav_tools.photograph.sensor import MIDDLE_TONE, REFERENCE_EXPOSURE, blur_by_motion, develop, image_motion
from aquanav_tools.photograph.trajectory import Shot, look

LENS = Lens(400, 300, 250.0)


def moving_shot(velocity: tuple[float, float, float], spin: tuple[float, float, float] = (0, 0, 0)) -> Shot:
    return Shot(np.zeros(3), look(0.0, 0.0), 0.0, np.array(velocity, float), np.array(spin, float))


def test_motion_blur_is_speed_times_exposure_times_focal_length_over_distance() -> None:
    # Looking along x, moving left (+y): the rock at 2 m goes to the right.
    motion = image_motion(LENS, moving_shot((0.0, 0.5, 0.0)), np.array([[0.3, 0.1, 2.0]]), 0.04)
    np.testing.assert_allclose(motion, [[0.5 * 0.04 * 250.0 / 2.0, 0.0]], atol=1e-12)


def test_turning_blurs_the_same_at_any_distance() -> None:
    points = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 30.0]])
    motion = image_motion(LENS, moving_shot((0, 0, 0), (0.0, 0.2, 0.0)), points, 0.05)
    np.testing.assert_allclose(motion, [[-0.2 * 0.05 * 250.0, 0.0]] * 2, rtol=1e-4)


def test_swimming_ahead_blurs_away_from_the_middle() -> None:
    points = np.array([[0.0, 0.0, 2.0], [1.0, 0.0, 2.0]])
    motion = image_motion(LENS, moving_shot((0.4, 0.0, 0.0)), points, 0.05)
    np.testing.assert_allclose(motion[0], 0.0, atol=1e-12)
    assert motion[1, 0] == pytest.approx(125.0 * 0.4 * 0.05 / 2.0, rel=1e-4)


@pytest.mark.parametrize("length", [4.0, 11.0])
def test_a_point_of_light_becomes_a_line_as_long_as_the_motion(length: float) -> None:
    light = np.zeros((41, 61, 3), np.float32)
    light[20, 30] = 1.0
    blurred = blur_by_motion(light, np.tile(np.array([length, 0.0]), (41, 61, 1)))[..., 0]
    assert blurred.sum() == pytest.approx(1.0, rel=1e-4)
    profile = blurred[20]
    spread = np.sqrt(np.sum(profile * (np.arange(61) - 30.0) ** 2))
    # A line of that length, with the pixel's own triangle: variance length^2 / 12 + 1 / 6.
    assert spread == pytest.approx(np.sqrt(length**2 / 12 + 1 / 6), rel=0.05)
    assert blurred[[19, 21]].max() < 1e-6


def test_a_photo_is_exposed_for_its_middle_tones_whatever_the_lamp() -> None:
    light = np.random.default_rng(0).uniform(0.5, 1.5, (100, 100, 3)).astype(np.float32)
    options = CameraOptions(noise=0.0, max_gain=1e6)
    bright, faint = (develop(scale * light, options, np.random.default_rng(0)) for scale in (1.0, 1e-3))
    np.testing.assert_array_equal(bright, faint)
    linear = (np.percentile(bright, 65) / 255.0) ** 2.2
    assert linear == pytest.approx(MIDDLE_TONE / (1.0 + 0.4 * MIDDLE_TONE), rel=0.02)  # 8 bits


def test_what_the_gain_cannot_lift_stays_dark_and_a_longer_exposure_helps() -> None:
    light = np.full((50, 50, 3), 1e-4, np.float32)
    short, long = (
        develop(light, CameraOptions(noise=0.0, exposure_s=factor * REFERENCE_EXPOSURE), np.random.default_rng(0))
        for factor in (1, 8)
    )
    assert short.max() < long.max() < 128
    assert (long.mean() / short.mean()) ** 2.2 == pytest.approx(8.0, rel=0.1)  # 8 bits


def test_the_meters_mistakes_have_the_spread_asked_for() -> None:
    light = np.full((8, 8, 3), 0.01, np.float32)
    options = CameraOptions(noise=0.0, exposure_spread_ev=0.3, max_gain=1e6)
    values = [develop(light, options, np.random.default_rng(seed)).mean() / 255.0 for seed in range(300)]
    rolled = np.array(values) ** 2.2
    stops = np.log2(rolled / (1.0 - 0.4 * rolled) / MIDDLE_TONE)
    assert stops.std() == pytest.approx(0.3, rel=0.15)  # 300 samples: 4 % standard error


def test_noise_grows_with_the_gain() -> None:
    light = np.full((100, 100, 3), 1e-2, np.float32)
    spread = [
        develop(scale * light, CameraOptions(max_gain=1e6), np.random.default_rng(0)).std()
        for scale in (1.0, 0.1, 0.01)
    ]
    assert spread[0] < spread[1] < spread[2]
