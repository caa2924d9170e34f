"""Dead reckoning against where the simulated vehicle is."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.observation import layout
from aquanav_tools.evaluate.reckoning import NEAR_GOAL, DeadReckoning, Fix
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Array, rotation_matrix, yaw_quaternion

DECISION = 0.1
"""s."""


def slices(observation: npt.NDArray[np.float32]) -> dict[str, Array]:
    return {name: observation[part].astype(np.float64) for name, part in layout("full").items()}


def heading(quaternion: Array) -> float:
    bow = rotation_matrix(quaternion)[:, 0]
    return float(np.arctan2(bow[1], bow[0]))


def errors(fix: Fix, state: Array, begun: Array) -> tuple[float, float]:
    """Return how far a fix is from the truth: m, and degrees of heading."""
    yaw = heading(begun[3:7])
    truth = rotation_matrix(yaw_quaternion(-yaw)) @ (state[:3] - begun[:3])
    turned = (heading(state[3:7]) - yaw - heading(fix.quaternion) + np.pi) % (2 * np.pi) - np.pi
    return float(np.linalg.norm(fix.position - truth)), float(np.degrees(abs(turned)))


@pytest.mark.parametrize("seed", [0, 1])
def test_a_vehicle_that_turns_and_drifts_is_followed(seed: int, tube: Scenario) -> None:
    env, reckoning, rng = CaveEnv(tube), DeadReckoning(DECISION), np.random.default_rng(seed)
    for episode in range(2):  # the second begins anew
        observation, _ = env.reset(seed=seed + 10 * episode, options={"start": 0})
        begun, worst = env.state.copy(), (0.0, 0.0)
        reckoning.reset()
        action = np.array([1, 1, 2])
        for _ in range(150):
            read = slices(observation)
            found = errors(reckoning(read), env.state, begun)
            if float(read["goal"][0]) > 0.2:  # 2.5 m
                worst = (max(worst[0], found[0]), max(worst[1], found[1]))
            action = rng.integers(3, size=3) if rng.random() < 0.3 else action
            observation, _, ended, truncated, _ = env.step(action)
            if ended or truncated:
                break
        assert worst[0] < 0.1  # by the gyroscope alone, read as often: 1 m
        assert worst[1] < 1.0  # and 15 to 30 degrees
    env.close()


def test_beside_the_goal_the_gyroscope_tells_the_heading() -> None:
    """Its bearing there would turn a vehicle that only drifts past."""
    reckoning = DeadReckoning(DECISION)
    still = {"velocity": np.zeros(3), "rates": np.zeros(3), "tilt": np.zeros(2)}
    share = 0.5 * NEAR_GOAL / (0.5 * NEAR_GOAL + 10.0)
    reckoning(still | {"goal": np.array([share, 0.0, 0.0])})
    fix = reckoning(still | {"goal": np.array([share, 0.25, 0.0])})
    assert fix.yaw == 0.0
