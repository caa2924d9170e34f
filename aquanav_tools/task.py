"""What can be chosen about the task, for training and evaluation alike. Light to import: command lines read it."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, Literal, get_args

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.registry import Registry, is_own

ProgressMeasure = Literal["panels", "geodesic", "original"]
MEASURES = get_args(ProgressMeasure)
"""Of the way to go."""
REWARDS = ("dense", "safe", "careful", "sparse")
"""That come with aquanav."""
OWN_FIELDS = ("reward", "sensors", "termination", "disturbance", "motion")
"""Options that may name code of the user's own."""
MAX_DELAY = 100
"""Decisions; ten seconds at the original's ten per second."""


@dataclass(frozen=True, kw_only=True)
class TaskOptions:
    """The rules of the task. Each field is an option of aquanav-train, aquanav-eval and the environment."""

    reward: str = "careful"
    """What is paid for: progress (dense); progress away from walls (safe); progress with a price on contacts that
    counts (careful); the outcome alone (sparse); or a reward of your own, module:Name (docs/extending.md). dense is the
    original benchmark's. No rate of success depends on it, but that sparse ends an episode at its first contact."""
    progress: ProgressMeasure = "panels"
    """How the reward measures the way to go: along the guide's panels, by the shortest way through the water, or by the
    original's chain of panel centres."""
    on_collision: Literal["continue", "end"] = "continue"
    """What the first contact with a wall does to the episode. The sparse reward always ends it."""
    starts: Literal["listed", "anywhere"] = "listed"
    """Where episodes begin: at one of the scenario's starts, or anywhere in the water that the vehicle can reach,
    heading towards the goal within 45 degrees."""
    start_range: tuple[float, float] = (0.0, 1.0)
    """Shares of the way: starts with less than the first, or more than the second, of the longest way to the goal ahead
    of them are not used. 0 0.33 is the last third of the way, 0 1 all of it."""
    sensor_noise: float = 0.0
    """Standard deviation of the error of each ray's distance, m."""
    sensor_dropout: float = 0.0
    """Probability that a ray gets no echo in a decision and reads its full length."""
    action_delay: int = 0
    """Decisions between choosing an action and its effect."""
    observation_delay: int = 0
    """Decisions by which observations are late."""
    randomisation: str | None = None
    """Ranges from which each episode draws its vehicle's mass, damping, thrust and more: "mild" (what a data sheet
    leaves open), "late" (that, and commands that act up to a decision late), "wide" (a vehicle that is hardly known),
    or a TOML file of your own. The vehicle's file without."""
    current: Literal["still", "half", "full", "flood"] | float | tuple[float, float, float] | None = None
    """Current of the water: a preset; the mean speed through the cave's narrowest section, m/s; or one velocity X Y Z
    everywhere, m/s. The scenario's own when not given."""
    current_range: tuple[float, float] = (1.0, 1.0)
    """The water flows with a share of its speed drawn evenly from this range for each episode."""

    sensors: tuple[str, ...] = ()
    """What is measured beside the values of the observation and follows them: sensors by name (depth, imu, dvl, fan,
    echosounders, sonar3d, waypoint, track, sonar; docs/sensors.md), or of your own, as module:Name."""
    history: tuple[int, ...] = ()
    """Decisions ago whose observations follow that of now, such as 4 8: a memory of what the vehicle has passed. Before
    an episode began there was what it begins with."""
    termination: str | None = None
    """A rule of your own that ends episodes, as module:Name, beside the task's."""
    disturbance: str | None = None
    """What of your own disturbs actions and observations, as module:Name."""
    motion: str | None = None
    """How vehicles move in free water, by a law of your own, as module:Name; contacts stay what they are."""

    def __post_init__(self) -> None:
        if not is_own(self.reward):
            Registry("reward", dict.fromkeys(REWARDS)).find(self.reward)
        noise, dropout = self.sensor_noise, self.sensor_dropout
        _check(math.isfinite(noise) and noise >= 0.0, f"sensor_noise is {noise}; it is a length of 0 m or more.")
        _check(0.0 <= dropout <= 1.0, f"sensor_dropout is {dropout}; it is a probability from 0 to 1.")
        for name in ("action_delay", "observation_delay"):
            delay = getattr(self, name)
            _check(0 <= delay <= MAX_DELAY, f"{name} is {delay}; it is a number of decisions from 0 to {MAX_DELAY}.")
        for ago in self.history:
            _check(1 <= ago <= MAX_DELAY, f"history has {ago}; it has numbers of decisions from 1 to {MAX_DELAY}.")
        near, far = self.start_range
        _check(0.0 <= near < far <= 1.0, f"start_range is {near} to {far}; it rises from 0 or more to 1 or less.")
        low, high = self.current_range
        is_range = math.isfinite(high) and 0.0 <= low <= high
        _check(is_range, f"current_range is {low} to {high}; it rises from 0 or more, 1 being the water's own speed.")


def task_options(choices: dict[str, Any]) -> TaskOptions:
    """Return the options from their names and values.

    Raises:
        InputError: there is no option of a name, or a value makes no sense.
    """
    known = [field.name for field in fields(TaskOptions)]
    for name in choices:
        if name not in known:
            raise InputError(f"The task has no option '{name}'.{did_you_mean(name, known)}")
    return TaskOptions(**choices)


def choices_of(options: TaskOptions) -> dict[str, Any]:
    """Return the names and values of the task's options, also from a dataclass that adds others."""
    return {field.name: getattr(options, field.name) for field in fields(TaskOptions)}


def named_code(choices: dict[str, Any]) -> list[str]:
    """Return all that a task's options name of what may be code, of a mapping of names to values."""
    values = [choices.get(name) for name in OWN_FIELDS]
    return [str(one) for value in values for one in (value if isinstance(value, tuple | list) else [value]) if one]


def _check(is_right: bool, message: str) -> None:
    if not is_right:
        raise InputError(message)
