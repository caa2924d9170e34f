"""A forward imaging sonar: the echo of the cave by azimuth and range.

Each beam sends sub-rays over its elevation. Where one meets a wall at range r, at an angle t from the wall's normal,
what comes back is its share of the beam's power times

    cos(t) / r^2 * 10^(-absorption * r / 5)

A wall scatters by Lambert's law, in cos^2(t) per area; a sub-ray lights up an area of r^2 / cos(t) per solid angle; and
spreading takes r^-2 each way. The reference, intensity 1, is all of a beam's power back from a wall that it meets
head on at 1 m, without absorption. The echo is spread evenly over the ranges that the sub-ray's patch of wall covers,
or over one bin where that is more.

Left out: echoes over more than one wall, sound that enters a beam from beside it, and the Doppler shift.
Source: Lambert's law for rough boundaries, and the sonar equation: Urick, Principles of Underwater Sound (1983).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from gymnasium import spaces

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.caves import Cave
from aquanav_tools.sim.batch.motion import rotation_of
from aquanav_tools.sim.batch.random import share_of_one, words
from aquanav_tools.sim.batch.rays import cast_ray, normal_at, origin_of
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.sensors.base import KernelSensor, SensorBatch
from aquanav_tools.sim.batch.sensors.data_sheets import read_sheet
from aquanav_tools.sim.batch.sensors.rows import chosen
from aquanav_tools.sim.batch.sensors.sonar_sheet import SonarSheet
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.vehicle_base import Vehicle

wp.set_module_options(OPTIONS)

MIN_COSINE = wp.constant(0.02)
"""Of the angle to a wall's normal below which a patch of wall gets no longer: 1.1 degrees off the wall."""
DECIBEL = wp.constant(4.342944819)
"""10 / ln 10."""
MIN_SLICE = 32
"""Beams for which a further thread is worth its start."""


@wp.struct
class SonarNumbers:
    """`SonarSheet` as the kernel takes it."""

    num_beams: wp.int32
    num_bins: wp.int32
    min_range: wp.float32
    max_range: wp.float32
    bin_size: wp.float32
    sub_angle: wp.float32
    """Between sub-rays, rad."""
    fading: wp.float32
    """Of the intensity, both ways, per metre."""
    tvg: wp.int32
    speckle: wp.int32
    noise: wp.float32
    dynamic_range: wp.float32
    """dB."""
    directions: wp.array2d(dtype=wp.vec3)
    """(beams, sub-rays) unit vectors, body frame."""
    changes: wp.array2d(dtype=wp.vec3)
    """How they change with the elevation, per radian."""
    weights: wp.array(dtype=wp.float32)
    """(sub-rays,)."""


def make_numbers(sheet: SonarSheet, device: Any) -> SonarNumbers:
    """Return a sonar's data on a device."""
    numbers = SonarNumbers()
    for name in ("num_beams", "num_bins", "min_range", "max_range", "bin_size"):
        setattr(numbers, name, getattr(sheet, name))
    elevations = sheet.elevations
    numbers.sub_angle = float(-2.0 * elevations[0] / sheet.num_sub_rays) if len(elevations) > 1 else 0.0
    numbers.fading = 0.2 * np.log(10.0) * sheet.absorption_db_per_m
    numbers.tvg, numbers.speckle = int(sheet.tvg), int(sheet.speckle)
    numbers.noise, numbers.dynamic_range = 10.0 ** (0.1 * sheet.noise_db), sheet.dynamic_range_db
    directions, changes = sheet.directions()
    numbers.directions = wp.array(directions.astype(np.float32), dtype=wp.vec3, device=device)
    numbers.changes = wp.array(changes.astype(np.float32), dtype=wp.vec3, device=device)
    numbers.weights = wp.array(sheet.weights.astype(np.float32), dtype=wp.float32, device=device)
    return numbers


@wp.func
def spread_echo(echo: float, distance: float, extent: float, sonar: SonarNumbers, i: int, beam: int,
                out: wp.array3d(dtype=wp.float32)):  # fmt: skip
    """Add an echo evenly to the bins that its ranges reach into."""
    half = 0.5 * wp.max(extent / sonar.bin_size, 1.0)
    middle = (distance - sonar.min_range) / sonar.bin_size
    low, high = middle - half, middle + half
    density = echo / (high - low)
    last = wp.min(int(wp.floor(high)), sonar.num_bins - 1)
    for n in range(wp.max(int(wp.floor(low)), 0), last + 1):
        share = wp.min(high, float(n + 1)) - wp.max(low, float(n))
        out[i, beam, n] = out[i, beam, n] + density * wp.max(share, 0.0)


@wp.func
def shown(intensity: float, distance: float, drawn: wp.vec2, sonar: SonarNumbers):
    """Return a bin as the sonar shows it: with speckle and noise, after gain and logarithm."""
    value = intensity
    if sonar.speckle == 1:
        value *= -wp.log(drawn[0])
    if sonar.noise > 0.0:
        value -= sonar.noise * wp.log(drawn[1])
    if sonar.tvg == 1:
        value *= distance * distance * wp.exp(sonar.fading * distance)
    if sonar.dynamic_range > 0.0:
        if value <= 0.0:
            return 0.0
        value = wp.clamp(1.0 + DECIBEL * wp.log(value) / sonar.dynamic_range, 0.0, 1.0)
    return value


@wp.kernel
def measure_echoes(
    first: int,
    only_restarted: int,
    stream: int,
    state: BatchState,
    caves: wp.array(dtype=Cave),
    sonar: SonarNumbers,
    out: wp.array3d(dtype=wp.float32),
):
    """Write the bins of one beam."""
    index = first + wp.tid()
    beam = index % sonar.num_beams
    i = chosen(state, index // sonar.num_beams, only_restarted)
    if i < 0:
        return
    cave = caves[state.cave_of[i]]
    origin = origin_of(cave, state.positions[i])
    turn = wp.mat33(rotation_of(state.orientations[i]))
    for n in range(sonar.num_bins):
        out[i, beam, n] = 0.0
    for ray in range(sonar.weights.shape[0]):
        direction = turn * sonar.directions[beam, ray]
        distance, face = cast_ray(cave, origin, direction, sonar.max_range)
        if distance < sonar.max_range and distance > 0.0:
            normal = normal_at(cave, origin, direction, distance, face)
            cosine = -wp.dot(normal, direction)
            slant = wp.abs(wp.dot(normal, turn * sonar.changes[beam, ray])) / wp.max(cosine, MIN_COSINE)
            echo = sonar.weights[ray] * cosine / (distance * distance) * wp.exp(-sonar.fading * distance)
            spread_echo(echo, distance, distance * slant * sonar.sub_angle, sonar, i, beam, out)
    seed, decision = state.seeds[i], state.decisions[i]
    drawn = wp.vec4ui()
    for n in range(sonar.num_bins):
        if n % 2 == 0:
            drawn = words(seed, stream + (beam * sonar.num_bins + n) // 2, decision)
        pair = wp.vec2(share_of_one(drawn[0]), share_of_one(drawn[1]))
        if n % 2 == 1:
            pair = wp.vec2(share_of_one(drawn[2]), share_of_one(drawn[3]))
        middle = sonar.min_range + (float(n) + 0.5) * sonar.bin_size
        out[i, beam, n] = shown(out[i, beam, n], middle, pair, sonar)


class ImagingSonar(KernelSensor):
    """A ping: (N, beams, bins), beams from right to left, bins from near to far."""

    def __init__(self, sheet: SonarSheet | Mapping[str, Any] | str | Path | None = None) -> None:
        """Take a sonar's data: its sheet's name, a `SonarSheet`, its fields as a table, or the path of a TOML file.

        None takes the defaults of `SonarSheet`.

        Raises:
            InputError: there is no such sheet, or it makes no sense.
        """
        self.data = SonarSheet() if sheet is None else read_sheet(SonarSheet, sheet, "sonar")
        super().__init__(measure_echoes, MIN_SLICE)

    def spec(self, scenario: Scenario, vehicle: Vehicle) -> spaces.Box:
        """Return the space of a ping."""
        high = 1.0 if self.data.dynamic_range_db > 0.0 else np.inf
        return spaces.Box(0.0, high, self._shape(), np.float32)

    def _work_per_vehicle(self, batch: SensorBatch) -> int:
        return self.data.num_beams

    def _shape(self) -> tuple[int, ...]:
        return (self.data.num_beams, self.data.num_bins)

    def _inputs(self, batch: SensorBatch) -> list[Any]:
        return [make_numbers(self.data, batch.device)]
