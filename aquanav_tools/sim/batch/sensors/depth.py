"""A depth cell: depth from the water's pressure."""

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
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.sensors.base import KernelSensor, MirrorImage, SensorBatch
from aquanav_tools.sim.batch.sensors.data_sheets import check_range, read_sheet
from aquanav_tools.sim.batch.sensors.noise import ONCE, normals
from aquanav_tools.sim.batch.sensors.rows import chosen
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.vehicle_base import Vehicle

wp.set_module_options(OPTIONS)

MIN_SLICE = 4096
"""Vehicles for which a further thread is worth its start."""


@dataclass(frozen=True)
class DepthSheet:
    """A depth cell's data sheet; metres of water, standard deviations."""

    full_scale: float
    """Readings end at plus and minus this, m."""
    scale_error: float = 0.0
    """Of a device, m/m."""
    bias: float = 0.0
    """Of a device, m."""
    noise: float = 0.0
    """Of a reading, m."""
    resolution: float = 0.0
    """Step of the readings, m; 0 for none."""
    product: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        check_range("depth cell", "full_scale", self.full_scale, 1e-3, 12000.0)
        check_range("depth cell", "scale_error", self.scale_error, 0.0, 1.0)
        for name in ("bias", "noise", "resolution"):
            check_range("depth cell", name, getattr(self, name), 0.0, self.full_scale)


@wp.struct
class DepthErrors:
    """`DepthSheet` as the kernel takes it."""

    full_scale: wp.float32
    scale_error: wp.float32
    bias: wp.float32
    noise: wp.float32
    resolution: wp.float32


@wp.kernel
def measure_depth(
    first: int,
    only_restarted: int,
    stream: int,
    state: BatchState,
    caves: wp.array(dtype=Cave),
    errors: DepthErrors,
    out: wp.array2d(dtype=wp.float32),
):
    """Write the depth below the entrance of each vehicle's cave."""
    i = chosen(state, first + wp.tid(), only_restarted)
    if i < 0:
        return
    cave = caves[state.cave_of[i]]
    device = normals(state.seeds[i], stream, ONCE)
    drawn = normals(state.seeds[i], stream, state.decisions[i])
    depth = float(cave.rules.entrance_height - state.positions[i][2])
    read = (1.0 + errors.scale_error * device[0]) * depth + errors.bias * device[1] + errors.noise * drawn[0]
    if errors.resolution > 0.0:
        read = errors.resolution * wp.rint(read / errors.resolution)
    out[i, 0] = wp.clamp(read, -errors.full_scale, errors.full_scale)


class DepthCell(KernelSensor):
    """Depth below the cave's entrance, as the observation "full" counts it: (N, 1), m."""

    def __init__(self, sheet: DepthSheet | Mapping[str, Any] | str | Path = "ms5837-30ba") -> None:
        """Take a data sheet: its name, a `DepthSheet`, its fields as a table, or the path of a TOML file.

        Raises:
            InputError: there is no such sheet, or it makes no sense.
        """
        self.data = read_sheet(DepthSheet, sheet, "depth")
        super().__init__(measure_depth, MIN_SLICE)

    def spec(self, scenario: Scenario, vehicle: Vehicle) -> spaces.Box:
        """Return the space of (1,) depth, m."""
        return spaces.Box(-self.data.full_scale, self.data.full_scale, (1,), np.float32)

    def mirror_image(self) -> MirrorImage:
        """Return how readings look in a mirror: as they are."""
        return np.zeros(1, dtype=np.int64), np.ones(1, dtype=np.float32)

    def _shape(self) -> tuple[int, ...]:
        return (1,)

    def _inputs(self, batch: SensorBatch) -> list[Any]:
        errors = DepthErrors()
        for name in DepthErrors.vars:  # type: ignore[attr-defined]  # Warp makes the class a struct
            setattr(errors, name, getattr(self.data, name))
        return [errors]
