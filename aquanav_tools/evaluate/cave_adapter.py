"""A cave as the scenario of episodes."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.envs.pictures.vehicle_camera import VehicleCamera
from aquanav_tools.envs.vehicles import vehicle_of
from aquanav_tools.evaluate.energy import drag_power
from aquanav_tools.evaluate.metrics import EpisodeReference
from aquanav_tools.evaluate.presets import CAVE
from aquanav_tools.report.html import Model
from aquanav_tools.report.picture import CavePicture
from aquanav_tools.report.recording.cave import CaveModel
from aquanav_tools.report.recording.episode import DiveScene
from aquanav_tools.report.scene_model import scene_caption, write_scene
from aquanav_tools.report.trajectory import Trajectory, TrajectorySummary
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.appearance import vehicle_mesh
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.sim.time_limit import ideal_time
from aquanav_tools.sim.trial import top_speed
from aquanav_tools.sim.water import is_constant
from aquanav_tools.task import TaskOptions


class CaveAdapter:
    """A cave; see `TaskAdapter`."""

    task = CAVE

    def __init__(self, cave: Scenario) -> None:
        self._cave, self._vehicle = cave, vehicle_of(cave)
        self._ideals: dict[Any, Callable[[float], float]] = {}
        self.path_lengths = tuple(start.geodesic_to_goal for start in cave.starts)
        self.start_shares = tuple(start.difficulty for start in cave.starts)

    @functools.cached_property
    def reference(self) -> EpisodeReference:
        """What episodes are held against."""
        return EpisodeReference(
            scenario=self._cave.name,
            condition="",
            width=2.0 * self._vehicle.capsule.radius,
            route_length=self._cave.guide.length,
            top_speed=top_speed(self._vehicle, self._cave.settings.water.density),
            power=functools.partial(drag_power, self._vehicle),
        )

    def ideal_time(self, task: TaskOptions) -> Callable[[float], float]:
        """Return the time that a path takes at best, with the most favourable fraction of the current."""
        key = (task.current, task.current_range)
        if key not in self._ideals:
            low, high = (
                ideal_time(self._cave, self._vehicle, task.current, fraction) for fraction in task.current_range
            )
            self._ideals[key] = lambda length: min(low(length), high(length))
        return self._ideals[key]

    def draws_water(self, task: TaskOptions) -> bool:
        """Return whether the water draws gusts, eddies or waves, or its fraction of a current, for each episode."""
        low, high = task.current_range
        current = self._cave.settings.water.current if task.current is None else task.current
        flows = not is_constant(self._cave, task.current)
        has_fractions = low != high and (flows or (np.ndim(current) > 0 and bool(np.any(current))))
        return high > 0.0 and (flows or has_fractions)

    def picture(self) -> CavePicture:
        """Return the cave, cut open."""
        return CavePicture(self._cave)

    def model(self, path: Path, trajectories: Sequence[TrajectorySummary], total: int) -> Model:
        """Write the cave with trajectories, and the vehicle at the first start."""
        vehicle = (vehicle_mesh(self._vehicle), self._cave.starts[0].pose) if self._cave.starts else None
        write_scene(self._cave, path, vehicle, trajectories)
        return Model(path, scene_caption(self._cave, len(trajectories), total))

    def scene(self, trajectory: Trajectory) -> DiveScene:
        """Return the cave with the hull: the same for all trajectories."""
        return self._scene

    def camera(self, trajectory: Trajectory, view: str, size: tuple[int, int]) -> VehicleCamera:
        """Return a camera behind or in the vehicle."""
        return VehicleCamera(self._cave, self._vehicle.capsule, vehicle_mesh(self._vehicle), view, size)

    @functools.cached_property
    def _scene(self) -> DiveScene:
        return DiveScene(CaveModel(self._cave), vehicle_mesh(self._vehicle), original_pattern().directions)
