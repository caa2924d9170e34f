"""How many episodes that differ there are, and how many are run where no number is asked for."""

from __future__ import annotations

from math import ceil

from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.evaluate.task_adapter import adapter_of
from aquanav_tools.registry import is_own, named_part
from aquanav_tools.task import TaskOptions

USUAL = 40
"""Least number of episodes without --episodes where more of them differ: as many as scenarios have starts. All of 40
show a rate of 91 % or more, and half of 40 one from 35 to 65 %."""


def is_drawn(scenario: AnyScenario, task: TaskOptions, observation: str | None = None) -> bool:
    """Return whether anything about an episode from a given start is drawn at random, the policy aside.

    `observation` is what the policy is told to observe: code of the user's own may draw.
    """
    adapter = adapter_of(scenario)
    has_starts = task.starts == "listed" and bool(adapter.path_lengths)
    has_errors = task.sensor_noise > 0.0 or task.sensor_dropout > 0.0
    has_own = bool(task.sensors) or task.disturbance is not None or task.motion is not None  # these may draw
    has_own |= observation is not None and is_own(named_part(observation)[1])
    return not has_starts or has_errors or has_own or task.randomisation is not None or adapter.draws_water(task)


def usual_episodes(scenario: AnyScenario, task: TaskOptions, num_starts: int, observation: str | None = None) -> int:
    """Return how many episodes tell the most for their cost, from so many listed starts that may be used.

    Each start comes equally often, so that none counts more than another: once where it always leads to the same
    episode, which depends on the task alone, so that different policies meet the same episodes.
    """
    if task.starts == "anywhere" or not num_starts:
        return USUAL
    return num_starts * (ceil(USUAL / num_starts) if is_drawn(scenario, task, observation) else 1)


def possible_episodes(
    scenario: AnyScenario, task: TaskOptions, num_starts: int, draws: bool, observation: str | None = None
) -> int | None:
    """Return how many episodes that differ there are from so many listed starts; None where there is no end of them.

    Args:
        scenario: Where they are.
        task: Their rules.
        num_starts: Starts that may be used.
        draws: Whether the policy may draw at random.
        observation: What the policy is told to observe.
    """
    return None if draws or is_drawn(scenario, task, observation) else num_starts
