"""What a boat's agent sees, in Warp: the presets "paper", "full" and "original" of `envs.surface_observation`."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim import scales, sensors
from aquanav_tools.sim.batch.motion import angular, linear, rotation_of, vec6
from aquanav_tools.sim.batch.runtime import BOAT_OPTIONS

wp.set_module_options(BOAT_OPTIONS)

f64 = wp.float64
PI = wp.constant(wp.float64(3.141592653589793))
DEGREES = wp.constant(wp.float64(57.29577951308232))
MIN_MOTION = wp.constant(wp.float64(scales.MIN_MOTION))
WALL, START_WALL, NOTHING = (wp.constant(tag) for tag in (sensors.WALL, sensors.START_WALL, sensors.NOTHING))


@wp.func
def soft(value: f64, scale: f64):
    """Return value / (|value| + scale), in (-1, 1)."""
    return value / (wp.abs(value) + scale)


@wp.func
def azimuth_to(offset: wp.vec2d, rotation: wp.mat33d):
    """Return the angle from the horizontal heading to an offset, rad, left positive, in [-pi, pi]."""
    azimuth = wp.atan2(offset[1], offset[0]) - wp.atan2(rotation[1, 0], rotation[0, 0])
    return azimuth - f64(2.0) * PI * wp.rint(azimuth / (f64(2.0) * PI))


@wp.func
def put(out: wp.array(dtype=wp.float32), n: int, value: f64):
    """Write a value of an observation, within [-1, 1]."""
    out[n] = wp.float32(wp.clamp(value, f64(-1.0), f64(1.0)))


@wp.func
def show_goal(
    out: wp.array(dtype=wp.float32), first: int, position: wp.vec3d, rotation: wp.mat33d, goal: wp.vec2d, scale: f64
):
    """Write distance and azimuth of the goal."""
    offset = goal - wp.vec2d(position[0], position[1])
    put(out, first, soft(wp.length(offset), scale))
    put(out, first + 1, azimuth_to(offset, rotation) / PI)


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


@wp.func
def sign_of(value: f64):
    """Return -1, 0 or 1."""
    return f64(value > f64(0.0)) - f64(value < f64(0.0))


@wp.func
def show_angles(out: wp.array(dtype=wp.float32), first: int, position: wp.vec3d, rotation: wp.mat33d, goal: wp.vec3d):
    """Write the original's heading and elevation to the goal, degrees; 0 where they are not defined."""
    offset, zero, one = goal - position, f64(0.0), f64(1.0)
    flat = wp.sqrt(offset[0] * offset[0] + offset[1] * offset[1])
    distance = wp.length(offset)
    heading, elevation = zero, zero
    if flat > zero:
        ahead = (offset[0] * rotation[0, 0] + offset[1] * rotation[1, 0]) / flat
        right = offset[0] * rotation[1, 0] - offset[1] * rotation[0, 0]
        heading = DEGREES * wp.acos(wp.clamp(ahead, -one, one)) * sign_of(right)
    if distance > zero:
        above = wp.dot(offset, wp.vec3d(rotation[0, 2], rotation[1, 2], rotation[2, 2])) / distance
        elevation = DEGREES * wp.asin(wp.clamp(above, -one, one))
    out[first] = wp.float32(heading)
    out[first + 1] = wp.float32(elevation)


@wp.func
def show_direction(out: wp.array(dtype=wp.float32), first: int, vector: wp.vec3d, sign: f64):
    """Write the unit vector of a world vector in the original's axes: left-handed, x right, y up, z ahead."""
    length, scale = wp.length(vector), f64(0.0)
    if length > MIN_MOTION:
        scale = sign / length
    out[first] = wp.float32(scale * vector[1])
    out[first + 1] = wp.float32(scale * vector[2])
    out[first + 2] = wp.float32(-scale * vector[0])


@wp.func
def show_tag(out: wp.array(dtype=wp.float32), ray: int, distance: float, length: f64, tag: int):
    """Write the original's four values of a ray: met the wall, the wall behind the start, nothing; and how far."""
    out[4 * ray] = wp.float32(tag == WALL)
    out[4 * ray + 1] = wp.float32(tag == START_WALL)
    out[4 * ray + 2] = wp.float32(tag == NOTHING)
    out[4 * ray + 3] = wp.float32(f64(distance) / length)


@wp.func
def show_original(
    out: wp.array(dtype=wp.float32), first: int, orientation: wp.vec4d, velocity: vec6, position_before: wp.vec3d,
    orientation_before: wp.vec4d, goal: wp.vec2d,
):  # fmt: skip
    """Write what "original" has behind its rays: the goal's angles, one step old, at the boat's height; and motion."""
    at = wp.vec3d(goal[0], goal[1], position_before[2])
    show_angles(out, first, position_before, rotation_of(orientation_before), at)
    rotation = rotation_of(orientation)
    show_direction(out, first + 2, rotation * linear(velocity), f64(1.0))
    show_direction(out, first + 5, rotation * angular(velocity), f64(-1.0))  # turns change sign in a left-handed frame
