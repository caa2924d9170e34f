"""The motion of the original benchmark's vehicles in Warp, as in `sim/original_motion.py`."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.sim import original_motion as original
from aquanav_tools.sim.batch.motion import State, angular, linear, rotation_of, six, vec6
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.vehicle_base import GRAVITY
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
G = wp.constant(wp.float64(GRAVITY))


@wp.struct
class DraggedBody:
    """A vehicle of `sim/original.py`."""

    mass: f64
    inertia: wp.vec3d
    kept: f64
    """Share of the speed that drag leaves in a step."""
    kept_turn: f64
    max_rate: f64
    centre: wp.vec3d
    levelled: f64
    """Share of the tilt that is taken away in a step."""
    is_afloat: wp.int32
    floaters: wp.array(dtype=wp.vec3d)


def make_dragged_body(parameters: Array, dt: float, device: Any) -> DraggedBody:
    """Return the body of `original_motion.pack_original`, for steps of `dt` (s)."""
    body = DraggedBody()
    body.mass = parameters[original._MASS]
    body.inertia = wp.vec3d(*parameters[original._INERTIA : original._INERTIA + 3])
    body.kept, body.kept_turn = 1.0 - parameters[[original._DRAG, original._ANGULAR_DRAG]] * dt
    body.max_rate = parameters[original._MAX_RATE]
    body.centre = wp.vec3d(*parameters[original._CENTRE : original._CENTRE + 3])
    body.levelled = 1.0 - np.exp(-parameters[original._STABILISER] * dt)
    body.is_afloat = int(parameters[original._IS_AFLOAT])
    floaters = parameters[original._FLOATERS :].reshape(-1, 3)
    body.floaters = wp.array(floaters, dtype=wp.vec3d, device=device)
    return body


@wp.func
def levelled(state: State, share: f64):
    """Return the state turned by a share of the way to upright with the same heading; world velocities stay."""
    o = state.orientation
    before = rotation_of(o)
    heading = f64(0.5) * wp.atan2(before[1, 0], before[0, 0])
    upright = wp.vec4d(wp.cos(heading), f64(0.0), f64(0.0), wp.sin(heading))
    product = wp.dot(o, upright)
    if product < f64(0.0):
        upright = -upright
        product = -product
    angle = wp.acos(wp.min(product, f64(1.0)))
    if angle < f64(1e-9) or share == f64(0.0):
        return state
    result = State()
    result.position = state.position
    kept = wp.sin((f64(1.0) - share) * angle) / wp.sin(angle)
    result.orientation = kept * o + wp.sin(share * angle) / wp.sin(angle) * upright
    after = wp.transpose(rotation_of(result.orientation))
    result.velocity = six(after * (before * linear(state.velocity)), after * (before * angular(state.velocity)))
    return result


@wp.func
def turned(orientation: wp.vec4d, rate: wp.vec3d, dt: f64):
    """Return the orientation after a step at a constant rate of turn in the body frame."""
    angle = wp.length(rate) * dt
    half = f64(0.5) * dt
    if angle > f64(1e-9):
        half *= wp.sin(f64(0.5) * angle) / (f64(0.5) * angle)
    x, y, z, w = half * rate[0], half * rate[1], half * rate[2], wp.cos(f64(0.5) * angle)
    a, b, c, d = orientation[0], orientation[1], orientation[2], orientation[3]
    return wp.vec4d(
        a * w - b * x - c * y - d * z,
        a * x + b * w + c * z - d * y,
        a * y - b * z + c * w + d * x,
        a * z + b * y - c * x + d * w,
    )


@wp.func
def drag_along(state: State, command: vec6, surface: f64, current: wp.vec3d, body: DraggedBody, dt: f64):
    """Return the state one step later; `surface` is the height of the water's surface, m."""
    moving = levelled(state, body.levelled)
    rotation = rotation_of(moving.orientation)
    up = wp.vec3d(rotation[2, 0], rotation[2, 1], rotation[2, 2])
    force = rotation * wp.vec3d(command[0], f64(0.0), f64(0.0))
    torque = wp.vec3d(f64(0.0), f64(0.0), command[5])
    if body.is_afloat == 0:
        force[2] -= body.mass * G
        for n in range(body.floaters.shape[0]):
            depth = surface - (moving.position[2] + wp.dot(up, body.floaters[n]))
            if depth > f64(0.0):
                lift = command[2] * depth
                force[2] += lift
                torque += lift * wp.cross(body.floaters[n] - body.centre, up)
    over_ground = rotation * linear(moving.velocity)
    velocity = current + (over_ground - current + force / body.mass * dt) * body.kept
    rate = (angular(moving.velocity) + wp.cw_div(torque, body.inertia) * dt) * body.kept_turn
    if body.is_afloat > 0:
        velocity[2] = f64(0.0)
        rate = wp.vec3d(f64(0.0), f64(0.0), rate[2])
    fastest = wp.length(rate)
    if fastest > body.max_rate:
        rate *= body.max_rate / fastest
    centre = moving.position + rotation * body.centre + velocity * dt
    result = State()
    result.orientation = turned(moving.orientation, rate, dt)
    after = rotation_of(result.orientation)
    result.position = centre - after * body.centre
    result.velocity = six(wp.transpose(after) * velocity, rate)
    return result
