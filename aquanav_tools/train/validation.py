"""Trying the policy in whole episodes: while it learns, in places it does not learn from, and when it has learned."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from stable_baselines3.common.base_class import BaseAlgorithm

from aquanav_tools.envs.places import Place, make_env
from aquanav_tools.task import choices_of
from aquanav_tools.train.episodes import SUMMARY, EpisodeSummary, SummaryWrapper
from aquanav_tools.train.settings import TrainSettings

AT_ONCE = 10
"""Episodes flown side by side: the network takes hardly longer for ten observations than for one."""


@dataclass(frozen=True)
class Trial:
    """How a policy did in all validation scenarios together."""

    lesson: int
    """From 1."""
    steps: int
    """Decisions learned from so far, over all lessons."""
    clean_success_rate: float
    """Share of episodes that reached the goal without a collision."""
    success_rate: float
    """Share that reached the goal."""
    mean_reward: float
    """Per episode."""
    mean_collisions: float
    """Contacts begun per episode."""
    episodes: int
    """So many in all."""

    @property
    def score(self) -> tuple[float, float, float]:
        """What the best policy is chosen by: collision-free success, then success, then reward."""
        return self.clean_success_rate, self.success_rate, self.mean_reward


class Validation:
    """The validation scenarios, ready to fly in."""

    def __init__(self, scenarios: Sequence[Place], settings: TrainSettings, num_episodes: int) -> None:
        """Prepare environments under a lesson's rules, but each with the scenario's own water."""
        own_water = dataclasses.replace(settings, current=None, current_range=(1.0, 1.0))
        self._num_episodes = num_episodes
        self._groups = [_group(scenario, own_water, num_episodes) for scenario in scenarios]

    def try_out(self, learner: BaseAlgorithm, lesson: int, steps: int) -> Trial:
        """Return how the policy does, acting without chance, from fixed starts. Draws no global random numbers."""
        summaries = [summary for envs in self._groups for summary in _fly(learner, envs, self._num_episodes)]
        return _trial(summaries, lesson, steps)

    def close(self) -> None:
        """Free the environments."""
        for env in (env for group in self._groups for env in group):
            env.close()


def measure(
    learner: BaseAlgorithm,
    scenarios: Sequence[Place],
    settings: TrainSettings,
    num_episodes: int,
    lesson: int,
    steps: int,
) -> Trial:
    """Return how the policy does in a lesson's own scenarios and water, as `Validation.try_out` does.

    Args:
        learner: Has the policy.
        scenarios: Of the lesson; one after the other is loaded, as there may be dozens.
        settings: Of the lesson.
        num_episodes: In all; shared out evenly, with one in each scenario at least.
        lesson: Its number, from 1.
        steps: Decisions learned from so far.
    """
    summaries: list[EpisodeSummary] = []
    share = max(1, num_episodes // len(scenarios))
    for scenario in scenarios:
        envs = _group(scenario, settings, share)
        try:
            summaries += _fly(learner, envs, share)
        finally:
            for env in envs:
                env.close()
    return _trial(summaries, lesson, steps)


def _group(scenario: Place, settings: TrainSettings, num_episodes: int) -> list[SummaryWrapper]:
    """Return environments for so many episodes, of which some are flown side by side."""
    form = {"observation": settings.observation, "action": settings.action, **choices_of(settings)}
    return [SummaryWrapper(make_env(scenario, **form)) for _ in range(min(AT_ONCE, num_episodes))]


def _trial(summaries: Sequence[EpisodeSummary], lesson: int, steps: int) -> Trial:
    clean = [summary.is_success and summary.num_collisions == 0 for summary in summaries]
    return Trial(
        lesson=lesson,
        steps=steps,
        clean_success_rate=round(float(np.mean(clean)), 4),
        success_rate=round(float(np.mean([summary.is_success for summary in summaries])), 4),
        mean_reward=round(float(np.mean([summary.reward for summary in summaries])), 4),
        mean_collisions=round(float(np.mean([summary.num_collisions for summary in summaries])), 4),
        episodes=len(summaries),
    )


def _fly(learner: BaseAlgorithm, envs: Sequence[SummaryWrapper], num_episodes: int) -> list[EpisodeSummary]:
    """Return the summaries of episodes 0 to num_episodes - 1, each with its own seed and start."""
    learner.policy.set_training_mode(False)
    summaries: list[EpisodeSummary] = []
    for first in range(0, num_episodes, len(envs)):
        summaries += _fly_side_by_side(learner, envs, range(first, min(first + len(envs), num_episodes)))
    return summaries


def _fly_side_by_side(
    learner: BaseAlgorithm, envs: Sequence[SummaryWrapper], episodes: Sequence[int]
) -> list[EpisodeSummary]:
    flying = list(envs[: len(episodes)])
    observations = [_begin(env, episode) for env, episode in zip(flying, episodes, strict=True)]
    summaries: list[EpisodeSummary] = []
    memory: Any = None
    is_first = np.ones(len(flying), dtype=bool)
    while flying:
        actions, memory = learner.predict(np.stack(observations), memory, is_first, deterministic=True)
        steps = [env.step(action) for env, action in zip(flying, actions, strict=True)]
        is_going = np.array([not (step[2] or step[3]) for step in steps])
        summaries += [step[4][SUMMARY] for step in steps if SUMMARY in step[4]]
        flying = [env for env, goes_on in zip(flying, is_going, strict=True) if goes_on]
        observations = [step[0] for step, goes_on in zip(steps, is_going, strict=True) if goes_on]
        memory = None if memory is None else tuple(part[:, is_going] for part in memory)
        is_first = np.zeros(len(flying), dtype=bool)
    return summaries


def _begin(env: SummaryWrapper, episode: int) -> Any:
    num_starts = env.unwrapped.num_starts  # type: ignore[attr-defined]  # it is a PlaceEnv
    return env.reset(seed=episode, options={"start": episode % num_starts} if num_starts else None)[0]
