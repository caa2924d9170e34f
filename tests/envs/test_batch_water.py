"""Vehicles in moving water: the batch and PyBullet swim alike, where both are given the same gusts and eddies."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.vector_env import CaveVectorEnv
from aquanav_tools.scenario.schema import LimitSettings, Scenario
from tests.bullet import needs_bullet
from tests.caves import TUBE_RADIUS
from tests.envs.test_vector_env import wander
from tests.sim.test_water import flowing

WIDTH = 2.0 * TUBE_RADIUS


@pytest.mark.parametrize("current", ["half", "full"])
@pytest.mark.parametrize("vehicle", ["bluerov2", "original-auv"])
def test_a_swim_of_200_decisions_in_moving_water_is_pybullets_to_the_bit(current: str, vehicle: str) -> None:
    """Away from walls, nothing differs between the engines for contacts."""
    options: dict[str, Any] = {"vehicle": vehicle, "action": "continuous", "reward": "safe", "current": current}
    alone, together = CaveEnv(flowing(), **options), CaveVectorEnv(2, flowing(), rays="mesh", **options)
    obs, _ = together.reset(seed=1, options={"start": 9})
    seen, info = alone.reset(seed=1, options={"start": 9})
    rng, paces = np.random.default_rng(0), np.array([0.5, 1.0, 0.5], dtype=np.float32)
    fastest = 0.0
    for _ in range(200):
        action = wander(seen[None], rng, 0.3)[0] * paces
        action[2] += 0.5 * float(seen[28] < 0.4)  # not past the goal
        obs, rewards, _, _, infos = together.step(np.tile(action, (2, 1)))
        seen, reward, _, _, info = alone.step(action)
        assert not info["collision"]
        np.testing.assert_array_equal(obs[0], seen)
        np.testing.assert_array_equal(infos["position"][0], info["position"])
        assert rewards[0] == reward
        fastest = max(fastest, float(np.linalg.norm(info["current"])))
    assert fastest > 0.2 * {"half": 0.25, "full": 0.5}[current]  # it did flow
    assert not np.array_equal(infos["position"][0], infos["position"][1])  # each has water of its own
    alone.close()
    together.close()


def fly_together(scenario: Scenario, starts: np.ndarray, wildness: float, **options: Any) -> list[str]:
    """Return the outcomes of episodes in a batch."""
    num = len(starts)
    env = CaveVectorEnv(num, scenario, action="continuous", autoreset_mode=AutoresetMode.SAME_STEP, **options)
    streams = [np.random.default_rng([1, n]) for n in range(num)]
    obs, _ = env.reset(seed=0, options={"start": starts})
    outcomes = ["running"] * num
    while "running" in outcomes:
        actions = np.concatenate([wander(row[None], rng, wildness) for row, rng in zip(obs, streams, strict=True)])
        obs, _, terminated, truncated, infos = env.step(actions)
        for n in np.flatnonzero(terminated | truncated):
            if outcomes[n] == "running":
                outcomes[n] = str(infos["final_info"]["outcome"][n])
    env.close()
    return outcomes


def fly_alone(scenario: Scenario, starts: np.ndarray, wildness: float, **options: Any) -> list[str]:
    """Return the outcomes of the same episodes with PyBullet's contacts."""
    env = CaveEnv(scenario, action="continuous", contacts="bullet", **options)
    outcomes = []
    for n, start in enumerate(starts):
        rng = np.random.default_rng([1, n])
        obs, info = env.reset(seed=n, options={"start": int(start)})
        while info["outcome"] == "running":
            obs, _, _, _, info = env.step(wander(obs[None], rng, wildness)[0])
        outcomes.append(info["outcome"])
    env.close()
    return outcomes


def share_of_equal_outcomes(num: int, current: str) -> float:
    """Return how many of so many episodes, each of which a contact ends, end alike."""
    settings = dataclasses.replace(flowing().settings, limits=LimitSettings(decisions=220))
    scenario = dataclasses.replace(flowing(), settings=settings)
    starts = np.arange(num) % len(scenario.starts)
    options: dict[str, Any] = {"on_collision": "end", "current": current, "rays": "field"}
    together = fly_together(scenario, starts, 0.9, **options)
    alone = fly_alone(scenario, starts, 0.9, **options)
    assert len(set(alone)) > 1, f"all episodes end in {alone[0]}: they say little"
    return float(np.mean([a == b for a, b in zip(alone, together, strict=True)]))


@needs_bullet
def test_a_policy_fares_in_moving_water_as_in_pybullet() -> None:
    assert share_of_equal_outcomes(25, "full") >= 0.96  # one of 25 may differ


@needs_bullet
@pytest.mark.slow
@pytest.mark.parametrize("current", ["half", "full"])
def test_a_policy_fares_in_moving_water_as_in_pybullet_in_98_of_100_episodes(current: str) -> None:
    share = share_of_equal_outcomes(500, current)
    print(f"{current}: {share:.3f} of 500 episodes end alike")
    assert share >= 0.98
