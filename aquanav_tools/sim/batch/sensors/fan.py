"""Range rays in any number and directions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from gymnasium import spaces

from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.caves import Cave
from aquanav_tools.sim.batch.disturbance import RangeNoise, measured_range
from aquanav_tools.sim.batch.motion import rotation_of
from aquanav_tools.sim.batch.observation import Fan, make_fan
from aquanav_tools.sim.batch.rays import cast_ray, normal_at, origin_of
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.sensors.base import KernelSensor, MirrorImage, SensorBatch
from aquanav_tools.sim.batch.sensors.data_sheets import read_sheet
from aquanav_tools.sim.batch.sensors.fan_spec import PRESET_FANS, FanSpec, RangeErrors
from aquanav_tools.sim.batch.sensors.rows import chosen
from aquanav_tools.sim.batch.spheres import cast
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.vehicle_base import Vehicle

wp.set_module_options(OPTIONS)

PARTS_ON_GPU = 4
"""Threads that share the rays of a vehicle."""
SAME_RAY = 1e-6
"""Two rays are the same within this, in components and m."""
f64 = wp.float64
MIN_SLICE = 256
"""Vehicles for which a further thread is worth its start."""


def make_range_noise(errors: RangeErrors) -> RangeNoise:
    """Return errors as kernels take them."""
    noise = RangeNoise()
    noise.constant, noise.proportional = errors.constant, errors.proportional
    noise.dropout, noise.grazing_dropout = errors.dropout, errors.grazing_dropout
    noise.grazing_from = float(np.radians(errors.grazing_from_deg))
    return noise


@wp.kernel
def measure_ranges(
    first: int,
    only_restarted: int,
    stream: int,
    state: BatchState,
    caves: wp.array(dtype=Cave),
    num_parts: int,
    period: int,
    fan: Fan,
    noise: RangeNoise,
    out: wp.array2d(dtype=wp.float32),
):
    """Write each ray's distance at every `period`-th decision; an index casts a share of its vehicle's rays."""
    index = first + wp.tid()
    i = chosen(state, index // num_parts, only_restarted)
    if i < 0 or state.decisions[i] % period != 0:
        return
    cave = caves[state.cave_of[i]]
    origin = origin_of(cave, state.positions[i])
    rotation = rotation_of(state.orientations[i])
    turn = wp.mat33(rotation)
    errs = noise.constant > 0.0 or noise.proportional > 0.0 or noise.dropout > 0.0 or noise.grazing_dropout > 0.0
    for ray in range(index % num_parts, fan.lengths.shape[0], num_parts):
        length = fan.lengths[ray]
        direction = turn * fan.directions[ray]
        distance, face = float(length), wp.vec3()
        if fan.radii[ray] > f64(0.0):
            exact = rotation * fan.exact_directions[ray]
            distance = float(wp.min(cast(cave.grid, origin.position, exact, f64(length), fan.radii[ray]), f64(length)))
        else:
            come, met = cast_ray(cave, origin, direction, length)
            distance, face = come, met
        if errs:
            incidence = float(0.0)
            if noise.grazing_dropout > 0.0 and distance < length:
                normal = normal_at(cave, origin, direction, distance, face)
                incidence = wp.acos(wp.clamp(-wp.dot(normal, direction), 0.0, 1.0))
            seed, decision = state.seeds[i], state.decisions[i]
            distance = measured_range(distance, incidence, length, noise, seed, stream + ray, decision)
        out[i, ray] = distance


class RangeFan(KernelSensor):
    """The distances to the wall along a fan of rays: (N, R), m, at most the rays' lengths."""

    def __init__(self, spec: FanSpec | Mapping[str, Any] | str | Path = "paper") -> None:
        """Take a fan's data.

        Args:
            spec: "paper" for the benchmark's 28 rays, "original" for its 28 spheres, "echosounders" for those of
                `EchoSounders`, a `FanSpec`, its fields as a table, or the path of a TOML file.

        Raises:
            InputError: there is no such fan, or its data make no sense.
        """
        is_preset = isinstance(spec, str) and spec in PRESET_FANS
        self.data = PRESET_FANS[str(spec)] if is_preset else read_sheet(FanSpec, spec, "fan")
        self.pattern = self.data.pattern
        super().__init__(measure_ranges, MIN_SLICE)

    def spec(self, scenario: Scenario, vehicle: Vehicle) -> spaces.Box:
        """Return the space of (R,) distances, m."""
        lengths = self.pattern.lengths.astype(np.float32)
        return spaces.Box(np.zeros_like(lengths), lengths, dtype=np.float32)

    def mirror_image(self) -> MirrorImage:
        """Return how readings look in a mirror: each ray's from the ray on the other side.

        Raises:
            InputError: a ray has no counterpart on the other side.
        """
        pattern = self.pattern
        rays = np.column_stack([pattern.directions, pattern.lengths, pattern.radii])
        apart = np.abs(rays[:, None] * [1.0, -1.0, 1.0, 1.0, 1.0] - rays[None]).max(axis=2)
        order = apart.argmin(axis=1)
        alone = np.flatnonzero(apart.min(axis=1) > SAME_RAY)
        if len(alone):
            raise InputError(
                f"Ray {alone[0]} of the fan points to {np.round(pattern.directions[alone[0]], 3).tolist()}, and no ray "
                "of the same length to the other side: the fan has no mirror image. Add that ray, or learn without "
                "mirrored."
            )
        return order, np.ones(len(order), dtype=np.float32)

    def _work_per_vehicle(self, batch: SensorBatch) -> int:
        return 1 if batch.device.is_cpu else PARTS_ON_GPU

    def _shape(self) -> tuple[int, ...]:
        return (len(self.pattern.lengths),)

    def _memory(self) -> dict[str, Any]:
        return {"ranges": self._out} if self.data.period > 0.0 and self._out is not None else {}

    def _inputs(self, batch: SensorBatch) -> list[Any]:
        return [
            self._work_per_vehicle(batch),
            max(1, round(self.data.period / batch.decision_seconds)),
            make_fan(self.pattern, batch.device),
            make_range_noise(self.data.noise),
        ]


class EchoSounders(RangeFan):
    """16 beams around the vehicle where the paper's rays do not look: (N, 16), m, at most 4 m."""

    def __init__(self, spec: FanSpec | Mapping[str, Any] | str | Path = "echosounders") -> None:
        """Take other beams, as `RangeFan` takes them."""
        super().__init__(spec)


class Sonar3D(RangeFan):
    """117 beams ahead of the vehicle, of two 3D sonars: (N, 117), m, at most 4 m."""

    def __init__(self, spec: FanSpec | Mapping[str, Any] | str | Path = "sonar3d") -> None:
        """Take other beams, as `RangeFan` takes them."""
        super().__init__(spec)
