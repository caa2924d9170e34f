"""Recordings and films of flown episodes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.cave_env import vehicle_of
from aquanav_tools.envs.places import Place, make_env
from aquanav_tools.envs.rendering import VehicleCamera, film, film_size
from aquanav_tools.envs.sea_rendering import SeaCamera, hull_of
from aquanav_tools.envs.starting import NOWHERE_LISTED
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.errors import InputError
from aquanav_tools.report.recording.bay import BayScene
from aquanav_tools.report.recording.cave import CaveModel
from aquanav_tools.report.recording.episode import DiveScene, Scene, record_episode
from aquanav_tools.report.track import Track
from aquanav_tools.scenario.bay import Bay
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.sensors import boat_pattern, original_pattern
from aquanav_tools.types import Array, Progress, ignore_progress


class Recorder:
    """Records tracks, and keeps the scene of one cave at a time: episodes come sorted by scenario."""

    def __init__(self) -> None:
        self._scene: DiveScene | None = None

    def record(self, place: Place, track: Track, path: Path) -> None:
        """Write the rerun recording of a track."""
        record_episode(self._scene_of(place, track), track, path)

    def film(self, place: Place, track: Track, path: Path, view: str, progress: Progress = ignore_progress) -> None:
        """Write a film of a track, as MP4 or GIF.

        Raises:
            InputError: there is no such view, or no film of that kind.
        """
        states = np.concatenate([track.positions, track.orientations], axis=1)
        rate = round(1.0 / float(track.times[1] - track.times[0])) if len(track.times) > 1 else 1
        camera = _Shore(place, track, view, film_size(path)) if isinstance(place, Bay) else _diver(place, view, path)
        film(camera, states, path, rate, progress)

    def _scene_of(self, place: Place, track: Track) -> Scene:
        if isinstance(place, Bay):
            return _bay_scene(place, track)
        if self._scene is None or self._scene.scenario is not place:
            self._scene = DiveScene(CaveModel(place), vehicle_of(place).capsule, original_pattern().directions)
        return self._scene


def _diver(cave: Scenario, view: str, path: Path) -> VehicleCamera:
    return VehicleCamera(cave.cavity.mesh, vehicle_of(cave).capsule, view, film_size(path))


def _bay_scene(bay: Bay, track: Track) -> BayScene:
    env = _begun(bay, track)
    now = 0.0

    def rise(places: Array, time: float) -> Array:
        nonlocal now
        env.water.advance(time - now)
        now = time
        return env.water.rise(places)

    identity = f"{bay.name} {bay.content_hash}"
    return BayScene(identity, env.sea_map, env.route, hull_of(env.vehicle), boat_pattern().directions, rise)


def _begun(bay: Bay, track: Track) -> SurfaceEnv:
    """Return an environment with the bay and the waves of an episode, as they were at its beginning."""
    is_listed = track.start_index != NOWHERE_LISTED
    env = make_env(bay, starts="listed" if is_listed or bay.map_path is None else "anywhere")
    assert isinstance(env, SurfaceEnv)
    env.reset(seed=track.seed, options={"start": track.start_index} if is_listed else None)
    return env


class _Shore:
    """Takes the pictures of a voyage one after the other, while the sea goes on."""

    def __init__(self, bay: Bay, track: Track, view: str, size: tuple[int, int]) -> None:
        if view != "chase":
            raise InputError(f"A boat is filmed from behind only, not '{view}'. Leave out --view.")
        env, pattern = _begun(bay, track), boat_pattern()
        self._camera = SeaCamera(env.vehicle, size, pattern.directions, pattern.lengths)
        self._camera.look_at(env.sea_map)
        self._water, self._ranges = env.water, iter(track.rays)
        self._steps = iter(np.diff(track.times, append=track.times[-1]))
        self.size = size

    def picture(self, state: Array) -> npt.NDArray[np.uint8]:
        """Return the next picture."""
        picture = self._camera.picture(state, self._water, next(self._ranges))
        self._water.advance(float(next(self._steps)))
        return picture
