"""What every scenario's environment must keep, also those that ship; these take minutes to build and to try."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from typing import Any

import igl
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from stable_baselines3.common.env_checker import check_env as check_env_for_sb3

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario, WaterSettings
from aquanav_tools.scenario.shipped import CONTENT
from aquanav_tools.shipped import shipped_names
from aquanav_tools.types import Array, rotation_matrix, yaw_quaternion
from tests.caves import tube_scenario
from tests.envs.steps import random_steps
from tests.evaluate.winding import winding_scenario
from tests.shipped_caves import shipped_caves

SCENARIOS: dict[str, Callable[[], Scenario]] = {
    "tube": tube_scenario,
    "tube with a current": lambda: tube_scenario(water=WaterSettings(current=(0.3, -0.1, 0.05))),
    "winding": winding_scenario,
}
SHIPPED = shipped_names(CONTENT)
DISTURBED = {
    "sensor_noise": 0.05,
    "sensor_dropout": 0.1,
    "action_delay": 1,
    "observation_delay": 2,
    "current_range": (0.5, 1.5),
    "starts": "anywhere",
}
SPEED = 3.0
"""m/s."""


@pytest.fixture(scope="module", params=[*SCENARIOS, *shipped_caves()])
def scenario(request: pytest.FixtureRequest) -> Scenario:
    return read_scenario(request.param) if request.param in SHIPPED else SCENARIOS[request.param]()


@pytest.fixture(scope="module")
def env(scenario: Scenario) -> Iterator[CaveEnv]:
    env = CaveEnv(scenario, max_decisions=200)
    yield env
    env.close()


def assert_sound(env: CaveEnv, count: int) -> None:
    for obs, reward, _, _, info in random_steps(env, count, 0):
        assert env.observation_space.contains(obs)
        assert np.isfinite(reward)
        assert np.isfinite(info["position"]).all()
        assert np.isfinite(info["velocity"]).all()
        assert 0.0 <= info["progress"] <= env.scenario.guide.length


@pytest.mark.parametrize("observation", ["paper", "full", "original"])
@pytest.mark.parametrize("disturbed", [False, True], ids=["plain", "disturbed"])
def test_the_checkers_of_gymnasium_and_sb3_accept_it(scenario: Scenario, observation: str, disturbed: bool) -> None:
    env = CaveEnv(scenario, observation=observation, **(DISTURBED if disturbed else {}))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env, skip_render_check=True)
        check_env_for_sb3(env)
    env.close()


@pytest.mark.parametrize("options", [{}, DISTURBED], ids=["plain", "disturbed"])
def test_a_seed_repeats_bit_for_bit(scenario: Scenario, options: dict[str, Any]) -> None:
    first, second = CaveEnv(scenario, **options), CaveEnv(scenario, **options)
    list(random_steps(second, 30, 9))
    for one, other in zip(random_steps(first, 150, 4), random_steps(second, 150, 4), strict=True):
        np.testing.assert_array_equal(one[0], other[0])
        assert one[1:4] == other[1:4]
        for name, value in one[4].items():
            np.testing.assert_array_equal(value, other[4][name])
    first.close()
    second.close()


def test_observations_are_in_the_space_and_everything_is_finite(env: CaveEnv) -> None:
    assert_sound(env, 600)


@pytest.mark.slow
@pytest.mark.nightly
def test_nothing_becomes_nan_in_a_million_random_steps(env: CaveEnv) -> None:
    assert_sound(env, 1_000_000)


def test_no_element_of_the_observation_is_constant(env: CaveEnv) -> None:
    seen = np.array([step[0] for seed in range(4) for step in random_steps(env, 150, seed)])
    assert (np.ptp(seen, axis=0) > 0.0).all()


def outward() -> Array:
    """26 directions, 35 to 55 degrees apart."""
    ways = np.array([way for way in np.ndindex(3, 3, 3) if way != (1, 1, 1)]) - 1.0
    return ways / np.linalg.norm(ways, axis=1, keepdims=True)


def places_of(scenario: Scenario) -> Array:
    """Places along the route; in a shipped scenario all its panels, and its starts, which lie in dead ends as well."""
    centres = scenario.guide.centres
    if scenario.name in SHIPPED:
        return np.concatenate([centres, [start.pose.position for start in scenario.starts]])
    return centres[np.linspace(0, len(centres) - 1, 5).astype(int)]


def push(env: CaveEnv, place: Array, way: Array) -> tuple[Array, bool]:
    """Push the vehicle at SPEED for 1.5 s; return where it went, and whether it touched."""
    env.reset(seed=0)
    arrays = env._arrays
    arrays["positions"][0], arrays["orientations"][0] = place, yaw_quaternion(float(np.arctan2(way[1], way[0])))
    positions, is_touched = [], False
    for _ in range(15):
        arrays["velocities"][0, :3] = rotation_matrix(arrays["orientations"][0]).T @ (SPEED * way)
        info = env.step([1, 1, 2])[4]
        positions.append(info["position"])
        is_touched |= info["collision"]
    return np.array(positions), is_touched


def test_a_vehicle_pushed_against_every_wall_never_gets_out(env: CaveEnv) -> None:
    mesh = env.scenario.cavity.mesh
    trajectories, touches = [], []
    for place in places_of(env.scenario):
        for way in outward():
            positions, is_touched = push(env, place, way)
            trajectories.append(positions)
            touches.append(is_touched)
    places = np.concatenate(trajectories)
    if env.scenario.name == "winding":  # its distance field knows no lids, see there
        places = places[(places[:, 0] > 0.5) & (places[:, 0] < 24.5)]
    assert igl.fast_winding_number(mesh.vertices, mesh.faces, places).min() > 0.5
    assert np.mean(touches) > 0.6  # along the passage 4.5 m reach no wall
