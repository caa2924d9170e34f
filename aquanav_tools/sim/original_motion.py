"""The motion of the original benchmark's vehicles: a game engine's rigid body with drag, no hydrodynamics.

    v <- (v + a dt) (1 - drag dt),   w <- (w + I^-1 torque dt) (1 - drag dt),   no gyroscopic moment, |w| limited

Buoyancy grows with depth: every floater below the water's surface lifts with its power (N per metre) times its depth.
The stabiliser turns the vehicle towards its upright pose without touching its rate of turn. Drag acts on the
velocity through the water, which without a current is the original's.

Where the original leaves the order within a step open, it is here: stabiliser, forces, motion. The body frame's
origin is the original's root, from which its rays start; velocities in the state are those of the centre of mass.

Source: the SafeRLAUV project, its prefabs and scripts; PhysX integrates bodies in this way.
"""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.sim.rotation import rotation_rows
from aquanav_tools.sim.vehicle_base import GRAVITY, STATE_SIZE

SURFACE = STATE_SIZE
"""Where the state holds the height of the water's surface, m."""
_MASS, _INERTIA, _DRAG, _ANGULAR_DRAG, _MAX_RATE, _CENTRE, _STABILISER, _IS_AFLOAT, _FLOATERS = (
    1, 2, 5, 6, 7, 8, 11, 12, 13
)  # fmt: skip


@numba.njit(cache=True)
def advance(state, command, current, parameters, dt):  # type: ignore[no-untyped-def]
    """Return the (14,) state one step later.

    Args:
        state: (14,) position of the root, quaternion, velocity over ground of the centre of mass and rate of turn in
            the body frame, height of the water's surface.
        command: (6,) force ahead, N; power of the floaters, N/m, in place of heave; moment about body z, N m. The
            other three are not used.
        current: (3,) velocity of the water, world frame, m/s.
        parameters: From `DraggedBodyParameters.packed`.
        dt: Step, s.
    """
    moving = state.copy()
    _level(moving, 1.0 - np.exp(-parameters[_STABILISER] * dt))
    rotation = rotation_rows(moving)
    force, torque = _loads(moving, rotation, command, parameters)
    velocity, rate = np.empty(3), np.empty(3)
    kept, kept_turn = 1.0 - parameters[_DRAG] * dt, 1.0 - parameters[_ANGULAR_DRAG] * dt
    for axis in range(3):
        row = rotation[axis]
        over_ground = row[0] * moving[7] + row[1] * moving[8] + row[2] * moving[9]
        through_water = over_ground - current[axis] + force[axis] / parameters[_MASS] * dt
        velocity[axis] = current[axis] + through_water * kept
        rate[axis] = (moving[10 + axis] + torque[axis] / parameters[_INERTIA + axis] * dt) * kept_turn
    if parameters[_IS_AFLOAT] > 0.0:
        velocity[2], rate[0], rate[1] = 0.0, 0.0, 0.0
    fastest = np.sqrt(rate[0] ** 2 + rate[1] ** 2 + rate[2] ** 2)
    if fastest > parameters[_MAX_RATE]:
        rate *= parameters[_MAX_RATE] / fastest
    _move(moving, rotation, velocity, rate, parameters, dt)
    return moving


@numba.njit(cache=True)
def _loads(state, rotation, command, parameters):  # type: ignore[no-untyped-def]
    """Return force (world frame) and torque about the centre of mass (body frame) of thrust, floaters and weight."""
    force, torque = np.empty(3), np.zeros(3)
    for axis in range(3):
        force[axis] = rotation[axis][0] * command[0]
    torque[2] = command[5]
    up, centre = rotation[2], parameters[_CENTRE : _CENTRE + 3]
    if parameters[_IS_AFLOAT] > 0.0:
        return force, torque
    force[2] -= parameters[_MASS] * GRAVITY
    for first in range(_FLOATERS, len(parameters), 3):
        x, y, z = parameters[first], parameters[first + 1], parameters[first + 2]
        depth = state[SURFACE] - (state[2] + up[0] * x + up[1] * y + up[2] * z)
        if depth > 0.0:
            lift = command[2] * depth
            x, y, z = x - centre[0], y - centre[1], z - centre[2]
            force[2] += lift
            torque[0] += lift * (y * up[2] - z * up[1])
            torque[1] += lift * (z * up[0] - x * up[2])
            torque[2] += lift * (x * up[1] - y * up[0])
    return force, torque


@numba.njit(cache=True)
def _move(state, rotation, velocity, rate, parameters, dt):  # type: ignore[no-untyped-def]
    """Move the pose by a step at constant world velocity and body rate of turn, and store both, in place."""
    centre = parameters[_CENTRE : _CENTRE + 3]
    for axis in range(3):
        row = rotation[axis]
        offset = row[0] * centre[0] + row[1] * centre[1] + row[2] * centre[2]
        state[axis] += offset + velocity[axis] * dt
    angle = np.sqrt(rate[0] ** 2 + rate[1] ** 2 + rate[2] ** 2) * dt
    half = 0.5 * dt * (np.sin(0.5 * angle) / (0.5 * angle) if angle > 1e-9 else 1.0)
    x, y, z, w = half * rate[0], half * rate[1], half * rate[2], np.cos(0.5 * angle)
    a, b, c, d = state[3], state[4], state[5], state[6]
    state[3], state[4] = a * w - b * x - c * y - d * z, a * x + b * w + c * z - d * y
    state[5], state[6] = a * y - b * z + c * w + d * x, a * z + b * y - c * x + d * w
    turned = rotation_rows(state)
    for axis in range(3):
        row = turned[axis]
        state[axis] -= row[0] * centre[0] + row[1] * centre[1] + row[2] * centre[2]
        state[7 + axis] = turned[0][axis] * velocity[0] + turned[1][axis] * velocity[1] + turned[2][axis] * velocity[2]
        state[10 + axis] = rate[axis]


@numba.njit(cache=True)
def _level(state, share):  # type: ignore[no-untyped-def]
    """Turn the pose by a share of the way to upright with the same heading (slerp), in place; world velocities stay."""
    before = rotation_rows(state)
    heading = 0.5 * np.arctan2(before[1][0], before[0][0])
    cosine, sine = np.cos(heading), np.sin(heading)
    product = state[3] * cosine + state[6] * sine
    if product < 0.0:
        cosine, sine, product = -cosine, -sine, -product
    angle = np.arccos(min(product, 1.0))
    if angle < 1e-9 or share == 0.0:
        return
    kept, taken = np.sin((1.0 - share) * angle) / np.sin(angle), np.sin(share * angle) / np.sin(angle)
    for i in range(3, 7):
        state[i] *= kept
    state[3] += taken * cosine
    state[6] += taken * sine
    after = rotation_rows(state)
    old = state[7:13].copy()
    for axis in range(3):
        state[7 + axis] = 0.0
        state[10 + axis] = 0.0
        for k in range(3):
            shared = after[0][axis] * before[0][k] + after[1][axis] * before[1][k] + after[2][axis] * before[2][k]
            state[7 + axis] += shared * old[k]
            state[10 + axis] += shared * old[3 + k]
