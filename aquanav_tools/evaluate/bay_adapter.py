"""A bay as the place of episodes, or another bay in each of them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from gymnasium.utils import seeding

from aquanav_tools.envs.bays import Bays
from aquanav_tools.envs.factory import make_env
from aquanav_tools.envs.pictures.sea_camera import SeaCamera
from aquanav_tools.envs.seas import Seas
from aquanav_tools.envs.starting import NOWHERE_LISTED
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.envs.surface_task import boat_of
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.energy import drag_power
from aquanav_tools.evaluate.metrics import EpisodeReference
from aquanav_tools.evaluate.presets import SURFACE
from aquanav_tools.report.recording.bay import BayScene
from aquanav_tools.report.sea_chart import draw_chart
from aquanav_tools.report.trajectory import Trajectory, TrajectorySummary
from aquanav_tools.scenario.bay import Bay
from aquanav_tools.sea.sea_map import SeaMap
from aquanav_tools.sim.appearance import boat_mesh
from aquanav_tools.sim.boat import footprint_of
from aquanav_tools.sim.boat_trial import boat_speed
from aquanav_tools.sim.command import AFLOAT
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.sensors import boat_pattern
from aquanav_tools.task import TaskOptions
from aquanav_tools.types import Array


class BayAdapter:
    """A bay, or another one in each episode; see `TaskAdapter`."""

    task = SURFACE

    def __init__(self, bay: Bay) -> None:
        self._bay = bay
        self._boat = boat_of(bay.settings.vehicle)
        self._width = footprint_of(self._boat).width
        self._bays = Bays(bay.map_path or bay.settings.rocks, self._width, "listed")
        self._fixed = self._bays.fixed
        self.path_lengths = () if self._fixed is None else tuple(path.length for path in self._fixed.paths)
        self.start_shares = (1.0,) * len(self.path_lengths)

    @functools.cached_property
    def reference(self) -> EpisodeReference:
        """What episodes are held against."""
        return EpisodeReference(
            scenario=self._bay.name,
            condition="",
            width=self._width,
            route_length=max(self.path_lengths, default=None),
            top_speed=boat_speed(self._boat),
            power=functools.partial(drag_power, self._boat) if isinstance(self._boat, OriginalVehicle) else None,
            num_controls=len(AFLOAT),
        )

    def ideal_time(self, task: TaskOptions) -> None:
        """Return None: wind and tide may carry a boat faster than it drives."""

    def draws_water(self, task: TaskOptions) -> bool:
        """Return whether there are waves, wind or a tide, whose directions and gusts each episode draws."""
        return not Seas(self._bay.settings.sea, task.current).is_still

    def picture(self) -> BayPicture:
        """Return the chart of the bay, or of each episode's."""
        return BayPicture(self._bays, self._width)

    def model(self, path: Path, trajectories: Sequence[TrajectorySummary], total: int) -> None:
        """Write nothing: a bay is flat, and its chart shows it."""

    def scene(self, trajectory: Trajectory) -> BayScene:
        """Return the bay and the waves of the trajectory's episode."""
        env = self._begun(trajectory)
        now = 0.0

        def rise(places: Array, time: float) -> Array:
            nonlocal now
            env.water.advance(time - now)
            now = time
            return env.water.rise(places)

        identity = f"{self._bay.name} {self._bay.content_hash}"
        return BayScene(identity, env.sea_map, env.route, boat_mesh(env.vehicle), boat_pattern().directions, rise)

    def camera(self, trajectory: Trajectory, view: str, size: tuple[int, int]) -> VoyageCamera:
        """Return a camera behind the boat."""
        if view != "chase":
            raise InputError(f"A boat is filmed from behind only, not '{view}'. Leave out --view.")
        return VoyageCamera(self._begun(trajectory), trajectory, size)

    def _begun(self, trajectory: Trajectory) -> SurfaceEnv:
        """Return an environment with the bay and the waves of an episode, as they were at its beginning."""
        is_listed = trajectory.start_index != NOWHERE_LISTED
        env = make_env(self._bay, starts="listed" if is_listed or self._bay.map_path is None else "anywhere")
        assert isinstance(env, SurfaceEnv)
        env.reset(seed=trajectory.seed, options={"start": trajectory.start_index} if is_listed else None)
        return env


class BayPicture:
    """Charts of bays with the trails of boats."""

    def __init__(self, bays: Bays, boat_width: float) -> None:
        self._bays, self._boat_width = bays, boat_width
        self.is_shared = bays.fixed is not None

    def draw(self, path: Path, trajectories: Sequence[TrajectorySummary] = (), contacts: Array | None = None) -> None:
        """Write the chart of the first trajectory's bay."""
        draw_chart(self._bays.fixed or self._bay_of(trajectories[0]), path, self._boat_width, trajectories, contacts)

    def _bay_of(self, trajectory: TrajectorySummary) -> SeaMap:
        """Return the bay that an episode had: an environment draws it before all else from its seed."""
        rng, _ = seeding.np_random(trajectory.seed)
        sea, *_ = self._bays.choose(rng, {})
        return sea


class VoyageCamera:
    """Takes the pictures of a voyage one after the other, while the sea goes on."""

    def __init__(self, env: SurfaceEnv, trajectory: Trajectory, size: tuple[int, int]) -> None:
        """Prepare the camera for a trajectory and its environment, as that was when the trajectory began."""
        pattern = boat_pattern()
        self._camera = SeaCamera(env.vehicle, size, pattern.directions, pattern.lengths)
        self._camera.look_at(env.sea_map)
        self._water, self._ranges = env.water, iter(trajectory.rays)
        self._steps = iter(np.diff(trajectory.times, append=trajectory.times[-1]))
        self.size = size

    def picture(self, state: Array, time: float) -> npt.NDArray[np.uint8]:
        """Return the next picture."""
        picture = self._camera.picture(state, self._water, next(self._ranges), time)
        self._water.advance(float(next(self._steps)))
        return picture
