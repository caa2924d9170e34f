"""Where episodes are flown: a cave, or bays for boats. What an evaluation needs of either, under the same names."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

from gymnasium.utils import seeding

from aquanav_tools.envs.action import AFLOAT
from aquanav_tools.envs.bays import Bays
from aquanav_tools.envs.cave_env import vehicle_of
from aquanav_tools.envs.places import Place
from aquanav_tools.envs.surface_env import boat_of
from aquanav_tools.evaluate.energy import drag_power
from aquanav_tools.evaluate.metrics import Course
from aquanav_tools.evaluate.presets import CAVE, SURFACE
from aquanav_tools.report.picture import CavePicture
from aquanav_tools.report.sea_chart import draw_chart
from aquanav_tools.report.track import Trail
from aquanav_tools.scenario.bay import Bay
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sea.sea_map import SeaMap
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.sea_world import footprint_of
from aquanav_tools.sim.trial import boat_speed, try_out
from aquanav_tools.types import Array


class Picture(Protocol):
    """Draws where episodes led."""

    is_shared: bool
    """Whether all episodes were in one place, so that they can be drawn together."""

    def draw(self, path: Path, tracks: Sequence[Trail] = (), contacts: Array | None = None) -> None:
        """Write a PNG with trails, or with where (C, 3) contacts crowd."""


class Venue(Protocol):
    """A scenario of either task."""

    task: str
    """One of the tasks in `presets`: a policy must have been made for it."""
    ways: tuple[float, ...]
    """Length of the shortest way to the goal from each listed start, m; none where each episode has another place."""

    @property
    def course(self) -> Course:
        """What episodes are held against; its condition is to be filled in."""

    def picture(self) -> Picture:
        """Return what draws episodes in their place."""


@functools.lru_cache(maxsize=8)
def venue_of(place: Place) -> Venue:
    """Return the venue of a scenario."""
    return BayVenue(place) if isinstance(place, Bay) else CaveVenue(place)


class CaveVenue:
    """A cave."""

    task = CAVE

    def __init__(self, cave: Scenario) -> None:
        self._cave = cave
        self.ways = tuple(start.geodesic_to_goal for start in cave.starts)

    @functools.cached_property
    def course(self) -> Course:
        """What episodes are held against."""
        vehicle = vehicle_of(self._cave)
        return Course(
            scenario=self._cave.name,
            condition="",
            width=2.0 * vehicle.capsule.radius,
            route_length=self._cave.guide.length,
            top_speed=try_out(vehicle, self._cave.settings.water.density).ahead,
            power=functools.partial(drag_power, vehicle),
        )

    def picture(self) -> Picture:
        """Return the cave, cut open."""
        return CavePicture(self._cave)


class BayVenue:
    """A bay, or another one in each episode."""

    task = SURFACE

    def __init__(self, bay: Bay) -> None:
        self._bay = bay
        self._boat = boat_of(bay.settings.vehicle)
        self._width = footprint_of(self._boat).width
        self._bays = Bays(bay.map_path or bay.settings.rocks, self._width, "listed")
        self._fixed = self._bays.fixed
        self.ways = () if self._fixed is None else tuple(way.length for way in self._fixed.ways)

    @functools.cached_property
    def course(self) -> Course:
        """What episodes are held against."""
        return Course(
            scenario=self._bay.name,
            condition="",
            width=self._width,
            route_length=max(self.ways, default=None),
            top_speed=boat_speed(self._boat),
            power=functools.partial(drag_power, self._boat) if isinstance(self._boat, OriginalVehicle) else None,
            num_controls=len(AFLOAT),
        )

    def picture(self) -> Picture:
        """Return the chart of the bay, or of each episode's."""
        return BayPicture(self._bays, self._width)


class BayPicture:
    """Charts of bays with the trails of boats."""

    def __init__(self, bays: Bays, boat_width: float) -> None:
        self._bays, self._boat_width = bays, boat_width
        self.is_shared = bays.fixed is not None

    def draw(self, path: Path, tracks: Sequence[Trail] = (), contacts: Array | None = None) -> None:
        """Write the chart of the first track's bay."""
        draw_chart(self._bays.fixed or self._bay_of(tracks[0]), path, self._boat_width, tracks, contacts)

    def _bay_of(self, track: Trail) -> SeaMap:
        """Return the bay that an episode had: an environment draws it before all else from its seed."""
        rng, _ = seeding.np_random(track.seed)
        sea, *_ = self._bays.choose(rng, {})
        return sea
