"""A Doppler velocity log: velocity over ground from four beams that meet the wall below."""

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
from aquanav_tools.sim.batch.motion import linear, rotation_of
from aquanav_tools.sim.batch.rays import cast_ray, origin_of
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.sensors.base import KernelSensor, SensorBatch
from aquanav_tools.sim.batch.sensors.data_sheets import check_range, read_sheet
from aquanav_tools.sim.batch.sensors.noise import ONCE, normals
from aquanav_tools.sim.batch.sensors.rows import chosen
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
AZIMUTHS_DEG = (45.0, 135.0, 225.0, 315.0)
"""Of the beams, from ahead towards left: each of them hears surge and sway."""
MIN_BEAMS = wp.constant(3)
"""Three radial velocities are enough for three unknowns."""
MIN_SLICE = 512
"""Vehicles for which a further thread is worth its start."""


@dataclass(frozen=True)
class DopplerSheet:
    """A Doppler log's data sheet; standard deviations."""

    beam_angle_deg: float
    """Between each beam and straight down in the body frame (Janus geometry)."""
    max_range: float
    """Along a beam, m; beyond it a beam gets no echo."""
    min_range: float = 0.0
    """m; nearer than this it gets none either."""
    max_speed: float = 10.0
    """m/s; there is no reading above it."""
    scale_error: float = 0.0
    """Of a device, m/s per m/s: long-term accuracy."""
    bias: float = 0.0
    """Of a device, per axis, m/s."""
    noise: float = 0.0
    """Of a ping's velocity along a beam, m/s."""
    product: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        check_range("Doppler log", "beam_angle_deg", self.beam_angle_deg, 5.0, 60.0)
        check_range("Doppler log", "max_range", self.max_range, 1e-2, 1000.0)
        check_range("Doppler log", "min_range", self.min_range, 0.0, self.max_range)
        check_range("Doppler log", "max_speed", self.max_speed, 1e-3, 100.0)
        check_range("Doppler log", "scale_error", self.scale_error, 0.0, 1.0)
        check_range("Doppler log", "bias", self.bias, 0.0, self.max_speed)
        check_range("Doppler log", "noise", self.noise, 0.0, self.max_speed)

    @property
    def beams(self) -> Array:
        """(4, 3) unit vectors, body frame."""
        azimuths, angle = np.radians(AZIMUTHS_DEG), np.radians(self.beam_angle_deg)
        down = np.full(4, -np.cos(angle))
        return np.stack([np.sin(angle) * np.cos(azimuths), np.sin(angle) * np.sin(azimuths), down], axis=1)


@wp.struct
class DopplerErrors:
    """`DopplerSheet` as the kernel takes it."""

    min_range: wp.float32
    max_range: wp.float32
    max_speed: wp.float32
    scale_error: wp.float32
    bias: wp.float32
    noise: wp.float32


@wp.kernel
def measure_velocity(
    first: int,
    only_restarted: int,
    stream: int,
    state: BatchState,
    caves: wp.array(dtype=Cave),
    beams: wp.array(dtype=wp.vec3d),
    errors: DopplerErrors,
    out: wp.array2d(dtype=wp.float32),
):
    """Write velocity, altitude and whether they are valid: least squares over the beams that get an echo."""
    i = chosen(state, first + wp.tid(), only_restarted)
    if i < 0:
        return
    cave = caves[state.cave_of[i]]
    origin = origin_of(cave, state.positions[i])
    turn = wp.mat33(rotation_of(state.orientations[i]))
    velocity = linear(state.velocities[i])
    device = normals(state.seeds[i], stream, ONCE)
    drawn = normals(state.seeds[i], stream, state.decisions[i])
    matrix, heard = wp.mat33d(), wp.vec3d()
    count = int(0)
    altitude = float(0.0)
    for beam in range(4):
        direction = beams[beam]
        distance, _ = cast_ray(cave, origin, turn * wp.vec3(direction), errors.max_range)
        if distance < errors.max_range and distance >= errors.min_range:
            radial = wp.dot(direction, velocity) + f64(errors.noise * drawn[beam])
            matrix += wp.outer(direction, direction)
            heard += radial * direction
            altitude -= distance * float(direction[2])
            count += 1
    for n in range(5):
        out[i, n] = 0.0
    if count >= MIN_BEAMS and wp.length(velocity) <= f64(errors.max_speed):
        scale = 1.0 + errors.scale_error * device[3]
        solved = wp.vec3(wp.inverse(matrix) * heard)
        for axis in range(3):
            read = scale * solved[axis] + errors.bias * device[axis]
            out[i, axis] = wp.clamp(read, -errors.max_speed, errors.max_speed)
        out[i, 3] = altitude / float(count)
        out[i, 4] = 1.0


class DopplerLog(KernelSensor):
    """Velocity over ground, body frame, m/s; altitude along the body's downward axis, m; 1.0 where valid: (N, 5).

    With an echo of fewer than three beams, or beyond the largest speed, all five are 0.
    """

    def __init__(self, sheet: DopplerSheet | Mapping[str, Any] | str | Path = "a50") -> None:
        """Take a data sheet: its name, a `DopplerSheet`, its fields as a table, or the path of a TOML file.

        Raises:
            InputError: there is no such sheet, or it makes no sense.
        """
        self.data = read_sheet(DopplerSheet, sheet, "dvl")
        super().__init__(measure_velocity, MIN_SLICE)

    def spec(self, scenario: Scenario, vehicle: Vehicle) -> spaces.Box:
        """Return the space of a reading."""
        speed = self.data.max_speed
        high = np.array([speed, speed, speed, self.data.max_range, 1.0], dtype=np.float32)
        low = np.array([-speed, -speed, -speed, 0.0, 0.0], dtype=np.float32)
        return spaces.Box(low, high, dtype=np.float32)

    def _shape(self) -> tuple[int, ...]:
        return (5,)

    def _inputs(self, batch: SensorBatch) -> list[Any]:
        errors = DopplerErrors()
        for name in DopplerErrors.vars:  # type: ignore[attr-defined]  # Warp makes the class a struct
            setattr(errors, name, getattr(self.data, name))
        return [wp.array(self.data.beams, dtype=wp.vec3d, device=batch.device), errors]
