from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.sim.batch.sensors.dvl import DopplerLog
from tests.sim.batch.sensors.rooms import random_poses, room_batch

ANGLE = np.radians(30.0)
PERFECT = {"beam_angle_deg": 30.0, "max_range": 50.0}
"""A roll by 40 degrees about the room's middle brings two of the beams past the floor's edge."""


def velocities(rng: np.random.Generator, num: int) -> np.ndarray:
    """Return (N, 6) body-frame velocities."""
    return rng.uniform(-1.0, 1.0, (num, 6))


@pytest.mark.parametrize("source", ["mesh", "field"])
def test_without_errors_it_reads_the_velocity_in_the_body_frame(source: str, rng: np.random.Generator) -> None:
    positions, turns = random_poses(rng, 30)
    moving = velocities(rng, 30)
    read = DopplerLog(PERFECT).measure(room_batch(source, positions=positions, orientations=turns, velocities=moving))
    assert np.allclose(read[:, :3], moving[:, :3], atol=1e-6)
    assert np.array_equal(read[:, 4], np.ones(30))


def test_over_a_level_floor_it_reads_the_height_above_it() -> None:
    read = DopplerLog(PERFECT).measure(room_batch(positions=[[0.0, 0.0, 0.5], [1.0, 1.0, -1.0]]))
    assert np.allclose(read[:, 3], [3.5, 2.0], atol=1e-5)


def test_noise_along_the_beams_becomes_the_least_squares_noise_of_the_axes() -> None:
    """Four beams at an angle a: sigma / (sqrt(2) sin a) level, sigma / (2 cos a) upright."""
    num, noise = 20_000, 0.02
    log = DopplerLog({**PERFECT, "noise": noise})
    read = log.measure(room_batch(positions=np.zeros((num, 3)), seeds=np.arange(num)))[:, :3]
    level, upright = noise / (np.sqrt(2.0) * np.sin(ANGLE)), noise / (2.0 * np.cos(ANGLE))
    assert np.allclose(read.std(axis=0), [level, level, upright], rtol=5 / np.sqrt(2 * num))


def test_scale_and_bias_stay_for_an_episode_and_differ_between_devices() -> None:
    num = 20_000
    log = DopplerLog({**PERFECT, "scale_error": 0.01, "bias": 0.002})
    moving = np.tile([1.0, 0.0, 0.0, 0.0, 0.0, 0.0], (num, 1))
    batch = room_batch(positions=np.zeros((num, 3)), seeds=np.arange(num), velocities=moving)
    first = log.measure(batch).copy()
    batch.state.decisions.fill_(7)
    assert np.array_equal(log.measure(batch), first)
    expected = [np.hypot(0.01, 0.002), 0.002, 0.002]
    assert np.allclose(first[:, :3].std(axis=0), expected, rtol=5 / np.sqrt(2 * num))


def test_three_beams_are_enough_and_two_are_not(rng: np.random.Generator) -> None:
    """Near a corner of the room, over a floor too far: a beam that meets a wall before is within range."""
    positions = np.array([[5.4, 3.4, 0.0], [5.4, 0.0, 0.0], [0.0, 0.0, 0.0]])  # 3, 2 and none of the beams meet a wall
    moving = velocities(rng, 3)
    read = DopplerLog({**PERFECT, "max_range": 3.0}).measure(room_batch(positions=positions, velocities=moving))
    assert np.array_equal(read[:, 4], [1.0, 0.0, 0.0])
    assert np.allclose(read[0, :3], moving[0, :3], atol=1e-6)
    assert np.array_equal(read[1:], np.zeros((2, 5)))


def test_too_near_and_too_fast_are_no_lock() -> None:
    log = DopplerLog({**PERFECT, "min_range": 1.0, "max_speed": 2.0})
    moving = [[0, 0, 0, 0, 0, 0], [2.1, 0, 0, 0, 0, 0], [1.9, 0, 0, 0, 0, 0]]
    read = log.measure(room_batch(positions=[[0, 0, -2.5], [0, 0, 0], [0, 0, 0]], velocities=moving))
    assert np.array_equal(read[:, 4], [0.0, 0.0, 1.0])
    assert np.array_equal(read[:2], np.zeros((2, 5)))
    assert all(log.spec(None, None).contains(row) for row in read)  # type: ignore[arg-type]  # it needs neither


def test_the_sheet_that_ships_is_refused_with_an_impossible_beam() -> None:
    assert DopplerLog("a50").data.beam_angle_deg == 22.5
    with pytest.raises(InputError, match=r"beam_angle_deg = 0.0, which must be from 5 to 60"):
        DopplerLog({**PERFECT, "beam_angle_deg": 0.0})
