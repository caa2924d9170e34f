from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.sensors import NOTHING, START_WALL, UNTAGGED, WALL, original_pattern
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array
from tests.caves import TUBE_LENGTH, TUBE_RADIUS, tube_clearance
from tests.sim.batch.worlds import look_from, make_world

PATTERN = original_pattern()


def cast(tube: Scenario, position: Array, yaw: float) -> tuple[Array, Array]:
    """Return how far the spheres come, m, and what they meet."""
    world = make_world(tube, load_vehicle("original-auv"), 1, observation="original")
    look_from(world, state_at(position, yaw)[None])
    return world.as_numpy("rays")[0], world.as_numpy("tags")[0]


def state_at(position: Array, yaw: float) -> Array:
    return np.array([*position, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2), 0, 0, 0, 0, 0, 0])


def tube_casts(position: Array, yaw: float) -> tuple[Array, Array]:
    """How far spheres come in a round tube with flat ends, and what stops them, in closed form: the wall moves inwards
    by the sphere's radius."""
    turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    rays, radii = PATTERN.directions @ turn.T, PATTERN.radii
    a = (rays[:, 1:] ** 2).sum(axis=1)
    b = rays[:, 1:] @ position[1:]
    c = position[1:] @ position[1:] - (TUBE_RADIUS - radii) ** 2
    with np.errstate(divide="ignore"):
        to_wall = (-b + np.sqrt(b * b - a * c)) / a
        to_end = (np.where(rays[:, 0] > 0, TUBE_LENGTH - radii, radii) - position[0]) / rays[:, 0]
    to_end = np.where(to_end > 0, to_end, np.inf)
    ends = np.where(rays[:, 0] > 0, UNTAGGED, START_WALL)
    nearest = np.minimum(to_wall, to_end)
    tags = np.where(nearest >= PATTERN.lengths, NOTHING, np.where(to_end < to_wall, ends, WALL))
    return np.minimum(nearest, PATTERN.lengths), tags


def test_radii_are_the_originals(data_dir: Path) -> None:
    contract = json.loads((data_dir / "saferlauv" / "contract.json").read_text(encoding="utf-8"))
    radii = [ray["sphere_radius_m"] for part in contract["auv_sensors"] for ray in part["rays"]]
    np.testing.assert_allclose(PATTERN.radii, radii, atol=1e-5)  # its digits


@pytest.mark.parametrize("yaw", [0.0, 2.0, np.pi])
def test_spheres_stop_where_the_wall_is_their_radius_away(tube: Scenario, rng: np.random.Generator, yaw: float) -> None:
    for _ in range(20):
        aside, angle = rng.uniform(0.0, 1.5), rng.uniform(0, 2 * np.pi)
        position = np.array([rng.uniform(1.0, 19.0), aside * np.cos(angle), aside * np.sin(angle)])
        distances, tags = tube_casts(position, yaw)
        seen, seen_tags = cast(tube, position, yaw)
        turn = np.array([[np.cos(yaw), -np.sin(yaw), 0], [np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        places = position + seen[:, None] * (PATTERN.directions @ turn.T)
        gaps = np.abs(tube_clearance(places) - PATTERN.radii)[tags != NOTHING]
        # A field of 0.1 m errs by 0.0019 m beside a wall of radius 2 m, and by 0.44 spacings at most, in corners.
        assert gaps.max() < 0.05
        assert np.median(gaps) < 0.003
        assert np.abs(seen - distances).max() < 0.05 / np.sin(
            np.deg2rad(14.0)
        )  # rays meet a wall at 14.9 degrees or more
        assert (seen_tags == tags).mean() > 0.9


def test_the_wall_behind_the_start_and_an_end_without_tag_are_told_apart(tube: Scenario) -> None:
    assert cast(tube, np.array([1.0, 0, 0]), np.pi)[1][0] == START_WALL
    assert cast(tube, np.array([19.0, 0, 0]), 0.0)[1][0] == UNTAGGED
    tags = cast(tube, np.array([10.0, 0, 0]), 0.0)[1]
    assert tags[0] == NOTHING
    assert tags[7] == tags[8] == WALL  # to the right and to the left
