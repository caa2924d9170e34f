"""What water does to a dive: one sequence of actions, ideal in still water, replayed blindly in currents.

The paper shows with it why a policy must feel the current: the same actions that thread the cave in still water drift
off and run into the wall. Here the deviation is measured, over several draws of each current's gusts and eddies.

Source: Corsi, Camponogara and Farinelli, Aquatic Navigation: A Challenging Benchmark for Deep Reinforcement Learning
(2024), the figure of trajectories with and without water.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.policies import LoadedPolicy, check_named, observed_by
from aquanav_tools.evaluate.protocol import EpisodePlan, plan_episodes
from aquanav_tools.evaluate.rollout import run_episode
from aquanav_tools.report.trajectory import Trajectory
from aquanav_tools.scenario.schema import PRESETS, Scenario
from aquanav_tools.task import TaskOptions
from aquanav_tools.types import Array, Capsule, Progress

MAX_TRIES = 10
"""Starts from which the policy is tried, until it reaches the goal without touching the wall."""


@dataclass(frozen=True, eq=False)
class Replay:
    """The sequence in one current."""

    current: str
    """Preset."""
    trajectory: Trajectory
    deviation: Array
    """(D + 1,) distance from where the ideal dive was at the same time, m."""

    @property
    def first_contact(self) -> float | None:
        """Time of the first contact with the wall, s; None without any."""
        touched = np.flatnonzero(self.trajectory.collided)
        return float(self.trajectory.times[touched[0]]) if len(touched) else None


@dataclass(frozen=True, eq=False)
class WaterImpact:
    """The experiment's outcome."""

    ideal: Trajectory
    """In still water: reaches the goal and touches nothing."""
    replays: tuple[Replay, ...]
    """Every current with every seed."""
    hull: Capsule
    """The vehicle's."""


class RecordedPolicy:
    """Repeats actions, whatever it observes."""

    def __init__(self, actions: Array) -> None:
        self._actions = actions
        self._next = 0

    def reset(self, seed: int) -> None:
        """Begin with the first action; draw nothing."""
        self._next = 0

    def act(self, observation: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
        """Return the next action."""
        action = self._actions[self._next]
        self._next += 1
        return np.asarray(action)


def measure_water_impact(
    scenario: Scenario, policy: LoadedPolicy, currents: tuple[str, ...], num_seeds: int, seed: int, progress: Progress
) -> WaterImpact:
    """Return how far currents take an ideal sequence of actions off its way.

    Args:
        scenario: the cave.
        policy: swims the ideal sequence in still water.
        currents: presets.
        num_seeds: draws of each current.
        seed: of the first draw, and of the order in which starts are tried.
        progress: is told how many replays are done.

    Raises:
        InputError: from no start the policy reaches the goal in still water without touching the wall.
    """
    check_named(policy)
    ideal = _ideal_dive(scenario, policy, seed)
    replays: list[Replay] = []
    for current in currents:
        # A sequence that outlasts its actions has nothing more to do.
        env = _env(scenario, policy, current, ideal.num_decisions)
        try:
            for number in range(num_seeds):
                plan = EpisodePlan(seed + number, ideal.start_index)
                trajectory = run_episode(env, RecordedPolicy(_as_given(ideal, env)), plan)
                replays.append(Replay(current, trajectory, _deviation(trajectory, ideal)))
                progress(len(replays), len(currents) * num_seeds)
        finally:
            env.close()
    return WaterImpact(ideal, tuple(replays), env.vehicle.capsule)


def by_current(impact: WaterImpact) -> list[tuple[str, list[tuple[Trajectory, Array]]]]:
    """Return for every current its name and its trajectories with their deviation, as pictures take them."""
    names = dict.fromkeys(replay.current for replay in impact.replays)
    return [
        (name, [(one.trajectory, one.deviation) for one in impact.replays if one.current == name]) for name in names
    ]


def impact_table(impact: WaterImpact, scenario: Scenario, policy: LoadedPolicy) -> dict[str, Any]:
    """Return the outcome as plain values for JSON; lengths in m, times in s."""
    return {
        "scenario": scenario.name,
        "scenario_hash": scenario.content_hash,
        "policy": policy.name,
        "start": impact.ideal.start_index,
        "decisions": impact.ideal.num_decisions,
        "duration": float(impact.ideal.times[-1]),
        "ideal_path_length": impact.ideal.path_length,
        "currents": summary_rows(impact),
        "replays": [
            {
                "current": replay.current,
                "seed": replay.trajectory.seed,
                "outcome": replay.trajectory.outcome,
                "collisions": replay.trajectory.num_collisions,
                "first_contact": replay.first_contact,
                "mean_deviation": float(replay.deviation.mean()),
                "max_deviation": float(replay.deviation.max()),
                "final_deviation": float(replay.deviation[-1]),
                "progress": float(replay.trajectory.progress[-1]),
            }
            for replay in impact.replays
        ],
    }


def summary_rows(impact: WaterImpact) -> list[dict[str, Any]]:
    """Return one row per current, over its seeds."""
    rows = []
    for current in dict.fromkeys(replay.current for replay in impact.replays):
        chosen = [replay for replay in impact.replays if replay.current == current]
        rows.append(
            {
                "current": current,
                "strength": PRESETS[current],
                "replays": len(chosen),
                "reached_the_goal": sum(replay.trajectory.outcome == "success" for replay in chosen),
                "touched_the_wall": sum(replay.trajectory.num_collisions > 0 for replay in chosen),
                "mean_collisions": float(np.mean([replay.trajectory.num_collisions for replay in chosen])),
                "mean_deviation": float(np.mean([replay.deviation.mean() for replay in chosen])),
                "max_deviation": float(max(replay.deviation.max() for replay in chosen)),
            }
        )
    return rows


def _ideal_dive(scenario: Scenario, policy: LoadedPolicy, seed: int) -> Trajectory:
    plans = plan_episodes(len(scenario.starts), min(MAX_TRIES, len(scenario.starts)), seed)
    env = _env(scenario, policy, "still", None)
    try:
        for plan in plans:
            trajectory = run_episode(env, policy.policy, plan)
            if trajectory.reason:
                raise InputError(f"{policy.name} failed: {trajectory.reason}. Mend it, or name another with --policy.")
            if trajectory.outcome == "success" and trajectory.num_collisions == 0:
                return trajectory
    finally:
        env.close()
    raise InputError(
        f"{policy.name} reached the goal of {scenario.name} without touching the wall from none of {len(plans)} starts "
        "in still water, so there is no ideal sequence of actions to replay. Name a better policy with --policy."
    )


def _env(scenario: Scenario, policy: LoadedPolicy, current: str, max_decisions: int | None) -> CaveEnv:
    task = observed_by(policy, policy.rules(TaskOptions())) | {"current": current}
    return CaveEnv(scenario, max_decisions=max_decisions, **task)


def _as_given(ideal: Trajectory, env: CaveEnv) -> Array:
    """Return the (D, ...) actions of a trajectory in the form and type of an environment's action space."""
    shape = (ideal.num_decisions, *(env.action_space.shape or ()))
    return ideal.actions.reshape(shape).astype(env.action_space.dtype)


def _deviation(trajectory: Trajectory, ideal: Trajectory) -> Array:
    both = min(len(trajectory.times), len(ideal.times))
    distances: Array = np.linalg.norm(trajectory.positions[:both] - ideal.positions[:both], axis=1)
    return distances
