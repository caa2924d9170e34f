"""Six-degree-of-freedom motion of a rigid body in water, after Fossen.

    M v' + C(v) v + D(v) v + g(q) = wrench,   v = velocity through the water, body frame

M is the sum of rigid-body and added mass, C its Coriolis matrix, D linear and quadratic damping, g weight and
buoyancy. The frame is x ahead, y left, z up; Fossen's (y right, z down) is half a turn about x away, under which
diagonal M and D and the form of C do not change. Because the water's own flow has no rotation, one M serves for the
rigid body and the water it carries, both with the velocity through the water (Fossen's property 8.1).

A step is a Strang splitting: half a step of the exact damping flow, a Runge-Kutta step of everything else, half a step
of damping. Damping is stiff and must never add energy; its exact flow keeps both promises at any dt. Coriolis and
restoring forces keep the energy, which fourth-order Runge-Kutta does to about 1e-6 over 10 s at dt = 0.02. A body
flung faster than any swims (by a wall, or by a test) gets several Runge-Kutta steps, so that it gains nothing either.

Where M couples axes, damping is split once more, axis by axis: each has an exact flow of its own, with the mass
1 / (M^-1)_ii. The second half takes the axes in the opposite order, so that the step stays symmetric and its error of
second order.

Source: Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control (2011), chapters 3 and 6 to 8.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np

from aquanav_tools.sim.thrusters import Thrusters
from aquanav_tools.sim.vehicle_base import STATE_SIZE
from aquanav_tools.types import Array

FOSSEN = 0.0
"""What the first parameter says when they are for this module."""
_WEIGHT, _IS_COUPLED, _NUM_THRUSTERS, _ARM, _MASS, _LINEAR, _QUADRATIC, _RATE_GAIN, _LEVEL_GAIN, _LAG, _BRISKNESS = (
    1, 2, 3, 4, 7, 13, 19, 25, 28, 29, 30
)  # fmt: skip
_MATRIX, _INVERSE, _THRUSTERS = 31, 67, 103
_PER_THRUSTER = 14
"""Wrench per newton (6,), newtons per wrench (6,), most force in reverse and forward."""
MAX_ANGLE = 1.0
"""Most that a body may swing in one Runge-Kutta step, rad; the method gains energy from 2.8 on."""


@dataclass(frozen=True, eq=False)
class Feedback:
    """An autopilot that works through thrusters."""

    rate_gain: Array
    """(3,) moment per rate of turn about body x, y, z, N m s/rad."""
    level_gain: float
    """Moment per sine of the tilt, N m."""
    thrusters: Thrusters


def pack_parameters(
    mass: Array,
    linear_damping: Array,
    quadratic_damping: Array,
    net_weight: float = 0.0,
    righting: float | Array = 0.0,
    feedback: Feedback | None = None,
) -> Array:
    """Return the parameters that `advance` takes.

    Args:
        mass: (6,) or (6, 6) rigid-body plus added mass, kg, kg m and kg m^2; positive definite.
        linear_damping: (6,) N s/m and N m s/rad; not negative.
        quadratic_damping: (6,) N s^2/m^2 and N m s^2/rad^2; not negative.
        net_weight: weight minus buoyancy, N; negative floats up.
        righting: moment per sine of the tilt, N m: buoyancy times its height above the centre of mass; or the (3,)
            arm whose cross product with the vertical is the moment of weight and buoyancy, N m.
        feedback: Thrusters and the autopilot that commands them, if there are any.

    Raises:
        ValueError: the mass is not positive definite or a damping coefficient is negative.
    """
    matrix = np.diag(mass) if np.ndim(mass) == 1 else np.array(mass, dtype=np.float64)
    damping = np.concatenate([linear_damping, quadratic_damping])
    if not np.isfinite(matrix).all() or not np.linalg.eigvalsh(0.5 * (matrix + matrix.T))[0] > 0:
        raise ValueError(f"Masses must be positive, got {mass}.")
    if not np.all(damping >= 0):
        raise ValueError(f"Damping must not be negative, got {damping}.")
    is_coupled = bool(np.any(matrix != np.diag(np.diag(matrix))))
    arm = righting if isinstance(righting, np.ndarray) else np.array([0.0, 0.0, righting])
    head = [FOSSEN, net_weight, float(is_coupled), 0.0, *arm, *np.diag(matrix), *damping]
    inverse = np.linalg.inv(matrix)
    # The Munk moment swings a body at a rate of up to sqrt(mass / inertia) times its speed.
    briskness = np.sqrt(np.linalg.eigvalsh(matrix[:3, :3])[-1] / np.linalg.eigvalsh(matrix[3:, 3:])[0])
    if feedback is None:
        return np.concatenate([head, np.zeros(5), [briskness], matrix.ravel(), inverse.ravel()])
    thrusters = feedback.thrusters
    head[_NUM_THRUSTERS] = len(thrusters.positions)
    limits = np.tile([thrusters.max_reverse, thrusters.max_forward], (len(thrusters.positions), 1))
    rows = np.concatenate([thrusters.wrenches().T, thrusters.allocation(), limits], axis=1)
    loop = [*feedback.rate_gain, feedback.level_gain, thrusters.time_constant, briskness]
    return np.concatenate([head, loop, matrix.ravel(), inverse.ravel(), rows.ravel()])


@numba.njit(cache=True)
def advance(state, wrench, current, parameters, dt):  # type: ignore[no-untyped-def]
    """Return the state one step later.

    Args:
        state: (13,) position, quaternion, velocity over ground in the body frame, then the force of every thruster, N.
        wrench: (6,) force and moment that is asked for, body frame, constant over the step, N and N m. Without
            thrusters it acts as it is.
        current: (3,) velocity of the water, world frame, constant in space and time, m/s.
        parameters: From `pack_parameters`.
        dt: Step, s.
    """
    moving = state.copy()
    acting = wrench
    if parameters[_NUM_THRUSTERS] > 0.0:
        acting = _thrust(moving, wrench, parameters, dt)
    _shift_velocity(moving, current, -1.0)
    _damp(moving, parameters, 0.5 * dt, False)
    parts = _num_parts(moving, parameters, dt)
    for _ in range(parts):
        _runge_kutta(moving, acting, current, parameters, dt / parts)
    _damp(moving, parameters, 0.5 * dt, True)
    _shift_velocity(moving, current, 1.0)
    return moving


@numba.njit(cache=True)
def _thrust(state, wrench, parameters, dt):  # type: ignore[no-untyped-def]
    """Let the thrusters follow what is asked for, in place, and return the (6,) mean wrench of the step.

    The autopilot reads the state once, at the step's beginning, as a real one does.
    """
    up = rotation_rows(state)[2]
    asked = wrench.copy()
    for axis in range(3):
        asked[3 + axis] -= parameters[_RATE_GAIN + axis] * state[10 + axis]
    asked[3] -= parameters[_LEVEL_GAIN] * up[1]
    asked[4] += parameters[_LEVEL_GAIN] * up[0]
    lag, acting = parameters[_LAG], np.zeros(6)
    left = np.exp(-dt / lag) if lag > 0.0 else 0.0  # share of the difference that is left at the step's end
    mean_left = (1.0 - left) * lag / dt  # and on average over the step
    for n in range(int(parameters[_NUM_THRUSTERS])):
        first = _THRUSTERS + n * _PER_THRUSTER
        command = 0.0
        for axis in range(6):
            command += parameters[first + 6 + axis] * asked[axis]
        command = min(max(command, -parameters[first + 12]), parameters[first + 13])
        difference = state[STATE_SIZE + n] - command
        for axis in range(6):
            acting[axis] += parameters[first + axis] * (command + mean_left * difference)
        state[STATE_SIZE + n] = command + left * difference
    return acting


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
def _damp(state, parameters, duration, is_backward):  # type: ignore[no-untyped-def]
    """Apply the exact damping flow of every axis to the velocity, in place.

    Without coupling the axes do not notice each other and their order is of no matter; with it, the force along one
    axis also accelerates the others.
    """
    if parameters[_IS_COUPLED] == 0.0:
        for axis in range(6):
            state[7 + axis] = _slowed(state[7 + axis], axis, 1.0 / parameters[_MASS + axis], parameters, duration)
        return
    for n in range(6):
        axis = 5 - n if is_backward else n
        mobility = parameters[_INVERSE + 7 * axis]
        change = _slowed(state[7 + axis], axis, mobility, parameters, duration) - state[7 + axis]
        for other in range(6):
            state[7 + other] += change * parameters[_INVERSE + 6 * other + axis] / mobility


@numba.njit(cache=True)
def _slowed(speed, axis, mobility, parameters, duration):  # type: ignore[no-untyped-def]
    """Return where the exact flow of v' = -mobility * (a + b |v|) v takes a speed."""
    rate = parameters[_LINEAR + axis] * mobility
    drag = parameters[_QUADRATIC + axis] * mobility
    decay = np.exp(-rate * duration)
    span = (1.0 - decay) / rate if rate > 1e-12 else duration
    return speed * decay / (1.0 + drag * abs(speed) * span)


@numba.njit(cache=True)
def _num_parts(state, parameters, dt):  # type: ignore[no-untyped-def]
    """Return into how many Runge-Kutta steps to part `dt`: 1 but for speeds that no vehicle reaches by itself."""
    speed = np.sqrt(state[7] ** 2 + state[8] ** 2 + state[9] ** 2)
    turning = np.sqrt(state[10] ** 2 + state[11] ** 2 + state[12] ** 2)
    angle = dt * (turning + parameters[_BRISKNESS] * speed)
    return 1 + int(min(angle, 1000.0) / MAX_ANGLE)


@numba.njit(cache=True)
def _runge_kutta(state, wrench, current, parameters, dt):  # type: ignore[no-untyped-def]
    """Move the state by one classical fourth-order step of everything but damping, in place."""
    slope, probe, total = np.empty(STATE_SIZE), state[:STATE_SIZE].copy(), np.zeros(STATE_SIZE)
    for reach, weight in ((0.5, 1.0), (0.5, 2.0), (1.0, 2.0), (0.0, 1.0)):
        _derivative(probe, wrench, current, parameters, slope)
        for i in range(STATE_SIZE):
            total[i] += weight * slope[i]
            probe[i] = state[i] + reach * dt * slope[i]
    for i in range(STATE_SIZE):
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
    up = rotation[2]  # world z in the body frame
    if parameters[_IS_COUPLED] == 0.0:
        mass = parameters[_MASS : _MASS + 6]
        momentum = (mass[0] * u, mass[1] * v, mass[2] * h, mass[3] * p, mass[4] * q, mass[5] * r)
        _force(state, momentum, parameters, up, slope)
        for axis in range(6):
            slope[7 + axis] = (wrench[axis] + slope[7 + axis]) / mass[axis]
        return
    _force(state, _times(parameters[_MATRIX : _MATRIX + 36], state[7:13]), parameters, up, slope)
    slope[7:13] = _times(parameters[_INVERSE : _INVERSE + 36], wrench + slope[7:13])


@numba.njit(cache=True)
def _force(state, momentum, parameters, up, slope):  # type: ignore[no-untyped-def]
    """Write the Coriolis and restoring wrench of a body with six components of momentum to slope[7:13]."""
    px, py, pz, lx, ly, lz = momentum[0], momentum[1], momentum[2], momentum[3], momentum[4], momentum[5]
    u, v, h = state[7], state[8], state[9]
    p, q, r = state[10], state[11], state[12]
    weight = parameters[_WEIGHT]
    ax, ay, az = parameters[_ARM], parameters[_ARM + 1], parameters[_ARM + 2]
    slope[7] = py * r - pz * q - weight * up[0]
    slope[8] = pz * p - px * r - weight * up[1]
    slope[9] = px * q - py * p - weight * up[2]
    slope[10] = ly * r - lz * q + py * h - pz * v + ay * up[2] - az * up[1]
    slope[11] = lz * p - lx * r + pz * u - px * h + az * up[0] - ax * up[2]
    slope[12] = lx * q - ly * p + px * v - py * u + ax * up[1] - ay * up[0]


@numba.njit(cache=True)
def _times(matrix, vector):  # type: ignore[no-untyped-def]
    """Return a flat (36,) matrix times a (6,) vector."""
    result = np.zeros(6)
    for row in range(6):
        for column in range(6):
            result[row] += matrix[6 * row + column] * vector[column]
    return result


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
