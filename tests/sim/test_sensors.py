from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array
from tests.caves import SECTIONS, TUBE_LENGTH, TUBE_RADIUS
from tests.sim.batch.worlds import look_from, make_world


def state_at(position: Array, yaw: float) -> Array:
    return np.array([*position, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2), 0, 0, 0, 0, 0, 0])


def tube_distances(position: Array, yaw: float) -> Array:
    """Where the rays meet a round tube with flat ends, in closed form."""
    pattern = original_pattern()
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    rays = pattern.directions @ turn.T
    a = (rays[:, 1:] ** 2).sum(axis=1)
    b = rays[:, 1:] @ position[1:]
    c = position[1:] @ position[1:] - TUBE_RADIUS**2
    with np.errstate(divide="ignore"):
        to_wall = (-b + np.sqrt(b * b - a * c)) / a
        to_end = (np.where(rays[:, 0] > 0, TUBE_LENGTH, 0.0) - position[0]) / rays[:, 0]
    return np.minimum(np.minimum(to_wall, np.where(to_end > 0, to_end, np.inf)), pattern.lengths)


def test_pattern_is_the_originals(data_dir: Path) -> None:
    contract = json.loads((data_dir / "saferlauv" / "contract.json").read_text())
    rays = [ray for sensor in contract["auv_sensors"] for ray in sensor["rays"]]
    pattern = original_pattern()
    np.testing.assert_allclose(pattern.directions, [ray["dir_body_flu"] for ray in rays], atol=1e-6)  # its digits
    np.testing.assert_allclose(pattern.lengths, [ray["length_m"] for ray in rays], atol=1e-5)


def test_pattern_is_the_same_on_the_left_and_on_the_right() -> None:
    rays = original_pattern().directions
    mirrored = rays * [1, -1, 1]
    gaps = np.linalg.norm(rays[:, None] - mirrored[None], axis=2).min(axis=0)
    assert gaps.max() < 1e-12


def test_each_fan_starts_ahead_then_goes_right_before_left() -> None:
    rays = original_pattern().directions
    for first in (0, 9, 18, 23):
        assert rays[first, 1] == 0
        assert rays[first + 1, 1] < 0 < rays[first + 2, 1]


@pytest.mark.parametrize(("x", "y", "z", "yaw"), [(10, 0, 0, 0), (1.5, 0.7, -0.9, 2.5), (18.8, -1.2, 0.3, -0.4)])
def test_distances_are_those_of_a_round_tube(tube: Scenario, x: float, y: float, z: float, yaw: float) -> None:
    world = make_world(tube, load_vehicle("bluerov2"), 1, rays="mesh")
    position = np.array([x, y, z], dtype=np.float64)
    look_from(world, state_at(position, yaw)[None])
    (sensed,) = world.as_numpy("rays")
    expected = tube_distances(position, yaw)
    # The tube is a 64-gon: its wall is up to R (1 - cos(pi / 64)) nearer, and seen at a slant by at most 1 / 0.25.
    assert np.all(sensed <= expected + 1e-5)
    assert np.all(sensed >= expected - TUBE_RADIUS * (1 - np.cos(np.pi / SECTIONS)) / 0.2)
