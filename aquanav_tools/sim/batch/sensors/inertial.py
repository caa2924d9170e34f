"""An inertial measurement unit: specific force and rate of turn in the body frame."""

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
from aquanav_tools.sim.batch.motion import angular, linear, rotation_of
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.sensors.base import KernelSensor, SensorBatch
from aquanav_tools.sim.batch.sensors.data_sheets import check_range, read_sheet
from aquanav_tools.sim.batch.sensors.noise import ONCE, normal_vector
from aquanav_tools.sim.batch.sensors.rows import chosen
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.vehicle_base import GRAVITY, Vehicle

wp.set_module_options(OPTIONS)

f64 = wp.float64
G = wp.constant(wp.float64(GRAVITY))
MILLI_G = 1e-3 * 9.80665
"""Data sheets count in standard gravity, m/s^2."""
MIN_SLICE = 2048
"""Vehicles for which a further thread is worth its start."""


@dataclass(frozen=True)
class AccelerometerSheet:
    """An accelerometer's data sheet, in the units of data sheets; standard deviations per axis."""

    full_scale_g: float
    noise_density_ug: float = 0.0
    """Micro-g per square root of a hertz."""
    bias_mg: float = 0.0
    """Of a device, from turn-on to turn-on."""
    in_run_bias_mg: float = 0.0
    """By which the bias has walked after `in_run_time`."""
    in_run_time: float = 100.0
    """s."""
    scale_error: float = 0.0

    def __post_init__(self) -> None:
        check_range("accelerometer", "full_scale_g", self.full_scale_g, 1e-3, 1000.0)
        check_range("accelerometer", "noise_density_ug", self.noise_density_ug, 0.0, 1e6)
        check_range("accelerometer", "bias_mg", self.bias_mg, 0.0, 1e3 * self.full_scale_g)
        check_range("accelerometer", "in_run_bias_mg", self.in_run_bias_mg, 0.0, 1e3 * self.full_scale_g)
        check_range("accelerometer", "in_run_time", self.in_run_time, 1e-3, 1e6)
        check_range("accelerometer", "scale_error", self.scale_error, 0.0, 1.0)


@dataclass(frozen=True)
class GyroscopeSheet:
    """A gyroscope's data sheet, in the units of data sheets; standard deviations per axis."""

    full_scale_deg_per_s: float
    noise_density_mdps: float = 0.0
    """Thousandths of a degree per second, per square root of a hertz."""
    bias_deg_per_s: float = 0.0
    """Of a device, from turn-on to turn-on."""
    in_run_bias_deg_per_h: float = 0.0
    """By which the bias has walked after `in_run_time`."""
    in_run_time: float = 100.0
    """s."""
    scale_error: float = 0.0

    def __post_init__(self) -> None:
        check_range("gyroscope", "full_scale_deg_per_s", self.full_scale_deg_per_s, 1e-3, 1e5)
        check_range("gyroscope", "noise_density_mdps", self.noise_density_mdps, 0.0, 1e6)
        check_range("gyroscope", "bias_deg_per_s", self.bias_deg_per_s, 0.0, self.full_scale_deg_per_s)
        check_range("gyroscope", "in_run_bias_deg_per_h", self.in_run_bias_deg_per_h, 0.0, 1e6)
        check_range("gyroscope", "in_run_time", self.in_run_time, 1e-3, 1e6)
        check_range("gyroscope", "scale_error", self.scale_error, 0.0, 1.0)


@dataclass(frozen=True)
class InertialSheet:
    """The data sheet of an inertial measurement unit."""

    accelerometer: AccelerometerSheet
    gyroscope: GyroscopeSheet
    product: str = ""
    source: str = ""


@wp.struct
class TriadErrors:
    """How three orthogonal axes err, SI units."""

    full_scale: wp.float32
    noise: wp.float32
    """Standard deviation of a reading's mean over a decision."""
    bias: wp.float32
    walk: wp.float32
    """Standard deviation of the bias' step from decision to decision."""
    scale_error: wp.float32


def make_triads(sheet: InertialSheet, seconds: float) -> tuple[TriadErrors, TriadErrors]:
    """Return a data sheet's accelerometer and gyroscope for readings that are means over some seconds."""
    accelerometer, gyroscope = TriadErrors(), TriadErrors()
    force, turn = sheet.accelerometer, sheet.gyroscope
    accelerometer.full_scale, accelerometer.scale_error = 1e3 * MILLI_G * force.full_scale_g, force.scale_error
    accelerometer.noise = 1e-3 * MILLI_G * force.noise_density_ug / np.sqrt(seconds)
    accelerometer.bias = MILLI_G * force.bias_mg
    accelerometer.walk = MILLI_G * force.in_run_bias_mg * np.sqrt(seconds / force.in_run_time)
    gyroscope.full_scale, gyroscope.scale_error = np.radians(turn.full_scale_deg_per_s), turn.scale_error
    gyroscope.noise = np.radians(1e-3 * turn.noise_density_mdps) / np.sqrt(seconds)
    gyroscope.bias = np.radians(turn.bias_deg_per_s)
    gyroscope.walk = np.radians(turn.in_run_bias_deg_per_h / 3600.0) * np.sqrt(seconds / turn.in_run_time)
    return accelerometer, gyroscope


@wp.struct
class InertialMemory:
    """What a unit knows of the decision before, (N,) each."""

    decisions: wp.array(dtype=wp.int32)
    """At which it was last measured; -1 before the first."""
    velocities: wp.array(dtype=wp.vec3d)
    """Over ground, world frame, one decision before `decisions`, m/s."""
    latest: wp.array(dtype=wp.vec3d)
    """The same at `decisions`."""
    force_bias: wp.array(dtype=wp.vec3)
    turn_bias: wp.array(dtype=wp.vec3)


@wp.func
def erring(true: wp.vec3, bias: wp.vec3, errors: TriadErrors, seed: int, purpose: int, decision: int):
    """Return the reading of three axes."""
    device = normal_vector(seed, purpose + 1, ONCE)
    noise = normal_vector(seed, purpose + 2, decision)
    result = wp.vec3()
    for axis in range(3):
        read = (1.0 + errors.scale_error * device[axis]) * true[axis] + bias[axis] + errors.noise * noise[axis]
        result[axis] = wp.clamp(read, -errors.full_scale, errors.full_scale)
    return result


@wp.func
def remember(i: int, velocity: wp.vec3d, state: BatchState, stream: int, memory: InertialMemory,
                  accelerometer: TriadErrors, gyroscope: TriadErrors):  # fmt: skip
    """Bring a vehicle's memory to the decision at hand; nothing changes where it is there."""
    seed, decision = state.seeds[i], state.decisions[i]
    if decision == 0:
        memory.latest[i] = velocity
        memory.velocities[i] = velocity
        memory.force_bias[i] = accelerometer.bias * normal_vector(seed, stream, ONCE)
        memory.turn_bias[i] = gyroscope.bias * normal_vector(seed, stream + 4, ONCE)
    elif memory.decisions[i] != decision:
        memory.velocities[i] = memory.latest[i]
        memory.latest[i] = velocity
        memory.force_bias[i] = memory.force_bias[i] + accelerometer.walk * normal_vector(seed, stream, decision)
        memory.turn_bias[i] = memory.turn_bias[i] + gyroscope.walk * normal_vector(seed, stream + 4, decision)
    memory.decisions[i] = decision


@wp.kernel
def measure_inertia(
    first: int,
    only_restarted: int,
    stream: int,
    state: BatchState,
    caves: wp.array(dtype=Cave),
    seconds: f64,
    accelerometer: TriadErrors,
    gyroscope: TriadErrors,
    memory: InertialMemory,
    out: wp.array2d(dtype=wp.float32),
):
    """Write specific force and rate of turn."""
    i = chosen(state, first + wp.tid(), only_restarted)
    if i < 0:
        return
    turn = rotation_of(state.orientations[i])
    velocity = turn * linear(state.velocities[i])
    remember(i, velocity, state, stream, memory, accelerometer, gyroscope)
    acceleration = (memory.latest[i] - memory.velocities[i]) / seconds
    force = wp.transpose(turn) * (acceleration + wp.vec3d(f64(0.0), f64(0.0), G))
    seed, decision = state.seeds[i], state.decisions[i]
    felt = erring(wp.vec3(force), memory.force_bias[i], accelerometer, seed, stream, decision)
    turning = wp.vec3(angular(state.velocities[i]))
    turned = erring(turning, memory.turn_bias[i], gyroscope, seed, stream + 4, decision)
    for axis in range(3):
        out[i, axis] = felt[axis]
        out[i, 3 + axis] = turned[axis]


class InertialUnit(KernelSensor):
    """Specific force, m/s^2, and rate of turn, rad/s, in the body frame: (N, 6).

    The force is its mean over the decision that has ended, from the change of the velocity over ground, and holds what
    carries the vehicle against its weight: at rest and level it is (0, 0, 9.81). It wants to be measured once after
    every decision.
    """

    def __init__(self, sheet: InertialSheet | Mapping[str, Any] | str | Path = "icm-20602") -> None:
        """Take a data sheet: its name, an `InertialSheet`, its fields as a table, or the path of a TOML file.

        Raises:
            InputError: there is no such sheet, or it makes no sense.
        """
        self.data = read_sheet(InertialSheet, sheet, "imu")
        self._kept: dict[str, Any] = {}
        super().__init__(measure_inertia, MIN_SLICE)

    def spec(self, scenario: Scenario, vehicle: Vehicle) -> spaces.Box:
        """Return the space of a reading."""
        triads = make_triads(self.data, 1.0)
        high = np.repeat([triad.full_scale for triad in triads], 3).astype(np.float32)
        return spaces.Box(-high, high, dtype=np.float32)

    def _shape(self) -> tuple[int, ...]:
        return (6,)

    def _memory(self) -> dict[str, Any]:
        return self._kept

    def _inputs(self, batch: SensorBatch) -> list[Any]:
        memory = InertialMemory()
        for name, field in InertialMemory.vars.items():  # type: ignore[attr-defined]  # Warp makes the class a struct
            self._kept[name] = wp.zeros(batch.num, dtype=field.type.dtype, device=batch.device)
            setattr(memory, name, self._kept[name])
        memory.decisions.fill_(-1)
        return [batch.decision_seconds, *make_triads(self.data, batch.decision_seconds), memory]
