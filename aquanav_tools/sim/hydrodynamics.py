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

import numba
import numpy as np

from aquanav_tools.sim.body_parameters import MAX_ANGLE
from aquanav_tools.sim.rotation import rotation_rows as rotation_rows
from aquanav_tools.sim.vehicle_base import STATE_SIZE

_WEIGHT, _IS_COUPLED, _NUM_THRUSTERS, _ARM, _MASS, _LINEAR, _QUADRATIC, _RATE_GAIN, _LEVEL_GAIN, _LAG, _BRISKNESS = (
    1, 2, 3, 4, 7, 13, 19, 25, 28, 29, 30
)  # fmt: skip
_MATRIX, _INVERSE, _THRUSTERS = 31, 67, 103
_PER_THRUSTER = 14
"""Wrench per newton (6,), newtons per wrench (6,), most force in reverse and forward."""

compiled = numba.njit(cache=True, error_model="numpy")
"""Divisors are positive here; looking at each first, as Python does, took a sixth of a step."""
inlined = numba.njit(cache=True, error_model="numpy", forceinline=True)
"""Passing tuples of 13 values to functions and back took another half."""


@compiled
def advance(state, wrench, current, parameters, dt):  # type: ignore[no-untyped-def]
    """Return the state one step later.

    Args:
        state: (13,) position, quaternion, velocity over ground in the body frame, then the force of every thruster, N.
        wrench: (6,) force and moment that is asked for, body frame, constant over the step, N and N m. Without
            thrusters it acts as it is.
        current: (3,) velocity of the water, world frame, constant in space and time, m/s.
        parameters: From `BodyParameters.packed`.
        dt: Step, s.
    """
    moving = state.copy()
    acting = wrench
    if parameters[_NUM_THRUSTERS] > 0.0:
        acting = _thrust(moving, wrench, parameters, dt)
    damping = _damping(parameters, 0.5 * dt)
    _shift_velocity(moving, current, -1.0)
    _damp(moving, parameters, damping, False)
    parts = _num_parts(moving, parameters, dt)
    for _ in range(parts):
        _runge_kutta(moving, acting, current, parameters, dt / parts)
    _damp(moving, parameters, damping, True)
    _shift_velocity(moving, current, 1.0)
    return moving


@compiled
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


@compiled
def _shift_velocity(state, current, sign):  # type: ignore[no-untyped-def]
    """Add the current, turned into the body frame, to the state's linear velocity, in place."""
    rotation = rotation_rows(state)
    for axis in range(3):
        for k in range(3):
            state[7 + axis] += sign * rotation[k][axis] * current[k]


@inlined
def _damping(parameters, duration):  # type: ignore[no-untyped-def]
    """Return for each axis what its damping flow over a while is made of.

    That is the share of the speed that linear damping leaves; the way under it per speed, s; and quadratic damping per
    mass, 1/m or 1/rad.
    """
    return (
        _decay(parameters, 0, duration),
        _decay(parameters, 1, duration),
        _decay(parameters, 2, duration),
        _decay(parameters, 3, duration),
        _decay(parameters, 4, duration),
        _decay(parameters, 5, duration),
    )


@inlined
def _decay(parameters, axis, duration):  # type: ignore[no-untyped-def]
    mobility = parameters[_INVERSE + 7 * axis]
    if parameters[_IS_COUPLED] == 0.0:
        mobility = 1.0 / parameters[_MASS + axis]
    rate = parameters[_LINEAR + axis] * mobility
    decay = np.exp(-rate * duration)
    span = (1.0 - decay) / rate if rate > 1e-12 else duration
    return decay, span, parameters[_QUADRATIC + axis] * mobility


@inlined
def _damp(state, parameters, damping, is_backward):  # type: ignore[no-untyped-def]
    """Apply the exact damping flow of every axis to the velocity, in place.

    Without coupling the axes do not notice each other and their order is of no matter; with it, the force along one
    axis also accelerates the others.
    """
    if parameters[_IS_COUPLED] == 0.0:
        for axis in range(6):
            state[7 + axis] = _slowed(state[7 + axis], damping[axis])
        return
    for n in range(6):
        axis = 5 - n if is_backward else n
        change = _slowed(state[7 + axis], damping[axis]) - state[7 + axis]
        for other in range(6):
            state[7 + other] += change * parameters[_INVERSE + 6 * other + axis] / parameters[_INVERSE + 7 * axis]


@inlined
def _slowed(speed, damping):  # type: ignore[no-untyped-def]
    """Return where the exact flow of v' = -(a + b |v|) v takes a speed."""
    decay, span, drag = damping
    return speed * decay / (1.0 + drag * abs(speed) * span)


@compiled
def _num_parts(state, parameters, dt):  # type: ignore[no-untyped-def]
    """Return into how many Runge-Kutta steps to part `dt`: 1 but for speeds that no vehicle reaches by itself."""
    speed = np.sqrt(state[7] ** 2 + state[8] ** 2 + state[9] ** 2)
    turning = np.sqrt(state[10] ** 2 + state[11] ** 2 + state[12] ** 2)
    angle = dt * (turning + parameters[_BRISKNESS] * speed)
    return 1 + int(min(angle, 1000.0) / MAX_ANGLE)


@compiled
def _runge_kutta(state, wrench, current, parameters, dt):  # type: ignore[no-untyped-def]
    """Move the state by one classical fourth-order step of everything but damping, in place.

    Slopes are tuples, which stay in registers: with arrays for them the step took more than twice as long.
    """
    start = _moved(state, state, 0.0)
    first = _derivative(start, wrench, current, parameters)
    second = _derivative(_moved(start, first, 0.5 * dt), wrench, current, parameters)
    third = _derivative(_moved(start, second, 0.5 * dt), wrench, current, parameters)
    fourth = _derivative(_moved(start, third, dt), wrench, current, parameters)
    for i in range(STATE_SIZE):
        state[i] += dt / 6.0 * (first[i] + 2.0 * second[i] + 2.0 * third[i] + fourth[i])
    norm = np.sqrt(state[3] ** 2 + state[4] ** 2 + state[5] ** 2 + state[6] ** 2)
    for i in range(3, 7):
        state[i] /= norm


@inlined
def _moved(state, slope, dt):  # type: ignore[no-untyped-def]
    """Return state + dt * slope for the 13 values that have a slope, as a tuple."""
    x, y, z = state[0] + dt * slope[0], state[1] + dt * slope[1], state[2] + dt * slope[2]
    a, b, c, d = state[3] + dt * slope[3], state[4] + dt * slope[4], state[5] + dt * slope[5], state[6] + dt * slope[6]
    u, v, h = state[7] + dt * slope[7], state[8] + dt * slope[8], state[9] + dt * slope[9]
    p, q, r = state[10] + dt * slope[10], state[11] + dt * slope[11], state[12] + dt * slope[12]
    return x, y, z, a, b, c, d, u, v, h, p, q, r


@inlined
def _derivative(state, wrench, current, parameters):  # type: ignore[no-untyped-def]
    """Return the 13 time derivatives without damping; the velocity in `state` is the one through the water."""
    w, x, y, z = state[3], state[4], state[5], state[6]
    u, v, h = state[7], state[8], state[9]
    p, q, r = state[10], state[11], state[12]
    east, north, up = rotation_rows(state)  # `up` is world z in the body frame
    moving = (
        east[0] * u + east[1] * v + east[2] * h + current[0],
        north[0] * u + north[1] * v + north[2] * h + current[1],
        up[0] * u + up[1] * v + up[2] * h + current[2],
    )
    turning = (
        0.5 * (-x * p - y * q - z * r),
        0.5 * (w * p + y * r - z * q),
        0.5 * (w * q + z * p - x * r),
        0.5 * (w * r + x * q - y * p),
    )
    if parameters[_IS_COUPLED] == 0.0:
        a, b, c = parameters[_MASS], parameters[_MASS + 1], parameters[_MASS + 2]
        i, j, k = parameters[_MASS + 3], parameters[_MASS + 4], parameters[_MASS + 5]
        force = _force(state, (a * u, b * v, c * h, i * p, j * q, k * r), wrench, parameters, up)
        return moving + turning + (force[0] / a, force[1] / b, force[2] / c, force[3] / i, force[4] / j, force[5] / k)
    momentum = _times(parameters, _MATRIX, (u, v, h, p, q, r))
    return moving + turning + _times(parameters, _INVERSE, _force(state, momentum, wrench, parameters, up))


@inlined
def _force(state, momentum, wrench, parameters, up):  # type: ignore[no-untyped-def]
    """Return the sum of a wrench, the Coriolis and the restoring wrench of a body with six components of momentum."""
    px, py, pz, lx, ly, lz = momentum
    u, v, h = state[7], state[8], state[9]
    p, q, r = state[10], state[11], state[12]
    weight = parameters[_WEIGHT]
    ax, ay, az = parameters[_ARM], parameters[_ARM + 1], parameters[_ARM + 2]
    return (
        wrench[0] + (py * r - pz * q - weight * up[0]),
        wrench[1] + (pz * p - px * r - weight * up[1]),
        wrench[2] + (px * q - py * p - weight * up[2]),
        wrench[3] + (ly * r - lz * q + py * h - pz * v + ay * up[2] - az * up[1]),
        wrench[4] + (lz * p - lx * r + pz * u - px * h + az * up[0] - ax * up[2]),
        wrench[5] + (lx * q - ly * p + px * v - py * u + ax * up[1] - ay * up[0]),
    )


@compiled
def _times(parameters, first, vector):  # type: ignore[no-untyped-def]
    """Return the (6, 6) matrix that begins at parameters[first] times six values."""
    return (
        _row_times(parameters, first, vector),
        _row_times(parameters, first + 6, vector),
        _row_times(parameters, first + 12, vector),
        _row_times(parameters, first + 18, vector),
        _row_times(parameters, first + 24, vector),
        _row_times(parameters, first + 30, vector),
    )


@compiled
def _row_times(parameters, first, vector):  # type: ignore[no-untyped-def]
    total = 0.0
    for column in range(6):
        total += parameters[first + column] * vector[column]
    return total
