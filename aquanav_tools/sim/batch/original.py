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

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.sim.batch.motion import State, angular, linear, rotation_of, six, vec6, views_of
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.body_parameters import DraggedBodyParameters
from aquanav_tools.sim.vehicle_base import GRAVITY

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


DRAGGED_DTYPE = np.dtype(DraggedBody.numpy_dtype())
"""NumPy's rows of it, with the names above."""


@dataclass(frozen=True, eq=False)
class DraggedRows:
    """N bodies as a structured array, ready to be part of an array of structures on the device."""

    rows: npt.NDArray[np.void]
    """(N,) of DRAGGED_DTYPE. The arrays in it point into the next one, which must live as long."""
    floaters: Any
    """(N, F) on the device, with F of at least 1; bodies afloat have a row of zeros that is not read."""


def dragged_rows(parameters: DraggedBodyParameters, dt: float, device: Any) -> DraggedRows:
    """Return bodies for steps of `dt` (s).

    Args:
        parameters: Of N bodies; fields without an axis of N hold for all of them. Of one body there is one row.
        dt: Physics step, s.
        device: Warp's.
    """
    numbers = (parameters.mass, parameters.linear_drag, parameters.angular_drag, parameters.max_turn_rate)
    vectors = (parameters.inertia, parameters.centre_of_mass)
    shapes = [np.shape(values) for values in (*numbers, parameters.stabiliser_rate)]
    shapes += [values.shape[:-1] for values in vectors] + [parameters.floaters.shape[:-2]]
    (num,) = np.broadcast_shapes((1,), *shapes)
    rows = np.zeros(num, dtype=DRAGGED_DTYPE)
    rows["mass"], rows["inertia"], rows["centre"] = parameters.mass, *vectors
    rows["kept"] = 1.0 - np.asarray(parameters.linear_drag) * dt
    rows["kept_turn"] = 1.0 - np.asarray(parameters.angular_drag) * dt
    rows["max_rate"], rows["is_afloat"] = parameters.max_turn_rate, parameters.is_afloat
    rows["levelled"] = 1.0 - np.exp(-np.asarray(parameters.stabiliser_rate) * dt)
    floaters = parameters.floaters if parameters.floaters.shape[-2] else np.zeros((1, 3))
    on_device = wp.array(np.broadcast_to(floaters, (num, *floaters.shape[-2:])), dtype=wp.vec3d, device=device)
    rows["floaters"] = views_of(on_device)
    return DraggedRows(rows, on_device)


def make_dragged_body(parameters: DraggedBodyParameters, dt: float, device: Any) -> DraggedBody:
    """Return one body for steps of `dt` (s)."""
    made = dragged_rows(parameters, dt, device)
    body = DraggedBody()
    for name, field in DraggedBody.vars.items():
        if name == "floaters":
            body.floaters = made.floaters[0]
        else:
            setattr(body, name, field.type(*np.atleast_1d(made.rows[name][0])))
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
