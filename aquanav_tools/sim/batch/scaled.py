"""How observations of caves and of bays scale speeds, distances and the goal's direction, in Warp."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.runtime import OPTIONS

wp.set_module_options(OPTIONS)

f64 = wp.float64
PI = wp.constant(wp.float64(3.141592653589793))


@wp.func
def soft(value: f64, scale: f64):
    """Return value / (|value| + scale), in (-1, 1)."""
    return value / (wp.abs(value) + scale)


@wp.func
def within(value: f64):
    """Return a value, or the nearest of -1 and 1, as observations have it."""
    return wp.float32(wp.clamp(value, f64(-1.0), f64(1.0)))


@wp.func
def azimuth_to(east: f64, north: f64, rotation: wp.mat33d):
    """Return the angle from the horizontal heading to an offset, rad, left positive, in [-pi, pi]."""
    azimuth = wp.atan2(north, east) - wp.atan2(rotation[1, 0], rotation[0, 0])
    return azimuth - f64(2.0) * PI * wp.rint(azimuth / (f64(2.0) * PI))


@wp.func
def shown_direction(offset: wp.vec3d, rotation: wp.mat33d):
    """Return the azimuth / pi and elevation / (pi / 2) of an offset, as observations have a goal's."""
    flat = wp.sqrt(offset[0] * offset[0] + offset[1] * offset[1])
    elevation = wp.atan2(offset[2], flat) / (f64(0.5) * PI)
    return wp.vec2(within(azimuth_to(offset[0], offset[1], rotation) / PI), within(elevation))
