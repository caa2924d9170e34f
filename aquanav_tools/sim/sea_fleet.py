"""Many boats, each in a bay and on a sea of its own: `SeaWorld` and `SeaSensor` for all of them, in compiled loops.

The physics are the very functions of the single boat, so that both come to the same place, to the bit. What differs
from boat to boat lies in arrays with a row for each.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import InputError
from aquanav_tools.sea.hull_contact import hull_clearance
from aquanav_tools.sea.outlines import outlines_of
from aquanav_tools.sea.sea_map import Berth, Rock, SeaMap
from aquanav_tools.sim.boat import Boat
from aquanav_tools.sim.original import Drive, OriginalVehicle
from aquanav_tools.sim.sea_sensor import cast_beams
from aquanav_tools.sim.sea_water import SeaWater
from aquanav_tools.sim.sea_world import body_of, footprint_of, place_hull, sail, state_at_berth
from aquanav_tools.sim.sensors import RayPattern
from aquanav_tools.sim.vehicle_base import STATE_SIZE
from aquanav_tools.types import Array, IntArray

MAX_BOATS = 1 << 16
"""Chosen; some 5 GB with their maps."""
MIN_SLICE = 16
"""Boats for which a further thread is worth its start."""
NO_GOAL = np.zeros((0, 2))
"""Beams do not see the goal; only the original's do, which no batch has."""


class Charts(NamedTuple):
    """The rocks of all boats' bays, as `sea_map.Outlines` has those of one. Rows are as long as the longest needs."""

    corners: Array
    """(N, V, 2) m."""
    first: IntArray
    """(N, R + 1)."""
    discs: Array
    """(N, R, 3) m."""
    edges: Array
    """(N, 4) m."""
    tops: Array
    """(N, R) m."""
    counts: IntArray
    """(N, 2) rocks, and how many of them, the first ones, the beams see."""


class SeaFleet:
    """N boats. `begin` each of them, then `step` once per decision."""

    def __init__(
        self,
        boat: Boat | OriginalVehicle,
        num: int,
        num_waves: int,
        pattern: RayPattern,
        dt: float,
        substeps: int,
        num_threads: int | None = None,
    ) -> None:
        """Make room.

        Args:
            boat: All of them.
            num: Boats.
            num_waves: In the sea of each.
            pattern: Of beams.
            dt: Step, s.
            substeps: Steps of a decision.
            num_threads: None takes as many as the process may use.

        Raises:
            InputError: a number makes no sense.
        """
        if not 1 <= num <= MAX_BOATS:
            raise InputError(f"A batch must have 1 to {MAX_BOATS} boats, got {num}.")
        available = len(os.sched_getaffinity(0)) if num_threads is None else num_threads
        if available < 1:
            raise InputError(f"num_threads must be at least 1, got {num_threads}.")
        self._boat, self._drive = boat, _drive_of(boat)
        self._body, self._mass = body_of(boat)
        self.footprint = footprint_of(boat)
        self._beams = (pattern.directions, pattern.lengths, pattern.radii)
        self._time = (dt, substeps)
        self.states: Array = np.zeros((num, STATE_SIZE if isinstance(boat, Boat) else STATE_SIZE + 1))
        """(N, S) as `SeaWorld.state`."""
        self.waves, self.phases = np.zeros((num, num_waves, 7)), np.zeros((num, num_waves))
        self.touched: IntArray = np.zeros(num, dtype=np.int64)
        """(N,) steps of the last decision in contact."""
        self.rays: npt.NDArray[np.float32] = np.ones((num, len(pattern.lengths)), dtype=np.float32)
        """(N, B) m."""
        self._charts = _blank_charts(num, 0, 0)
        bounds = np.linspace(0, num, max(1, min(available, num // MIN_SLICE)) + 1).astype(int).tolist()
        self._slices = list(pairwise(bounds))
        self._threads = ThreadPoolExecutor(len(self._slices)) if len(self._slices) > 1 else None

    def begin(self, i: int, sea: SeaMap, berth: Berth, water: SeaWater) -> None:
        """Put boat `i` at rest afloat at a berth of a bay."""
        self.states[i] = state_at_berth(self._boat, berth, water)
        self.waves[i], self.phases[i] = water.waves
        self.touched[i] = 0
        deepest = -float(self._beams[2].max())
        rocks = sorted(sea.rocks, key=lambda rock: rock.top <= deepest)  # those that beams see come first
        self._charts = _charted(self._charts, i, rocks, sea.edge, sum(rock.top > deepest for rock in rocks))

    def step(self, steer: Array, thrust: Array, flows: tuple[Array, Array], is_moving: npt.NDArray[np.bool_]) -> None:
        """Hold (N,) steer (left) and thrust (ahead) in [-1, 1] for a decision.

        Args:
            steer: (N,).
            thrust: (N,).
            flows: (N, 3) velocities of the water without waves, and (N, 2) of the air at 10 m, m/s.
            is_moving: (N,) the others stay as they are, and their sea too.
        """
        wrenches = np.zeros((len(self.states), 6))
        drive = self._drive
        wrenches[:, 0] = drive.force * np.where(thrust > 0.0, thrust, thrust * drive.reverse_share)
        wrenches[:, 5] = drive.steer_moment * (steer if drive.steers_at_rest else steer * thrust)
        self._share_out(
            lambda first, last: _sail_each(
                first, last, self.states, wrenches, flows, (self.waves, self.phases), is_moving, self._body,
                self._mass, tuple(self.footprint), self._charts, self._time, self.touched
            )
        )  # fmt: skip

    def sense(self) -> None:
        """Let all boats look around: `rays`."""
        self._share_out(
            lambda first, last: _sense_each(first, last, self.states, self._charts, *self._beams, self.rays)
        )

    def clearances(self) -> Array:
        """Return the (N,) distances from the hulls to the nearest rock, reef or edge from above, m."""
        found, shape = np.empty(len(self.states)), tuple(self.footprint)
        self._share_out(lambda first, last: _clear_each(first, last, self.states, self._charts, shape, found))
        return found

    def close(self) -> None:
        """End the threads. Closing twice does nothing."""
        if self._threads is not None:
            self._threads.shutdown()

    def _share_out(self, work: Callable[[int, int], None]) -> None:
        """Do the work for boats [first, last), each slice in a thread: compiled loops let go of Python."""
        if self._threads is None:
            work(0, len(self.states))
        else:
            list(self._threads.map(lambda part: work(*part), self._slices))


def _drive_of(boat: Boat | OriginalVehicle) -> Drive:
    if isinstance(boat, OriginalVehicle):
        return boat.drive
    return Drive(boat.surge_force, boat.reverse_share, boat.yaw_moment, steers_at_rest=True)


def _blank_charts(num: int, num_corners: int, num_rocks: int) -> Charts:
    return Charts(
        np.zeros((num, num_corners, 2)),
        np.zeros((num, num_rocks + 1), dtype=np.int64),
        np.zeros((num, num_rocks, 3)),
        np.zeros((num, 4)),
        np.zeros((num, num_rocks)),
        np.zeros((num, 2), dtype=np.int64),
    )


def _charted(charts: Charts, i: int, rocks: list[Rock], edge: Array, num_seen: int) -> Charts:
    """Return the charts with another bay for boat `i`; the arrays are new where its rocks need longer rows."""
    corners, first, discs, edge = outlines_of([rock.outline for rock in rocks], edge)
    if len(corners) > charts.corners.shape[1] or len(rocks) > charts.tops.shape[1]:
        num, most_corners, _ = charts.corners.shape
        larger = _blank_charts(num, max(most_corners, len(corners)), max(charts.tops.shape[1], len(rocks)))
        for old, new in zip(charts, larger, strict=True):
            new[tuple(slice(size) for size in old.shape)] = old
        charts = larger
    charts.corners[i, : len(corners)], charts.first[i, : len(first)] = corners, first
    charts.discs[i, : len(rocks)], charts.edges[i] = discs, edge
    charts.tops[i, : len(rocks)] = [rock.top for rock in rocks]
    charts.counts[i] = len(rocks), num_seen
    return charts


@numba.njit(cache=True, nogil=True)
def _sail_each(first, last, states, wrenches, flows, sea, is_moving, body, mass, shape, charts, time, touched):  # type: ignore[no-untyped-def]
    waves, phases = sea
    currents, winds = flows
    dt, substeps = time
    before, steps = np.empty(states.shape[1]), np.empty(substeps, dtype=np.bool_)
    for i in range(first, last):
        if is_moving[i]:
            count = charts.counts[i, 0]
            outlines = charts.corners[i], charts.first[i], charts.discs[i, :count], charts.edges[i]
            steps[:] = False
            sail(states[i], before, wrenches[i], (currents[i], winds[i]), (waves[i], phases[i]), body, mass, shape,
                 outlines, charts.tops[i], dt, steps)  # fmt: skip
            touched[i] = steps.sum()
            phases[i] += waves[i, :, 3] * (dt * substeps)


@numba.njit(cache=True, nogil=True)
def _sense_each(first, last, states, charts, directions, lengths, radii, rays):  # type: ignore[no-untyped-def]
    tags = np.empty(len(lengths), dtype=np.int64)
    for i in range(first, last):
        corners, discs = charts.corners[i], charts.discs[i, : charts.counts[i, 1]]
        cast_beams(states[i], directions, lengths, radii, corners, charts.first[i], discs, charts.edges[i],
                   NO_GOAL, rays[i], tags)  # fmt: skip


@numba.njit(cache=True, nogil=True)
def _clear_each(first, last, states, charts, shape, found):  # type: ignore[no-untyped-def]
    outline, radius, bottom = shape
    hull = np.empty((len(outline), 3))
    for i in range(first, last):
        place_hull(states[i], outline, bottom, hull)
        discs = charts.discs[i, : charts.counts[i, 0]]
        found[i] = hull_clearance(hull, radius, charts.corners[i], charts.first[i], discs, charts.edges[i])
