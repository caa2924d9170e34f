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
from tests.caves import TUBE_RADIUS
from tests.envs.test_vector_env import wander
from tests.sim.test_water import flowing

WIDTH = 2.0 * TUBE_RADIUS


class SharedWater:
    """Gives PyBullet's water the coefficients that a batch's vehicle had, decision by decision."""

    def __init__(self, env: CaveEnv) -> None:
        self._env, self._water = env, env._water
        self.next: np.ndarray = self._water._coefficients
        self._water.advance = lambda dt: self._take()  # type: ignore[method-assign]

    def begin(self, first: np.ndarray) -> None:
        """Replace what `reset` drew."""
        self.next = first
        self._take()
        self._env._current = self._water.velocity(self._env.state[:3])

    def _take(self) -> None:
        self._water._coefficients[:] = self.next


@pytest.mark.parametrize("current", ["half", "full"])
@pytest.mark.parametrize("vehicle", ["bluerov2", "original-auv"])
def test_a_swim_of_200_decisions_in_moving_water_is_pybullets(current: str, vehicle: str) -> None:
    options: dict[str, Any] = {"vehicle": vehicle, "action": "continuous", "reward": "safe", "current": current}
    alone, together = CaveEnv(flowing(), **options), CaveVectorEnv(2, flowing(), rays="mesh", **options)
    obs, _ = together.reset(seed=1, options={"start": 9})
    eddies, moved = together.batch.view_of("eddies"), together.batch.view_of("currents")
    seen, _ = alone.reset(options={"start": 9})
    water = SharedWater(alone)
    water.begin(eddies[0])
    rng, paces = np.random.default_rng(0), np.array([0.5, 1.0, 0.5], dtype=np.float32)
    fastest = 0.0
    for _ in range(200):
        action = wander(seen[None], rng, 0.3)[0] * paces
        action[2] += 0.5 * float(seen[28] < 0.4)  # not past the goal
        flowed = alone.water_velocity
        obs, _, _, _, infos = together.step(np.tile(action, (2, 1)))
        seen, _, _, _, info = alone.step(action)
        assert not info["collision"]
        assert np.abs(moved[0] - flowed).max() < 1e-5
        assert np.abs(infos["position"][0] - info["position"]).max() < 1e-4 * WIDTH
        assert np.abs(obs[0] - seen).max() < 1e-3
        fastest = max(fastest, float(np.linalg.norm(flowed)))
    assert fastest > 0.2 * {"half": 0.25, "full": 0.5}[current]  # it did flow
    alone.close()
    together.close()


def fly_together(scenario: Scenario, starts: np.ndarray, wildness: float, **options: Any) -> tuple[list[str], Any]:
    """Return the outcomes of episodes in a batch, and the (T, N, C) coefficients of their water."""
    num = len(starts)
    env = CaveVectorEnv(num, scenario, action="continuous", autoreset_mode=AutoresetMode.SAME_STEP, **options)
    streams = [np.random.default_rng([1, n]) for n in range(num)]
    obs, _ = env.reset(seed=0, options={"start": starts})
    outcomes, waters = ["running"] * num, [env.batch.copy_of("eddies")]
    while "running" in outcomes:
        actions = np.concatenate([wander(row[None], rng, wildness) for row, rng in zip(obs, streams, strict=True)])
        obs, _, terminated, truncated, infos = env.step(actions)
        waters.append(env.batch.copy_of("eddies"))
        for n in np.flatnonzero(terminated | truncated):
            if outcomes[n] == "running":
                outcomes[n] = str(infos["final_info"]["outcome"][n])
    env.close()
    return outcomes, np.array(waters)


def fly_alone(scenario: Scenario, starts: np.ndarray, wildness: float, waters: Any, **options: Any) -> list[str]:
    """Return the outcomes of the same episodes in PyBullet, in the same water."""
    env = CaveEnv(scenario, action="continuous", **options)
    water = SharedWater(env)
    outcomes = []
    for n, start in enumerate(starts):
        rng = np.random.default_rng([1, n])
        obs, info = env.reset(options={"start": int(start)})
        water.begin(waters[0, n])
        decision = 0
        while info["outcome"] == "running":
            decision += 1
            water.next = waters[min(decision, len(waters) - 1), n]
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
    together, waters = fly_together(scenario, starts, 0.9, **options)
    del options["rays"]
    alone = fly_alone(scenario, starts, 0.9, waters, **options)
    assert len(set(alone)) > 1, f"all episodes end in {alone[0]}: they say little"
    return float(np.mean([a == b for a, b in zip(alone, together, strict=True)]))


def test_a_policy_fares_in_moving_water_as_in_pybullet() -> None:
    assert share_of_equal_outcomes(25, "full") >= 0.96  # one of 25 may differ


@pytest.mark.slow
@pytest.mark.parametrize("current", ["half", "full"])
def test_a_policy_fares_in_moving_water_as_in_pybullet_in_98_of_100_episodes(current: str) -> None:
    share = share_of_equal_outcomes(500, current)
    print(f"{current}: {share:.3f} of 500 episodes end alike")
    assert share >= 0.98
