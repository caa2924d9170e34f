"""The observation "original" in Warp, of vehicles under water and boats: the tables are in `envs.observation`."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim import scales, sensors
from aquanav_tools.sim.batch.motion import angular, linear, rotation_of, vec6
from aquanav_tools.sim.batch.runtime import OPTIONS

wp.set_module_options(OPTIONS)

f64 = wp.float64
DEGREES = wp.constant(wp.float64(57.29577951308232))
MIN_MOTION = wp.constant(wp.float64(scales.MIN_MOTION))
WALL, START_WALL, NOTHING = (wp.constant(tag) for tag in (sensors.WALL, sensors.START_WALL, sensors.NOTHING))


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
    orientation_before: wp.vec4d, goal: wp.vec3d,
):  # fmt: skip
    """Write what "original" has behind its rays: the goal's angles of one physics step ago, and the motion."""
    show_angles(out, first, position_before, rotation_of(orientation_before), goal)
    rotation = rotation_of(orientation)
    show_direction(out, first + 2, rotation * linear(velocity), f64(1.0))
    show_direction(out, first + 5, rotation * angular(velocity), f64(-1.0))  # turns change sign in a left-handed frame
