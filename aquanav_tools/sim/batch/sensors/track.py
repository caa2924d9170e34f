"""The vehicle's own track by dead reckoning: where it came from, so that it need not turn back there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from gymnasium import spaces

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.caves import Cave
from aquanav_tools.sim.batch.motion import rotation_of
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.sensors.base import KernelSensor, MirrorImage, SensorBatch
from aquanav_tools.sim.batch.sensors.data_sheets import check_range, read_sheet
from aquanav_tools.sim.batch.sensors.noise import ONCE, normals
from aquanav_tools.sim.batch.sensors.rows import chosen
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.vehicle_base import Vehicle

wp.set_module_options(OPTIONS)

f64 = wp.float64
SPACING = wp.constant(wp.float64(0.25))
"""Between remembered points of the track, m; farther apart where a decision moves farther."""
LONGEST = 200.0
"""Of the distances, m."""
MIN_SLICE = 2048
"""Vehicles for which a further thread is worth its start."""


@dataclass(frozen=True)
class TrackSheet:
    """What is told of the track, and how its reckoning errs; standard deviations."""

    distances: tuple[float, ...]
    """Along the track, back from where the vehicle is, m."""
    scale_error: float = 0.0
    """Of a device's velocity, m/m."""
    heading_drift_deg_per_min: float = 0.0
    """Of a device's gyroscope."""
    product: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        if not self.distances:
            raise ValueError("The track has no distances.")
        for distance in self.distances:
            check_range("track", "distances", distance, float(SPACING), LONGEST)
        check_range("track", "scale_error", self.scale_error, 0.0, 0.2)
        check_range("track", "heading_drift_deg_per_min", self.heading_drift_deg_per_min, 0.0, 360.0)


@wp.struct
class TrackErrors:
    """`TrackSheet` as the kernel takes it."""

    scale_error: f64
    drift: f64
    """Of the heading in a decision, rad."""


@wp.struct
class TrackMemory:
    """What is remembered of the way so far; places are reckoned, from the start of the episode, m."""

    decisions: wp.array(dtype=wp.int32)
    """(N,) at which it was last measured; -1 before the first."""
    positions: wp.array(dtype=wp.vec3d)
    """(N,) true, then."""
    reckoned: wp.array(dtype=wp.vec3d)
    """(N,) the same by dead reckoning."""
    ways: wp.array(dtype=f64)
    """(N,) length of the track since the last point that is remembered, m."""
    counts: wp.array(dtype=wp.int32)
    """(N,) points remembered in this episode, among them those that others have taken the place of."""
    points: wp.array2d(dtype=wp.vec3)
    """(N, P) the last P of them, point n in column n modulo P."""
    bows: wp.array(dtype=wp.vec3)
    """(N,) where the bow pointed at first: unit vectors."""


@wp.func
def bow_of(orientation: wp.vec4d) -> wp.vec3d:
    """Return the direction in which the bow points."""
    return rotation_of(orientation) * wp.vec3d(f64(1.0), f64(0.0), f64(0.0))


@wp.func
def remember(i: int, memory: TrackMemory, state: BatchState, off: f64, scale: f64):
    """Bring a vehicle's track to the decision at hand; nothing changes where it is there.

    The reckoned heading is turned by `off`, rad, against the true one; ways are longer by a factor `scale`.
    """
    position, decision = state.positions[i], state.decisions[i]
    if decision == 0:
        memory.reckoned[i] = wp.vec3d()
        memory.ways[i] = f64(0.0)
        memory.counts[i] = 1
        memory.points[i, 0] = wp.vec3()
        memory.bows[i] = wp.vec3(bow_of(state.orientations[i]))
    elif memory.decisions[i] != decision:
        moved = position - memory.positions[i]
        c, s = wp.cos(off), wp.sin(off)
        moved = scale * wp.vec3d(c * moved[0] - s * moved[1], s * moved[0] + c * moved[1], moved[2])
        memory.reckoned[i] = memory.reckoned[i] + moved
        memory.ways[i] = memory.ways[i] + wp.length(moved)
        if memory.ways[i] >= SPACING:
            memory.ways[i] = memory.ways[i] - SPACING * wp.floor(memory.ways[i] / SPACING)
            memory.points[i, memory.counts[i] % memory.points.shape[1]] = wp.vec3(memory.reckoned[i])
            memory.counts[i] = memory.counts[i] + 1
    memory.positions[i] = position
    memory.decisions[i] = decision


@wp.kernel
def measure_track(
    first: int,
    only_restarted: int,
    stream: int,
    state: BatchState,
    caves: wp.array(dtype=Cave),
    errors: TrackErrors,
    steps: wp.array(dtype=wp.int32),
    limits: wp.array(dtype=wp.float32),
    memory: TrackMemory,
    out: wp.array2d(dtype=wp.float32),
):
    """Write where the vehicle was: some points of its track, each `steps` points before the last."""
    i = chosen(state, first + wp.tid(), only_restarted)
    if i < 0:
        return
    device = normals(state.seeds[i], stream, ONCE)
    off = errors.drift * f64(device[1]) * f64(state.decisions[i])
    remember(i, memory, state, off, f64(1.0) + errors.scale_error * f64(device[0]))
    ahead = bow_of(state.orientations[i])
    heading = float(wp.atan2(ahead[1], ahead[0]) + off)
    c, s = wp.cos(heading), wp.sin(heading)
    for k in range(steps.shape[0]):
        n = memory.counts[i] - 1 - steps[k]
        begun = float(f64(memory.counts[i] - 1) * SPACING + memory.ways[i])
        # Before the episode: straight astern of where it began.
        point = wp.min(begun - float(f64(steps[k]) * SPACING), 0.0) * memory.bows[i]
        if n >= 0:
            point = memory.points[i, n % memory.points.shape[1]]
        back = point - wp.vec3(memory.reckoned[i])
        out[i, 3 * k] = wp.clamp(c * back[0] + s * back[1], -limits[k], limits[k])
        out[i, 3 * k + 1] = wp.clamp(c * back[1] - s * back[0], -limits[k], limits[k])
        out[i, 3 * k + 2] = wp.clamp(back[2], -limits[k], limits[k])


class Track(KernelSensor):
    """Where the vehicle was some distances of its way ago: (N, 3 D), m, each ahead, left and up of it.

    A vehicle that dives knows its track from its Doppler log and gyroscope, to some percent of the way. Axes are level,
    by the heading, so that a tilt does not change them. An episode begins as if the vehicle had come straight from
    astern, so that only one that stays where it is finds all its past close by. It wants to be measured once after
    every decision.
    """

    def __init__(self, sheet: TrackSheet | Mapping[str, Any] | str | Path = "a50") -> None:
        """Take a data sheet: its name, a `TrackSheet`, its fields as a table, or the path of a TOML file.

        Raises:
            InputError: there is no such sheet, or it makes no sense.
        """
        self.data = read_sheet(TrackSheet, sheet, "track")
        self._steps = [round(distance / float(SPACING)) for distance in self.data.distances]
        # The line back is no longer than the track, but for what a decision moves.
        self._limits = np.array([2.0 * distance for distance in self.data.distances], dtype=np.float32)
        self._kept: dict[str, Any] = {}
        super().__init__(measure_track, MIN_SLICE)

    def spec(self, scenario: Scenario, vehicle: Vehicle) -> spaces.Box:
        """Return the space of a reading."""
        high = self._limits.repeat(3)
        return spaces.Box(-high, high, dtype=np.float32)

    def mirror_image(self) -> MirrorImage:
        """Return how readings look in a mirror: left for right."""
        count = len(self._steps)
        signs = np.tile(np.array([1.0, -1.0, 1.0], dtype=np.float32), count)
        return np.arange(3 * count, dtype=np.int64), signs

    def _shape(self) -> tuple[int, ...]:
        return (3 * len(self._steps),)

    def _memory(self) -> dict[str, Any]:
        return self._kept

    def _inputs(self, batch: SensorBatch) -> list[Any]:
        errors, memory = TrackErrors(), TrackMemory()
        errors.scale_error = self.data.scale_error
        errors.drift = np.radians(self.data.heading_drift_deg_per_min) / 60.0 * batch.decision_seconds
        for name, field in TrackMemory.vars.items():  # type: ignore[attr-defined]  # Warp makes the class a struct
            shape = (batch.num, max(self._steps) + 1) if name == "points" else (batch.num,)
            self._kept[name] = wp.zeros(shape, dtype=field.type.dtype, device=batch.device)
            setattr(memory, name, self._kept[name])
        memory.decisions.fill_(-1)
        steps = wp.array(self._steps, dtype=wp.int32, device=batch.device)
        limits = wp.array(self._limits, dtype=wp.float32, device=batch.device)
        return [errors, steps, limits, memory]
