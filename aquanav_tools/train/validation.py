"""Trying the policy in whole episodes: while it learns, in places it does not learn from, and when it has learned.

Trials are evaluations: the figures are those of aquanav-eval with the same policy, scenarios, seed and episodes.
"""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.evaluate.options import EvaluateOptions
from aquanav_tools.evaluate.repeated import RepeatedEvaluation
from aquanav_tools.evaluate.summary import Summary
from aquanav_tools.sim.contacts import Backend, default_backend
from aquanav_tools.store import write_whole
from aquanav_tools.task import TaskOptions, choices_of
from aquanav_tools.train.settings import RunSettings, TrainSettings

TRIED_FILE = "tried.zip"
"""The policy of a trial that goes on, in the run's folder."""
SEED = 0
"""Of all trials: the default of aquanav-eval."""


@dataclass(frozen=True)
class Trial:
    """How a policy did in all validation scenarios together."""

    lesson: int
    """From 1."""
    steps: int
    """Decisions learned from so far, over all lessons."""
    collision_free_success: float
    """Fraction of episodes that reached the goal without a collision."""
    success_rate: float
    """Fraction that reached the goal."""
    mean_reward: float
    """Per episode."""
    mean_collisions: float
    """Contacts begun per episode."""
    episodes: int
    """So many in all."""

    @property
    def score(self) -> tuple[float, float, float]:
        """What the best policy is chosen by: collision-free success, then success, then reward."""
        return self.collision_free_success, self.success_rate, self.mean_reward


class Validation:
    """Scenarios in which one policy after another is tried, from the same starts, acting without chance."""

    def __init__(
        self,
        scenarios: Sequence[AnyScenario],
        task: TaskOptions,
        num_episodes: int,
        folder: Path,
        num_workers: int = 0,
        observation: str | None = None,
        backend: Backend | None = None,
    ) -> None:
        """Prepare trials; environments are made, and workers started, by the first.

        Args:
            scenarios: Where to try.
            task: Rules of the episodes.
            num_episodes: In each scenario.
            folder: Of the run; holds the policy during a trial.
            num_workers: Processes that run episodes; fewer than two run them in this process.
            observation: What policies observe; None tells it from the number of values.
            backend: What runs episodes, as in an evaluation; None takes the default.
        """
        self._path = folder / TRIED_FILE
        backend = default_backend() if backend is None else backend
        options = EvaluateOptions(
            policies=(str(self._path),),
            scenario=tuple(Path(scenario.name) for scenario in scenarios),
            episodes=num_episodes,
            seed=SEED,
            workers=max(1, num_workers) if backend != "batch" else None,
            observation=observation,
            backend=backend,
            **choices_of(task),
        )
        self._evaluation = RepeatedEvaluation(options, scenarios)

    def trial(self, policy: bytes, lesson: int, steps: int) -> Trial:
        """Return how a policy does; draws nothing from the generators that learning draws from.

        Args:
            policy: The bytes of its zip, as Stable-Baselines3 saves it.
            lesson: Its number, from 1.
            steps: Decisions learned from so far.
        """
        write_whole(self._path, policy)
        with _generators_kept():
            return _trial(self._evaluation.summary(), lesson, steps)

    def close(self) -> None:
        """Free environments and workers, and remove the policy that was tried last."""
        self._evaluation.close()
        self._path.unlink(missing_ok=True)


@dataclass(frozen=True)
class Trials:
    """What a lesson's policies are tried in."""

    validation: Validation | None
    """In between; None without validation scenarios."""
    final: Validation | None
    """When all is learned; None in lessons before the last, and where no last episodes are asked for."""


@contextmanager
def open_trials(
    run: RunSettings,
    settings: TrainSettings,
    validation: Sequence[AnyScenario],
    scenarios: Sequence[AnyScenario],
    folder: Path,
    *,
    is_last: bool,
) -> Iterator[Trials]:
    """Yield the trials of a lesson: validation in each scenario's own water, the final ones in the lesson's.

    Args:
        run: The run's settings.
        settings: The lesson's.
        validation: Scenarios to validate in.
        scenarios: The lesson's own, among which the final episodes are divided evenly, with one in each at least.
        folder: Of the run.
        is_last: Whether the lesson is the last.
    """
    num_workers = 0 if run.ray is not None else run.workers
    with ExitStack() as held:
        between = final = None
        seen = settings.observation
        if validation:
            own_water = dataclasses.replace(settings, current=None, current_range=(1.0, 1.0))
            between = Validation(validation, own_water, run.validation_episodes, folder, num_workers, seen, run.backend)
            held.callback(between.close)
        if is_last and run.final_episodes > 0:
            num_each = max(1, run.final_episodes // len(scenarios))
            final = Validation(scenarios, settings, num_each, folder, num_workers, seen, run.backend)
            held.callback(final.close)
        yield Trials(between, final)


def _trial(summary: Summary, lesson: int, steps: int) -> Trial:
    return Trial(
        lesson=lesson,
        steps=steps,
        collision_free_success=round(summary.collision_free_success.rate, 4),
        success_rate=round(summary.success.rate, 4),
        mean_reward=round(summary.means["reward"].mean, 4),
        mean_collisions=round(summary.means["collisions"].mean, 4),
        episodes=summary.episodes,
    )


@contextmanager
def _generators_kept() -> Iterator[None]:
    """Leave the libraries' own generators as they are: an evaluation seeds them for each episode."""
    states: tuple[Any, Any, Any] = random.getstate(), np.random.get_state(), torch.get_rng_state()
    try:
        yield
    finally:
        random.setstate(states[0])
        np.random.set_state(states[1])
        torch.set_rng_state(states[2])
