"""Six-degree-of-freedom motion of a rigid body in water, after Fossen, in float64.

    M v' + C(v) v + D(v) v + g(q) = wrench,   v = velocity through the water, body frame

M is the sum of rigid-body and added mass, C its Coriolis matrix, D linear and quadratic damping, g weight and
buoyancy. The frame is x ahead, y left, z up; Fossen's (y right, z down) is half a turn about x away, under which
diagonal M and D and the form of C do not change. Because the water's own flow has no rotation, one M serves for the
rigid body and the water it carries, both with the velocity through the water (Fossen's property 8.1).

A step is a Strang splitting: half a step of the exact damping flow, a Runge-Kutta step of everything else, half a step
of damping. Damping is stiff and must never add energy; its exact flow keeps both promises at any dt, and its factors
are prepared once. Coriolis and restoring forces keep the energy, which fourth-order Runge-Kutta does to about 1e-6 over
10 s at dt = 0.02. A body flung faster than any swims (by a wall, or by a test) gets several Runge-Kutta steps, so that
it gains nothing either.

Where M couples axes, damping is split once more, axis by axis: each has an exact flow of its own, with the mass
1 / (M^-1)_ii. The second half takes the axes in the opposite order, so that the step stays symmetric and its error of
second order.

Source: Fossen, Handbook of Marine Craft Hydrodynamics and Motion Control (2011), chapters 3 and 6 to 8.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.sim import body_parameters
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.body_parameters import BodyParameters, ThrusterParameters
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
vec6 = wp.types.vector(length=6, dtype=wp.float64)
mat6 = wp.types.matrix(shape=(6, 6), dtype=wp.float64)
MAX_ANGLE = wp.constant(wp.float64(body_parameters.MAX_ANGLE))


@wp.struct
class State:
    """Where a vehicle is and how it moves; also the change of these in time."""

    position: wp.vec3d
    orientation: wp.vec4d
    velocity: vec6


@wp.func
def read_motion(
    i: int,
    positions: wp.array(dtype=wp.vec3d),
    orientations: wp.array(dtype=wp.vec4d),
    velocities: wp.array(dtype=vec6),
):
    """Return how vehicle `i` moves."""
    state = State()
    state.position = positions[i]
    state.orientation = orientations[i]
    state.velocity = velocities[i]
    return state


@wp.func
def write_motion(
    i: int, state: State, positions: wp.array(dtype=wp.vec3d), orientations: wp.array(dtype=wp.vec4d),
    velocities: wp.array(dtype=vec6),
):  # fmt: skip
    """Write how vehicle `i` moves."""
    positions[i] = state.position
    orientations[i] = state.orientation
    velocities[i] = state.velocity


@wp.struct
class Thruster:
    """A thruster of a vehicle."""

    wrench: vec6
    """Per newton of its force."""
    allocation: vec6
    """Newtons per unit of the wrench that is asked for."""
    max_reverse: f64
    max_forward: f64


@wp.struct
class Body:
    """A vehicle of `sim/fossen.py` in its water."""

    weight: f64
    """Less buoyancy, N."""
    arm: wp.vec3d
    mass: vec6
    """Diagonal of the mass matrix."""
    mobility: vec6
    """Diagonal of its inverse."""
    decay: vec6
    """What linear damping leaves of a speed in half a step."""
    span: vec6
    """The way under it in half a step per speed, s."""
    drag: vec6
    """Quadratic damping per mass."""
    swing_per_speed: f64
    is_coupled: wp.int32
    matrix: wp.array(dtype=mat6)
    """(2,) the mass matrix and its inverse; read only where axes are coupled."""
    rate_gain: wp.vec3d
    level_gain: f64
    left: f64
    """What is left at a step's end of a difference between a thruster's force and its command."""
    mean_left: f64
    """The same on average over the step."""
    num_thrusters: wp.int32
    thrusters: wp.array(dtype=Thruster)
    """(T,)."""


BODY_DTYPE, THRUSTER_DTYPE = np.dtype(Body.numpy_dtype()), np.dtype(Thruster.numpy_dtype())
"""NumPy's rows of both, with the names above; made once, as that takes a millisecond."""


@dataclass(frozen=True, eq=False)
class BodyRows:
    """N bodies as a structured array, ready to be part of an array of structures on the device."""

    rows: npt.NDArray[np.void]
    """(N,) of BODY_DTYPE. The arrays in it point into the next two, which must live as long."""
    matrices: Any
    """(N, 2) on the device."""
    thrusters: Any
    """(N, T) on the device."""


def body_rows(parameters: BodyParameters, dt: float, device: Any) -> BodyRows:
    """Return bodies for steps of `dt` (s).

    Args:
        parameters: Of N bodies; fields without an axis of N hold for all of them. Of one body there is one row.
        dt: Physics step, s.
        device: Warp's.
    """
    rows, pairs, thrusters = body_values(parameters, dt)
    matrices = wp.array(pairs, dtype=mat6, device=device)
    on_device = wp.array(thrusters, dtype=Thruster, device=device)
    rows["matrix"], rows["thrusters"] = views_of(matrices), views_of(on_device)
    return BodyRows(rows, matrices, on_device)


def body_values(parameters: BodyParameters, dt: float) -> tuple[npt.NDArray[np.void], Array, npt.NDArray[np.void]]:
    """Return what `body_rows` puts on the device: (N,) rows, (N, 2, 6, 6) mass matrices and inverses, (N, T) thrusters.

    The rows' own arrays are left empty.
    """
    matrix = parameters.mass.reshape(-1, 6, 6)
    num, half = len(matrix), 0.5 * dt
    is_coupled, masses = parameters.is_coupled.reshape(-1), np.diagonal(matrix, axis1=1, axis2=2)
    inverse = np.eye(6) / masses[:, None, :]
    inverse[is_coupled] = np.linalg.inv(matrix[is_coupled])
    mobility = np.diagonal(inverse, axis1=1, axis2=2)
    rate = parameters.linear_damping * mobility
    decay = np.exp(-rate * half)
    rows = np.zeros(num, dtype=BODY_DTYPE)
    rows["weight"], rows["arm"] = parameters.net_weight, parameters.arm
    rows["mass"], rows["mobility"], rows["decay"] = masses, mobility, decay
    rows["span"] = np.where(rate > 1e-12, (1.0 - decay) / np.maximum(rate, 1e-12), half)
    rows["drag"] = parameters.quadratic_damping * mobility
    rows["swing_per_speed"], rows["is_coupled"] = parameters.swing_per_speed, is_coupled
    rows["rate_gain"], rows["level_gain"] = parameters.rate_gain, parameters.level_gain
    thrusters = _thruster_rows(parameters.thrusters, num)
    if parameters.thrusters is not None:
        lag = np.asarray(parameters.thrusters.time_constant, dtype=np.float64)
        left = np.exp(-dt / np.where(lag > 0.0, lag, np.inf)) * (lag > 0.0)
        rows["left"], rows["mean_left"] = left, (1.0 - left) * lag / dt
        rows["num_thrusters"] = thrusters.shape[1]
    return rows, np.stack([matrix, inverse], axis=1), thrusters


def _thruster_rows(parameters: ThrusterParameters | None, num: int) -> npt.NDArray[np.void]:
    """Return the (N, T) thrusters of N bodies, with T of at least 1."""
    if parameters is None:
        return np.zeros((num, 1), dtype=THRUSTER_DTYPE)
    rows = np.zeros((num, parameters.wrenches.shape[-2]), dtype=THRUSTER_DTYPE)
    rows["wrench"], rows["allocation"] = parameters.wrenches, parameters.allocation
    rows["max_reverse"], rows["max_forward"] = parameters.max_reverse, parameters.max_forward
    return rows


def views_of(array: Any) -> npt.NDArray[np.void]:
    """Return what a structure holds of each row of an (N, M) array on the device: its address and its shape."""
    views = np.empty(len(array), dtype=BODY_DTYPE["matrix"])
    views[:] = np.frombuffer(bytearray(array[0].__ctype__()), dtype=views.dtype)
    views["data"] += np.arange(len(array), dtype=np.uint64) * np.uint64(array.strides[0])
    return views


def make_body(parameters: BodyParameters, dt: float, device: Any) -> Body:
    """Return one body for steps of `dt` (s)."""
    made = body_rows(parameters, dt, device)
    body = Body()
    for name, field in Body.vars.items():
        value = made.rows[name][0]
        if name == "matrix":
            body.matrix = made.matrices[0]
        elif name == "thrusters":
            body.thrusters = made.thrusters[0]
        else:
            setattr(body, name, field.type(*np.atleast_1d(value)))
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
        thruster = body.thrusters[n]
        command = wp.dot(thruster.allocation, wanted)
        command = wp.clamp(command, -thruster.max_reverse, thruster.max_forward)
        difference = forces[vehicle, n] - command
        acting += (command + body.mean_left * difference) * thruster.wrench
        forces[vehicle, n] = command + body.left * difference
    return acting


@wp.func
def swim(state: State, wrench: vec6, current: wp.vec3d, body: Body, dt: f64):
    """Return the state one step of the Strang splitting later."""
    moving = state
    moving.velocity = damped(shifted(state.velocity, state.orientation, -current), body, 0)
    angle = dt * (wp.length(angular(moving.velocity)) + body.swing_per_speed * wp.length(linear(moving.velocity)))
    parts = 1 + int(wp.min(angle, f64(1000.0)) / MAX_ANGLE)
    for _ in range(parts):
        moving = runge_kutta(moving, wrench, current, body, dt / f64(parts))
    moving.velocity = shifted(damped(moving.velocity, body, 1), moving.orientation, current)
    return moving
