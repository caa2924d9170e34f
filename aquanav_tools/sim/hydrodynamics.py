"""Six-degree-of-freedom motion of a rigid body in water, after Fossen.

    M v' + C(v) v + D(v) v + g(q) = wrench,   v = velocity through the water, body frame

M is the diagonal sum of rigid-body and added mass, C its Coriolis matrix, D linear and quadratic damping, g weight and
buoyancy. The frame is x ahead, y left, z up; Fossen's (y right, z down) is half a turn about x away, under which
diagonal M and D and the form of C do not change.

A step is a Strang splitting: half a step of the exact damping flow, a Runge-Kutta step of everything else, half a step
of damping. Damping is stiff and must never add energy; its exact flow keeps both promises at any dt. Coriolis and
restoring forces keep the energy, which fourth-order Runge-Kutta does to about 1e-6 over 10 s at dt = 0.02.

Source: Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control (2011), chapters 6 to 8.
"""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.types import Array

STATE_SIZE = 13
"""A state is position (3,) in the world, quaternion (w, x, y, z) world from body, velocity (6,) in the body frame."""

_MASS, _LINEAR, _QUADRATIC, _WEIGHT, _RIGHTING = slice(0, 6), slice(6, 12), slice(12, 18), 18, 19


def pack_parameters(
    mass: Array, linear_damping: Array, quadratic_damping: Array, net_weight: float = 0.0, righting: float = 0.0
) -> Array:
    """Return the (20,) parameters that `advance` takes.

    Args:
        mass: (6,) rigid-body plus added mass and inertia, kg and kg m^2; positive.
        linear_damping: (6,) N s/m and N m s/rad; not negative.
        quadratic_damping: (6,) N s^2/m^2 and N m s^2/rad^2; not negative.
        net_weight: weight minus buoyancy, N; negative floats up.
        righting: moment per sine of the tilt, N m; buoyancy times its height above the centre of mass.

    Raises:
        ValueError: a mass is not positive or a damping coefficient is negative.
    """
    parameters = np.concatenate([mass, linear_damping, quadratic_damping, [net_weight, righting]]).astype(np.float64)
    if not np.all(parameters[_MASS] > 0):
        raise ValueError(f"Masses must be positive, got {parameters[_MASS]}.")
    if not np.all(parameters[6:18] >= 0):
        raise ValueError(f"Damping must not be negative, got {parameters[6:18]}.")
    return parameters


@numba.njit(cache=True)
def advance(state, wrench, current, parameters, dt):  # type: ignore[no-untyped-def]
    """Return the (13,) state one step later.

    Args:
        state: (13,) position, quaternion, velocity over ground in the body frame.
        wrench: (6,) force and moment of the actuators, body frame, constant over the step, N and N m.
        current: (3,) velocity of the water, world frame, constant in space and time, m/s.
        parameters: (20,) from `pack_parameters`.
        dt: Step, s.
    """
    moving = state.copy()
    _shift_velocity(moving, current, -1.0)
    _damp(moving, parameters, 0.5 * dt)
    _runge_kutta(moving, wrench, current, parameters, dt)
    _damp(moving, parameters, 0.5 * dt)
    _shift_velocity(moving, current, 1.0)
    return moving


@numba.njit(cache=True)
def mean_velocity(before, after, dt):  # type: ignore[no-untyped-def]
    """Return the (6,) world-frame velocity and rate of turn that, held for `dt`, lead from one state to the next."""
    result = np.empty(6)
    for axis in range(3):
        result[axis] = (after[axis] - before[axis]) / dt
    # The turn is after * conjugate(before); of its two signs, take the shorter way round.
    aw, ax, ay, az = after[3], after[4], after[5], after[6]
    bw, bx, by, bz = before[3], -before[4], -before[5], -before[6]
    w = aw * bw - ax * bx - ay * by - az * bz
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    sine = np.sqrt(x * x + y * y + z * z)
    scale = 2.0 * np.arctan2(sine, abs(w)) / sine if sine > 1e-12 else 2.0  # 2 asin(s) / s tends to 2
    scale = -scale if w < 0.0 else scale
    result[3], result[4], result[5] = x * scale / dt, y * scale / dt, z * scale / dt
    return result


@numba.njit(cache=True)
def _shift_velocity(state, current, sign):  # type: ignore[no-untyped-def]
    """Add the current, turned into the body frame, to the state's linear velocity, in place."""
    rotation = rotation_rows(state)
    for axis in range(3):
        for k in range(3):
            state[7 + axis] += sign * rotation[k][axis] * current[k]


@numba.njit(cache=True)
def _damp(state, parameters, duration):  # type: ignore[no-untyped-def]
    """Apply the exact flow of m v' = -(a + b |v|) v to the velocity of every axis, in place."""
    for axis in range(6):
        rate = parameters[6 + axis] / parameters[axis]
        drag = parameters[12 + axis] / parameters[axis]
        decay = np.exp(-rate * duration)
        span = (1.0 - decay) / rate if rate > 1e-12 else duration
        state[7 + axis] *= decay / (1.0 + drag * abs(state[7 + axis]) * span)


@numba.njit(cache=True)
def _runge_kutta(state, wrench, current, parameters, dt):  # type: ignore[no-untyped-def]
    """Move the state by one classical fourth-order step of everything but damping, in place."""
    slope, probe, total = np.empty(13), state.copy(), np.zeros(13)
    for reach, weight in ((0.5, 1.0), (0.5, 2.0), (1.0, 2.0), (0.0, 1.0)):
        _derivative(probe, wrench, current, parameters, slope)
        for i in range(13):
            total[i] += weight * slope[i]
            probe[i] = state[i] + reach * dt * slope[i]
    for i in range(13):
        state[i] += dt / 6.0 * total[i]
    norm = np.sqrt(state[3] ** 2 + state[4] ** 2 + state[5] ** 2 + state[6] ** 2)
    for i in range(3, 7):
        state[i] /= norm


@numba.njit(cache=True)
def _derivative(state, wrench, current, parameters, slope):  # type: ignore[no-untyped-def]
    """Write the (13,) time derivative without damping; the velocity in `state` is the one through the water."""
    w, x, y, z = state[3], state[4], state[5], state[6]
    u, v, h = state[7], state[8], state[9]
    p, q, r = state[10], state[11], state[12]
    rotation = rotation_rows(state)
    for axis in range(3):
        row = rotation[axis]
        slope[axis] = row[0] * u + row[1] * v + row[2] * h + current[axis]
    slope[3] = 0.5 * (-x * p - y * q - z * r)
    slope[4] = 0.5 * (w * p + y * r - z * q)
    slope[5] = 0.5 * (w * q + z * p - x * r)
    slope[6] = 0.5 * (w * r + x * q - y * p)
    px, py, pz = parameters[0] * u, parameters[1] * v, parameters[2] * h  # momentum
    lx, ly, lz = parameters[3] * p, parameters[4] * q, parameters[5] * r  # angular momentum
    up = rotation[2]  # world z in the body frame
    net_weight, righting = parameters[18], parameters[19]
    slope[7] = (wrench[0] + py * r - pz * q - net_weight * up[0]) / parameters[0]
    slope[8] = (wrench[1] + pz * p - px * r - net_weight * up[1]) / parameters[1]
    slope[9] = (wrench[2] + px * q - py * p - net_weight * up[2]) / parameters[2]
    slope[10] = (wrench[3] + ly * r - lz * q + py * h - pz * v - righting * up[1]) / parameters[3]
    slope[11] = (wrench[4] + lz * p - lx * r + pz * u - px * h + righting * up[0]) / parameters[4]
    slope[12] = (wrench[5] + lx * q - ly * p + px * v - py * u) / parameters[5]


@numba.njit(cache=True)
def rotation_rows(state):  # type: ignore[no-untyped-def]
    """Return the rows of the matrix world from body; the quaternion's length does not matter."""
    w, x, y, z = state[3], state[4], state[5], state[6]
    s = 2.0 / (w * w + x * x + y * y + z * z)
    return (
        (1.0 - s * (y * y + z * z), s * (x * y - z * w), s * (x * z + y * w)),
        (s * (x * y + z * w), 1.0 - s * (x * x + z * z), s * (y * z - x * w)),
        (s * (x * z - y * w), s * (y * z + x * w), 1.0 - s * (x * x + y * y)),
    )
