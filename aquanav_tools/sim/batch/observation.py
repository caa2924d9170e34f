"""What the agent sees, in Warp: the tables of `envs/observation.py`."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.sim import scales
from aquanav_tools.sim.batch.actuators import trim_of
from aquanav_tools.sim.batch.craft import Craft
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.scaled import shown_direction, soft, within
from aquanav_tools.sim.batch.state import BatchState
from aquanav_tools.sim.sensors import RayPattern

wp.set_module_options(OPTIONS)

f64 = wp.float64
DISTANCE_SCALE, SPEED_SCALE, RATE_SCALE = (
    wp.constant(wp.float64(value)) for value in (scales.DISTANCE_SCALE, scales.SPEED_SCALE, scales.RATE_SCALE)
)
PRESETS = ("paper", "full", "original")
PAPER, FULL, ORIGINAL = (wp.constant(n) for n in range(3))


@wp.struct
class Fan:
    """A pattern of rays."""

    directions: wp.array(dtype=wp.vec3)
    """Body frame."""
    exact_directions: wp.array(dtype=wp.vec3d)
    lengths: wp.array(dtype=wp.float32)
    """m."""
    radii: wp.array(dtype=f64)
    """Of the spheres that the original casts along the rays, m."""


def make_fan(pattern: RayPattern, device: Any) -> Fan:
    """Return a pattern of rays on a device."""
    fan = Fan()
    fan.directions = wp.array(pattern.directions.astype(np.float32), dtype=wp.vec3, device=device)
    fan.exact_directions = wp.array(pattern.directions, dtype=wp.vec3d, device=device)
    fan.lengths = wp.array(pattern.lengths.astype(np.float32), dtype=wp.float32, device=device)
    fan.radii = wp.array(pattern.radii, dtype=wp.float64, device=device)
    return fan


@wp.func
def show_goal(i: int, first: int, state: BatchState, goal: wp.vec3d, rotation: wp.mat33d):
    """Write the goal's distance, azimuth and elevation from place `first` on."""
    offset = goal - state.positions[i]
    state.observations[i, first] = wp.float32(soft(wp.length(offset), DISTANCE_SCALE))
    direction = shown_direction(offset, rotation)
    state.observations[i, first + 1] = direction[0]
    state.observations[i, first + 2] = direction[1]


@wp.func
def show_motion(i: int, first: int, state: BatchState, craft: Craft, entrance_height: f64, rotation: wp.mat33d):
    """Write what the full observation has behind the goal, from place `first` on."""
    velocity = state.velocities[i]
    for axis in range(3):
        state.observations[i, first + axis] = wp.float32(soft(velocity[axis], SPEED_SCALE))
        state.observations[i, first + 3 + axis] = wp.float32(soft(velocity[3 + axis], RATE_SCALE))
        state.observations[i, first + 10 + axis] = state.commands[i, axis]
    state.observations[i, first + 6] = wp.float32(soft(entrance_height - state.positions[i][2], DISTANCE_SCALE))
    state.observations[i, first + 7] = within(rotation[2, 0])
    state.observations[i, first + 8] = within(rotation[2, 1])
    state.observations[i, first + 9] = within(trim_of(state.levels[i], craft.controls))
