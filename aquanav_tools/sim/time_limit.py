"""How long an episode may last, and how long its path takes at best.

The original's episodes have 2400 decisions. That is kept where it is at least AMPLE times what the longest path of a
scenario takes at the vehicle's top speed. Each decision that a longer path takes adds SLACK.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from aquanav_tools.scenario.limits import MAX_DECISIONS, ORIGINAL_DECISIONS
from aquanav_tools.scenario.schema import Current, Scenario
from aquanav_tools.sim.batch.water import mean_velocities
from aquanav_tools.sim.trial import top_speed
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Array

AMPLE = 2.0
"""In a passage of 113 m, which takes 114 s at best, the oracle arrived from every start within the original's 240 s,
also in full current."""
SLACK = 6.0
"""The oracle takes 3.1 times the ideal in 439 m of Jaskinia Mietusia Wyznia, 0.55 m wide where it is narrowest and
in still water; a current takes more."""
ROUND = 100
"""Limits are multiples of so many decisions, so that rounding in a vehicle's top speed does not show."""
LEAST_SPEED = 1e-3
"""m/s. Slower vehicles do not move."""
LEAST_SHARE = 0.1
"""Of the top speed. Where the mean current leaves less, lulls and slower water beside it are taken to let it by."""


def longest_path(scenario: Scenario) -> float:
    """Return the length of the longest path to the goal that an episode of a scenario has, m."""
    return max(scenario.guide.length, *(start.geodesic_to_goal for start in scenario.starts), 0.0)


def decision_limit(scenario: Scenario, vehicle: Vehicle) -> int:
    """Return after how many decisions an episode ends where nobody says otherwise.

    Args:
        scenario: its own limit counts where that is not the original's.
        vehicle: what dives there.
    """
    limits = scenario.settings.limits
    if limits.decisions != ORIGINAL_DECISIONS:
        return limits.decisions
    speed = max(top_speed(vehicle, scenario.settings.water.density), LEAST_SPEED)
    ideal = longest_path(scenario) / speed / (limits.dt * limits.substeps)
    more = max(SLACK * (ideal - ORIGINAL_DECISIONS / AMPLE), 0.0)
    return min(ORIGINAL_DECISIONS + ROUND * math.ceil(more / ROUND), MAX_DECISIONS)


@dataclass(frozen=True, eq=False)
class IdealTime:
    """The time in which no vehicle of some top speed is faster at the goal, by the path that is left to it.

    The mean current along the route slows it down or carries it; gusts and eddies, which do both, are left out.
    """

    path_lengths: Array
    """(N,) to the goal along the route, rising from 0, m."""
    seconds: Array
    """(N,) that it takes."""
    speed: float
    """Of the vehicle through the water, m/s."""
    slowest: float
    """Over ground where the mean current is strongest against it, m/s; 0 or less where that is too strong for it."""
    tolerance: float
    """So near to the goal it is reached, m."""

    def __call__(self, path_length: float) -> float:
        """Return the time that a path of some length to the goal takes at best, s. Off the route, water is still."""
        left = max(path_length - self.tolerance, 0.0)
        beyond = max(left - float(self.path_lengths[-1]), 0.0)
        return float(np.interp(left, self.path_lengths, self.seconds)) + beyond / self.speed


def ideal_time(
    scenario: Scenario, vehicle: Vehicle, current: Current | None = None, fraction: float = 1.0
) -> IdealTime:
    """Return how long paths to the goal take at best.

    Args:
        scenario: the cave.
        vehicle: what dives there.
        current: of the water, as `Water` takes it; None takes the scenario's.
        fraction: of its speed.
    """
    speed = max(top_speed(vehicle, scenario.settings.water.density), LEAST_SPEED)
    line = scenario.guide.centreline[::-1]
    steps = np.diff(line, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    steps, starts, lengths = steps[lengths > 0.0], line[:-1][lengths > 0.0], lengths[lengths > 0.0]
    water = fraction * mean_velocities(scenario, current, starts + 0.5 * steps)
    against = (water * steps).sum(axis=1) / lengths  # the line runs from the goal
    seconds = lengths / np.maximum(speed - against, LEAST_SHARE * speed)
    return IdealTime(
        path_lengths=np.concatenate([[0.0], np.cumsum(lengths)]),
        seconds=np.concatenate([[0.0], np.cumsum(seconds)]),
        speed=speed,
        slowest=speed - float(against.max()),
        tolerance=scenario.settings.goal.tolerance,
    )
