"""Where episodes are run: a cave, or bays for boats. What an evaluation needs of either, under the same names."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Protocol

from aquanav_tools.envs.factory import AnyScenario
from aquanav_tools.envs.pictures.film import Camera
from aquanav_tools.evaluate.bay_adapter import BayAdapter
from aquanav_tools.evaluate.cave_adapter import CaveAdapter
from aquanav_tools.evaluate.metrics import EpisodeReference
from aquanav_tools.report.html import Model
from aquanav_tools.report.recording.episode import Scene
from aquanav_tools.report.trajectory import Trajectory, TrajectorySummary
from aquanav_tools.scenario.bay import Bay
from aquanav_tools.task import TaskOptions
from aquanav_tools.types import Array


class Picture(Protocol):
    """Draws where episodes led."""

    is_shared: bool
    """Whether all episodes were in one scenario, so that they can be drawn together."""

    def draw(self, path: Path, trajectories: Sequence[TrajectorySummary] = (), contacts: Array | None = None) -> None:
        """Write a PNG with trajectories, or with where (C, 3) contacts crowd."""


class TaskAdapter(Protocol):
    """A scenario of either task."""

    task: str
    """One of the tasks in `presets`: a policy must have been made for it."""
    path_lengths: tuple[float, ...]
    """Length of the shortest path to the goal from each listed start, m; none where each episode has another map."""
    start_shares: tuple[float, ...]
    """Of the longest way to the goal, ahead of each listed start."""

    @property
    def reference(self) -> EpisodeReference:
        """What episodes are held against; its condition is to be filled in."""

    def ideal_time(self, task: TaskOptions) -> Callable[[float], float] | None:
        """Return the time that a path of some length to the goal takes at best, s; None where that is not known."""

    def draws_water(self, task: TaskOptions) -> bool:
        """Return whether the water alone makes episodes from one start differ."""

    def picture(self) -> Picture:
        """Return what draws episodes in their scenario."""

    def model(self, path: Path, trajectories: Sequence[TrajectorySummary], total: int) -> Model | None:
        """Write the 3D view of the scenario with trajectories of some of `total` episodes as GLB; None without one."""

    def scene(self, trajectory: Trajectory) -> Scene:
        """Return what the recording of a trajectory shows around the vehicle."""

    def camera(self, trajectory: Trajectory, view: str, size: tuple[int, int]) -> Camera:
        """Return what takes the pictures of a trajectory in their order, once, of a width and height in px.

        Raises:
            InputError: there is no such view.
        """


@functools.lru_cache(maxsize=8)
def adapter_of(scenario: AnyScenario) -> TaskAdapter:
    """Return the adapter of a scenario."""
    return BayAdapter(scenario) if isinstance(scenario, Bay) else CaveAdapter(scenario)
