"""Recordings and films of flown episodes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aquanav_tools.envs.cave_env import vehicle_of
from aquanav_tools.envs.rendering import VehicleCamera, film, film_size
from aquanav_tools.report.recording.cave import CaveModel
from aquanav_tools.report.recording.episode import DiveScene, record_episode
from aquanav_tools.report.track import Track
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.sensors import original_pattern
from aquanav_tools.types import Progress, ignore_progress


class Recorder:
    """Records tracks, and keeps the scene of one cave at a time: episodes come sorted by scenario."""

    def __init__(self) -> None:
        self._scene: DiveScene | None = None

    def record(self, scenario: Scenario, track: Track, path: Path) -> None:
        """Write the rerun recording of a track."""
        if self._scene is None or self._scene.scenario is not scenario:
            self._scene = DiveScene(CaveModel(scenario), vehicle_of(scenario).capsule, original_pattern().directions)
        record_episode(self._scene, track, path)

    def film(
        self, scenario: Scenario, track: Track, path: Path, view: str, progress: Progress = ignore_progress
    ) -> None:
        """Write a film of a track, as MP4 or GIF."""
        limits, hull = scenario.settings.limits, vehicle_of(scenario).capsule
        camera = VehicleCamera(scenario.cavity.mesh, hull, view, film_size(path))
        states = np.concatenate([track.positions, track.orientations], axis=1)
        film(camera, states, path, round(1.0 / (limits.dt * limits.substeps)), progress)
