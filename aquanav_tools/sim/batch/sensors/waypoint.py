"""A place ahead on the way to the goal, by a map that the vehicle makes of what its own sonar has met."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
import numpy as np
import numpy.typing as npt
import warp as wp
from gymnasium import spaces

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim import occupancy, way
from aquanav_tools.sim.batch.caves import Cave
from aquanav_tools.sim.batch.motion import rotation_of
from aquanav_tools.sim.batch.runtime import OPTIONS, launch_kernel
from aquanav_tools.sim.batch.sensors.base import MirrorImage, Reading, SensorBatch
from aquanav_tools.sim.batch.sensors.fan import RangeFan
from aquanav_tools.sim.batch.sensors.fan_spec import FanSpec
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.vehicle_base import Vehicle

wp.set_module_options(OPTIONS)

SIZE = 4
"""Of a reading."""
MIN_SHARE = 8
"""Vehicles for which a further thread is worth its start."""


def space() -> spaces.Box:
    """Return the space of a reading."""
    return spaces.Box(np.array([0, -1, -1, 0], np.float32), np.ones(SIZE, np.float32), dtype=np.float32)


def mirror_image() -> MirrorImage:
    """Return how readings look in a mirror: left for right."""
    return np.arange(SIZE, dtype=np.int64), np.array([1.0, -1.0, 1.0, 1.0], dtype=np.float32)


@wp.kernel
def locate(
    state: BatchState,
    caves: wp.array(dtype=Cave),
    rotations: wp.array(dtype=wp.mat33d),
    goals: wp.array(dtype=wp.vec3d),
):
    """Write how each vehicle is turned, and where its goal is."""
    i = wp.tid()
    rotations[i] = rotation_of(state.orientations[i])
    goals[i] = caves[state.cave_of[i]].rules.goal


class Waypoint(RangeFan):
    """Which way leads to the goal by what was met so far: (N, 4).

    First as the observation `goal` has it: the way's length, x / (x + 10 m), and azimuth (left +) / pi and elevation
    (up +) / (pi / 2) of the farthest place in sight along it; then the share of its next 4.2 m of which nothing is
    known. So a network that knows how to steer to a goal can begin with that (`train.initial`).

    The map is a grid of what a scanned sonar met (96 beams all around, twice a second); where the vehicle is in it, it
    knows from its Doppler log with the goal's bearing for a compass, to 5 to 10 cm after four minutes
    (docs/decisions/0033), half a cell at most: no further error is modelled. It wants to be measured once after every
    decision. Maps are kept on the processor, also where all else runs on a card.
    """

    def __init__(self, spec: FanSpec | Mapping[str, Any] | str | Path = "mapping") -> None:
        """Take other beams, as `RangeFan` takes them."""
        super().__init__(spec)
        self._maps: occupancy.Maps | None = None
        self._searches: list[way.Search] = []
        self._decisions = np.zeros(0, dtype=np.int64)
        self._readings: Reading = np.zeros((0, SIZE), dtype=np.float32)

    def spec(self, scenario: Scenario, vehicle: Vehicle) -> spaces.Box:
        """Return the space of a reading."""
        return space()

    def mirror_image(self) -> MirrorImage:
        """Return how readings look in a mirror: left for right."""
        return mirror_image()

    def measure(self, batch: SensorBatch) -> Reading:
        """Return the readings of all vehicles, (N, 4), in memory that the next measurement changes."""
        ranges = super().measure(batch)
        if self._maps is None or len(self._decisions) != batch.num:
            self._maps = occupancy.make_maps(batch.num)
            self._decisions = np.full(batch.num, -1, dtype=np.int64)
        if len(self._readings) != batch.num:
            self._readings = np.zeros((batch.num, SIZE), dtype=np.float32)
        rotations = wp.zeros(batch.num, dtype=wp.mat33d, device=batch.device)
        goals = wp.zeros(batch.num, dtype=wp.vec3d, device=batch.device)
        inputs = [batch.state, batch.caves, rotations, goals]
        launch_kernel(locate, dim=batch.num, inputs=inputs, device=batch.device)
        at = batch.view_of("decisions"), batch.view_of("positions"), rotations.numpy(), goals.numpy()
        fan = self.pattern.directions, self.pattern.lengths
        every = tuple(max(1, round(time / batch.decision_seconds)) for time in (self.data.period, way.PLAN_EVERY))
        rows = np.flatnonzero(batch.view_of("restarted")) if batch.only_restarted else np.arange(batch.num)
        num_shares = max(1, min(batch.num_threads, len(rows) // MIN_SHARE))
        self._searches += [way.make_search() for _ in range(num_shares - len(self._searches))]
        kept = self._maps, self._decisions, self._readings
        shares = zip(np.array_split(rows, num_shares), self._searches, strict=False)
        batch.run([_Share((share, search, at, ranges, fan, every, *kept)) for share, search in shares])
        return self._readings

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of the maps: nothing before the first measurement."""
        maps = {} if self._maps is None else occupancy.packed(self._maps) | {"decisions": self._decisions.copy()}
        return super().state() | maps

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Take back what `state` returned, also before the first measurement."""
        super().restore(state)
        self._maps = None
        if "decisions" in state:
            self._maps, self._decisions = occupancy.unpacked(state), state["decisions"].copy()


@dataclass(frozen=True)
class _Share:
    """Some vehicles, for a thread."""

    inputs: tuple[Any, ...]

    def launch(self) -> None:
        """Measure what they see."""
        _measure(*self.inputs)


@numba.njit(cache=True, nogil=True)
def _measure(rows, search, at, ranges, fan, every, maps, decisions, out):  # type: ignore[no-untyped-def]
    """Bring maps to the decision at hand, and write readings; what is there already stays as it is."""
    now, positions, rotations, goals = at
    directions, reaches = fan
    for m in rows:
        place, rotation, goal = positions[m], rotations[m], goals[m]
        if now[m] == 0:
            occupancy.begin(maps, m, place, goal, np.arctan2(rotation[1, 0], rotation[0, 0]))
        if now[m] == 0 or decisions[m] != now[m]:
            occupancy.be_at(maps, m, place)
            if now[m] % every[0] == 0:
                occupancy.see(maps, m, place, _turned(directions, rotation), ranges[m].astype(np.float64), reaches)
            if now[m] % every[1] == 0:
                way.plan(maps, search, m, place, goal)
        decisions[m] = now[m]
        out[m] = way.reading(maps, m, place, np.arctan2(rotation[1, 0], rotation[0, 0]), goal)


@numba.njit(cache=True, nogil=True)
def _turned(directions, rotation):  # type: ignore[no-untyped-def]
    """Return body directions in the world frame, added up in a fixed order: a library's product has none."""
    rays = np.zeros(directions.shape)
    for n in range(len(directions)):
        for axis in range(3):
            for other in range(3):
                rays[n, axis] += rotation[axis, other] * directions[n, other]
    return rays
