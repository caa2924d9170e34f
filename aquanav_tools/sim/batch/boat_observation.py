"""What a boat's agent sees, in Warp: the presets "paper" and "full" of `envs.surface_observation`."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.motion import vec6
from aquanav_tools.sim.batch.runtime import BOAT_OPTIONS
from aquanav_tools.sim.batch.scaled import PI, azimuth_to, soft, within

wp.set_module_options(BOAT_OPTIONS)

f64 = wp.float64


@wp.func
def put(out: wp.array(dtype=wp.float32), n: int, value: f64):
    """Write a value of an observation, within [-1, 1]."""
    out[n] = within(value)


@wp.func
def show_goal(
    out: wp.array(dtype=wp.float32), first: int, position: wp.vec3d, rotation: wp.mat33d, goal: wp.vec2d, scale: f64
):
    """Write distance and azimuth of the goal."""
    offset = goal - wp.vec2d(position[0], position[1])
    put(out, first, soft(wp.length(offset), scale))
    put(out, first + 1, azimuth_to(offset[0], offset[1], rotation) / PI)


@wp.func
def show_motion(
    out: wp.array(dtype=wp.float32), first: int, rotation: wp.mat33d, velocity: vec6,
    command: wp.array(dtype=wp.float32), scales: wp.vec3d,
):  # fmt: skip
    """Write surge and sway, turn, tilt, and the last steer and thrust."""
    put(out, first, soft(velocity[0], scales[1]))
    put(out, first + 1, soft(velocity[1], scales[1]))
    put(out, first + 2, soft(velocity[5], scales[2]))
    put(out, first + 3, rotation[2, 0])
    put(out, first + 4, rotation[2, 1])
    put(out, first + 5, f64(command[1]))
    put(out, first + 6, f64(command[2]))
