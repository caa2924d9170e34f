"""How the reward measures the way to go. The episode itself, and `info`, always go by the guide's panels."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from aquanav_tools.cave.route.shortest import shortest_ways
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.task import MEASURES
from aquanav_tools.types import Array, Capsule, rotation_matrix


class ProgressMeasure(ABC):
    """Follows one vehicle through one episode."""

    @abstractmethod
    def begin(self, state: Array, remaining: float) -> None:
        """Start an episode at a (13,) state with so many metres to go along the panels."""

    @abstractmethod
    def gained(self, state: Array, remaining: float) -> float:
        """Return the metres gained since the last call, at a (13,) state and so much to go along the panels."""


def progress_measure(name: str, scenario: Scenario, capsule: Capsule) -> ProgressMeasure:
    """Return the measure of a name for a vehicle's capsule.

    Raises:
        InputError: there is no such measure.
    """
    check_choice("measure of progress", name, MEASURES)
    if name == "geodesic":
        return GeodesicProgress(scenario, capsule)
    return PanelProgress() if name == "panels" else OriginalProgress(scenario, capsule)


class PanelProgress(ProgressMeasure):
    """Metres along the guide, continuous across its panels."""

    def begin(self, state: Array, remaining: float) -> None:
        """Start an episode."""
        self._remaining = remaining

    def gained(self, state: Array, remaining: float) -> float:
        """Return the metres gained along the guide."""
        gained, self._remaining = self._remaining - remaining, remaining
        return gained


class GeodesicProgress(ProgressMeasure):
    """Metres of the shortest way through the water to the goal, whatever way the guide takes."""

    def __init__(self, scenario: Scenario, capsule: Capsule) -> None:
        goal = np.array(scenario.settings.goal.position, dtype=np.float64)
        self._ways = shortest_ways(scenario.field, goal, capsule.radius)

    def begin(self, state: Array, remaining: float) -> None:
        """Start an episode."""
        self._to_go = self._ways.remaining(state[:3])

    def gained(self, state: Array, remaining: float) -> float:
        """Return what the way became shorter by."""
        to_go = self._ways.remaining(state[:3])
        gained, self._to_go = self._to_go - to_go, to_go
        return gained


class OriginalProgress(ProgressMeasure):
    """The original's chain of panel centres, with its jumps. Panels are looked at once per decision."""

    def __init__(self, scenario: Scenario, capsule: Capsule) -> None:
        from aquanav_tools.sim.batch.chain import PanelChain

        self._chain = PanelChain(scenario.guide, capsule)

    def begin(self, state: Array, remaining: float) -> None:
        """Start an episode with no panel crossed."""
        self._chain.reset()
        self._to_go = self._follow(state)

    def gained(self, state: Array, remaining: float) -> float:
        """Return what the chain became shorter by."""
        to_go = self._follow(state)
        gained, self._to_go = self._to_go - to_go, to_go
        return gained

    def _follow(self, state: Array) -> float:
        return self._chain.follow(state[:3], rotation_matrix(state[3:7])[:, 0])
