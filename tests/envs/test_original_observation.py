"""The 120 floats of the original's policies, against its table (contract.json) worked out in its engine's own axes."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.observation import layout, observation_space
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.sensors import NOTHING, START_WALL, UNTAGGED, WALL, original_pattern
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array, rotation_matrix
from tests.sim.batch.worlds import look_from, make_world

LENGTHS = original_pattern().lengths
SENSORS = (slice(0, 36), slice(36, 72), slice(72, 92), slice(92, 112))
"""The original's obs_0 to obs_3; obs_4 is the rest."""


def observe(tube: Scenario, state: Array, before: Array, goal: Array) -> Array:
    world = make_world(tube, load_vehicle("original-auv"), 1, goal=goal, observation="original")
    world.as_numpy("previous_positions")[:], world.as_numpy("previous_orientations")[:] = before[:3], before[3:7]
    (obs,) = look_from(world, state[None])
    assert observation_space("original").contains(obs)
    return obs.astype(np.float64)


def in_unity(vector: Array) -> Array:
    """A polar vector of the world in the engine's left-handed axes (x right, y up, z ahead)."""
    return np.array([vector[1], vector[2], -vector[0]])


def random_state(rng: np.random.Generator) -> Array:
    quaternion = rng.normal(size=4)
    return np.concatenate([rng.normal(size=3), quaternion / np.linalg.norm(quaternion), rng.normal(size=6)])


def test_it_has_the_originals_parts(data_dir: Path) -> None:
    contract = json.loads((data_dir / "saferlauv" / "contract.json").read_text(encoding="utf-8"))
    assert [part.stop - part.start for part in SENSORS] == [sensor["floats"] for sensor in contract["auv_sensors"]]
    parts = layout("original")
    assert parts["sensors"].stop == 112
    assert parts["motion"].stop - parts["angles"].start == len(contract["auv_vector_observation"]) - 1 + 5


def test_each_ray_has_its_flags_and_the_fraction_of_its_length(tube: Scenario) -> None:
    seen = set()
    for x, yaw in ((1.0, np.pi), (19.0, 0.0), (10.0, 0.0)):  # near the wall behind the start, the goal, and neither
        state = np.array([x, 0, 0, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2), 0, 0, 0, 0, 0, 0.0])
        world = make_world(tube, load_vehicle("original-auv"), 1, observation="original")
        cells = look_from(world, state[None])[0, :112].reshape(28, 4)
        tags, rays = world.as_numpy("tags")[0], world.as_numpy("rays")[0]
        for n, flags in {NOTHING: (0, 0, 1), WALL: (1, 0, 0), START_WALL: (0, 1, 0), UNTAGGED: (0, 0, 0)}.items():
            assert (cells[tags == n, :3] == flags).all()
        np.testing.assert_allclose(cells[:, 3], rays / LENGTHS, atol=1e-6)
        seen |= set(tags.tolist())
    assert seen == {NOTHING, WALL, START_WALL, UNTAGGED}


def test_angles_are_the_formulas_of_the_original_one_step_before(tube: Scenario, rng: np.random.Generator) -> None:
    for _ in range(20):
        state, before, goal = random_state(rng), random_state(rng), 5.0 * rng.normal(size=3)
        rotation = rotation_matrix(before[3:7])
        way, forward, up = (in_unity(v) for v in (goal - before[:3], rotation[:, 0], rotation[:, 2]))
        level = np.array([way[0], 0.0, way[2]]) / np.hypot(way[0], way[2])
        # the engine's cross product has the usual formula in its left-handed axes
        heading = np.degrees(np.arccos(level @ forward)) * np.sign(np.cross(forward, way)[1])
        elevation = np.degrees(np.arcsin(way @ up / np.linalg.norm(way)))
        np.testing.assert_allclose(
            observe(tube, state, before, goal)[112:114], [heading, elevation], rtol=1e-5, atol=1e-4
        )


def test_goal_to_the_right_and_above_reads_positive(tube: Scenario) -> None:
    still = np.array([0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0.0])
    angles = observe(tube, still, still, np.array([1.0, -1.0, np.sqrt(2.0)]))[112:114]
    np.testing.assert_allclose(angles, [45.0, 45.0], atol=1e-4)


def test_motion_is_given_as_unit_vectors_of_the_engines_world(tube: Scenario, rng: np.random.Generator) -> None:
    for _ in range(20):
        state = random_state(rng)
        rotation = rotation_matrix(state[3:7])
        velocity, rate = rotation @ state[7:10], rotation @ state[10:13]
        expected = [in_unity(velocity) / np.linalg.norm(velocity), -in_unity(rate) / np.linalg.norm(rate)]
        np.testing.assert_allclose(observe(tube, state, state, np.ones(3))[114:], np.concatenate(expected), atol=1e-6)


def test_a_turn_to_the_right_is_positive_about_the_engines_up(tube: Scenario) -> None:
    state = np.array([0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, -0.7])  # clockwise seen from above
    np.testing.assert_allclose(observe(tube, state, state, np.ones(3))[117:], [0, 1, 0], atol=1e-7)


def test_a_vehicle_at_rest_at_the_goal_reads_zeros(tube: Scenario) -> None:
    still = np.array([0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0.0])
    np.testing.assert_array_equal(observe(tube, still, still, np.zeros(3))[112:], 0.0)


def test_the_environment_looks_back_one_physics_step(tube: Scenario) -> None:
    env = CaveEnv(tube, observation="original", vehicle="original-auv")
    env.reset(options={"start": 3})
    for _ in range(20):
        obs, *_, info = env.step([0, 0, 2])  # up, left, ahead
    goal = np.array(tube.settings.goal.position)
    now = np.degrees(np.arctan2(goal[1] - info["position"][1], goal[0] - info["position"][0]))
    w, _, _, z = info["orientation"]
    turn = 2.0 * np.arctan2(z, w)
    bearing = np.degrees(turn) - now  # right is positive
    lag = np.degrees(info["velocity"][5] * 0.02)  # the last physics step's turn; the position moves by 4 cm in 11 m
    assert lag > 0.5
    # level but for a degree of tilt, which moves the angle by less than a tenth of a degree
    assert (obs[112] - (bearing - lag) + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.3 * lag)
    env.close()


def test_contacts_and_rewards_do_not_depend_on_how_the_decision_is_cut(tube: Scenario) -> None:
    def swim(observation: str) -> tuple[list[float], Array]:
        env = CaveEnv(tube, observation=observation)
        env.reset(options={"start": 10})
        steps = [env.step([1, 0 if n < 9 else 1, 2]) for n in range(50)]
        env.close()
        assert steps[-1][4]["collision"]
        return [step[1] for step in steps], steps[-1][4]["position"]

    rewards, position = swim("full")
    same_rewards, same_position = swim("original")
    assert rewards == same_rewards
    np.testing.assert_array_equal(position, same_position)
