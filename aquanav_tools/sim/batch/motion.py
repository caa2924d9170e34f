"""Fossen's motion in Warp: the equations, splitting and order of `sim/hydrodynamics.py`, in float64 as there.

What a step only looks up there is prepared here once: the factors of the exact damping flow for half a step.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.sim import hydrodynamics as hydro
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
vec6 = wp.types.vector(length=6, dtype=wp.float64)
mat6 = wp.types.matrix(shape=(6, 6), dtype=wp.float64)
MAX_ANGLE = wp.constant(wp.float64(hydro.MAX_ANGLE))


@wp.struct
class State:
    """Where a vehicle is and how it moves; also the change of these in time."""

    position: wp.vec3d
    orientation: wp.vec4d
    velocity: vec6


@wp.struct
class Body:
    """A vehicle of `sim/fossen.py` in its water."""

    weight: f64
    arm: wp.vec3d
    mass: vec6
    mobility: vec6
    decay: vec6
    span: vec6
    drag: vec6
    briskness: f64
    is_coupled: wp.int32
    matrix: wp.array(dtype=mat6)
    """(2,) the mass matrix and its inverse; read only where axes are coupled."""
    rate_gain: wp.vec3d
    level_gain: f64
    left: f64
    mean_left: f64
    num_thrusters: wp.int32
    thrusters: wp.array2d(dtype=f64)
    """(T, 14) as `hydrodynamics.pack_parameters` has them."""


def make_body(parameters: Array, dt: float, device: Any) -> Body:
    """Return the body of `hydrodynamics.pack_parameters`, for steps of `dt` (s)."""
    body = Body()
    matrix = parameters[hydro._MATRIX : hydro._MATRIX + 36].reshape(6, 6)
    inverse = parameters[hydro._INVERSE : hydro._INVERSE + 36].reshape(6, 6)
    is_coupled = parameters[hydro._IS_COUPLED] > 0.0
    mobility = np.diag(inverse) if is_coupled else 1.0 / np.diag(matrix)
    rate, half = parameters[hydro._LINEAR : hydro._LINEAR + 6] * mobility, 0.5 * dt
    decay = np.exp(-rate * half)
    body.weight = parameters[hydro._WEIGHT]
    body.arm = wp.vec3d(*parameters[hydro._ARM : hydro._ARM + 3])
    body.mass, body.mobility, body.decay = vec6(*np.diag(matrix)), vec6(*mobility), vec6(*decay)
    body.span = vec6(*np.where(rate > 1e-12, (1.0 - decay) / np.maximum(rate, 1e-12), half))
    body.drag = vec6(*(parameters[hydro._QUADRATIC : hydro._QUADRATIC + 6] * mobility))
    body.briskness, body.is_coupled = parameters[hydro._BRISKNESS], int(is_coupled)
    body.matrix = wp.array(np.stack([matrix, inverse]), dtype=mat6, device=device)
    body.rate_gain = wp.vec3d(*parameters[hydro._RATE_GAIN : hydro._RATE_GAIN + 3])
    body.level_gain, lag = parameters[hydro._LEVEL_GAIN], parameters[hydro._LAG]
    body.left = np.exp(-dt / lag) if lag > 0.0 else 0.0
    body.mean_left = (1.0 - body.left) * lag / dt
    body.num_thrusters = int(parameters[hydro._NUM_THRUSTERS])
    rows = parameters[hydro._THRUSTERS :].reshape(-1, hydro._PER_THRUSTER)
    body.thrusters = wp.array(rows, dtype=wp.float64, ndim=2, device=device)
    return body


@wp.func
def rotation_of(q: wp.vec4d):
    """Return the matrix world from body; the quaternion's length does not matter."""
    w, x, y, z = q[0], q[1], q[2], q[3]
    s = f64(2.0) / (w * w + x * x + y * y + z * z)
    one = f64(1.0)
    return wp.mat33d(
        one - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w),
        s * (x * y + z * w), one - s * (x * x + z * z), s * (y * z - x * w),
        s * (x * z - y * w), s * (y * z + x * w), one - s * (x * x + y * y),
    )  # fmt: skip


@wp.func
def linear(velocity: vec6):
    """Return the first three components."""
    return wp.vec3d(velocity[0], velocity[1], velocity[2])


@wp.func
def angular(velocity: vec6):
    """Return the last three components."""
    return wp.vec3d(velocity[3], velocity[4], velocity[5])


@wp.func
def six(first: wp.vec3d, last: wp.vec3d):
    """Return two vectors of three as one of six."""
    return vec6(first[0], first[1], first[2], last[0], last[1], last[2])


@wp.func
def shifted(velocity: vec6, orientation: wp.vec4d, current: wp.vec3d):
    """Return the velocity with a current, given in the world, added in the body frame."""
    return six(linear(velocity) + wp.transpose(rotation_of(orientation)) * current, angular(velocity))


@wp.func
def slowed(speed: f64, axis: int, body: Body):
    """Return where half a step of the exact damping flow of one axis takes a speed."""
    return speed * body.decay[axis] / (f64(1.0) + body.drag[axis] * wp.abs(speed) * body.span[axis])


@wp.func
def damped(velocity: vec6, body: Body, is_backward: int):
    """Return the velocity after half a step of damping, axis by axis."""
    result = velocity
    if body.is_coupled == 0:
        for axis in range(6):
            result[axis] = slowed(velocity[axis], axis, body)
    else:
        inverse = body.matrix[1]
        for n in range(6):
            axis = n
            if is_backward == 1:
                axis = 5 - n
            change = (slowed(result[axis], axis, body) - result[axis]) / body.mobility[axis]
            for other in range(6):
                result[other] += change * inverse[other, axis]
    return result


@wp.func
def load(velocity: vec6, momentum: vec6, up: wp.vec3d, body: Body):
    """Return the Coriolis and restoring wrench of a body with six components of momentum."""
    pushing, turning = linear(momentum), angular(velocity)
    force = wp.cross(pushing, turning) - body.weight * up
    moment = wp.cross(angular(momentum), turning) + wp.cross(pushing, linear(velocity)) + wp.cross(body.arm, up)
    return six(force, moment)


@wp.func
def slope(state: State, wrench: vec6, current: wp.vec3d, body: Body):
    """Return the time derivative without damping; the velocity is the one through the water."""
    v, o = state.velocity, state.orientation
    w, x, y, z = o[0], o[1], o[2], o[3]
    p, q, r = v[3], v[4], v[5]
    half = f64(0.5)
    rotation = rotation_of(o)
    up = wp.vec3d(rotation[2, 0], rotation[2, 1], rotation[2, 2])
    change = State()
    change.position = rotation * linear(v) + current
    change.orientation = half * wp.vec4d(
        -x * p - y * q - z * r, w * p + y * r - z * q, w * q + z * p - x * r, w * r + x * q - y * p
    )
    if body.is_coupled == 0:
        acting = wrench + load(v, wp.cw_mul(body.mass, v), up, body)
        change.velocity = wp.cw_mul(body.mobility, acting)
    else:
        change.velocity = body.matrix[1] * (wrench + load(v, body.matrix[0] * v, up, body))
    return change


@wp.func
def moved(state: State, change: State, duration: f64):
    """Return the state after `duration` of a constant change."""
    result = State()
    result.position = state.position + duration * change.position
    result.orientation = state.orientation + duration * change.orientation
    result.velocity = state.velocity + duration * change.velocity
    return result


@wp.func
def runge_kutta(state: State, wrench: vec6, current: wp.vec3d, body: Body, dt: f64):
    """Return the state after a classical fourth-order step of everything but damping."""
    first = slope(state, wrench, current, body)
    second = slope(moved(state, first, f64(0.5) * dt), wrench, current, body)
    third = slope(moved(state, second, f64(0.5) * dt), wrench, current, body)
    fourth = slope(moved(state, third, dt), wrench, current, body)
    sixth, third_part = dt / f64(6.0), dt / f64(3.0)
    result = moved(moved(state, first, sixth), second, third_part)
    result = moved(moved(result, third, third_part), fourth, sixth)
    result.orientation = wp.normalize(result.orientation)
    return result


@wp.func
def thrust(state: State, asked: vec6, body: Body, forces: wp.array2d(dtype=f64), vehicle: int):
    """Let the thrusters' forces follow what is asked for, in place, and return the mean wrench of the step."""
    rotation = rotation_of(state.orientation)
    wanted = asked
    for axis in range(3):
        wanted[3 + axis] -= body.rate_gain[axis] * state.velocity[3 + axis]
    wanted[3] -= body.level_gain * rotation[2, 1]
    wanted[4] += body.level_gain * rotation[2, 0]
    acting = vec6()
    for n in range(body.num_thrusters):
        command = f64(0.0)
        for axis in range(6):
            command += body.thrusters[n, 6 + axis] * wanted[axis]
        command = wp.clamp(command, -body.thrusters[n, 12], body.thrusters[n, 13])
        difference = forces[vehicle, n] - command
        for axis in range(6):
            acting[axis] += body.thrusters[n, axis] * (command + body.mean_left * difference)
        forces[vehicle, n] = command + body.left * difference
    return acting


@wp.func
def swim(state: State, wrench: vec6, current: wp.vec3d, body: Body, dt: f64):
    """Return the state one step of the Strang splitting later."""
    moving = state
    moving.velocity = damped(shifted(state.velocity, state.orientation, -current), body, 0)
    angle = dt * (wp.length(angular(moving.velocity)) + body.briskness * wp.length(linear(moving.velocity)))
    parts = 1 + int(wp.min(angle, f64(1000.0)) / MAX_ANGLE)
    for _ in range(parts):
        moving = runge_kutta(moving, wrench, current, body, dt / f64(parts))
    moving.velocity = shifted(damped(moving.velocity, body, 1), moving.orientation, current)
    return moving
