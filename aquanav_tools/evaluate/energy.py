"""What moving through the water costs."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.randomisation import varied_boat, water_damping
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Array


def drag_power(vehicle: Vehicle, velocities: Array, dynamics: Mapping[str, float]) -> Array:
    """Return the power that drag takes from a vehicle, W, at (N, 6) velocities through the water, body frame.

    `dynamics` is what its episode drew, by the names of `sim.randomisation`. In steady motion the power is what the
    thrusters put into the water, whatever thrusters they are; their losses, and what accelerating and braking cost, are
    not in it. (N,), never negative.

    Raises:
        TypeError: no drag is known for this kind of vehicle.
    """
    if isinstance(vehicle, FossenVehicle):
        draws = {name: np.array([value]) for name, value in dynamics.items()}
        linear, quadratic = water_damping(vehicle, draws, 1)
        return ((linear + quadratic * np.abs(velocities)) * velocities**2).sum(axis=1)
    if isinstance(vehicle, OriginalVehicle):
        body = varied_boat(vehicle, dynamics)[0].body
        rates = np.array([body.linear_drag * body.mass] * 3 + [body.angular_drag * inertia for inertia in body.inertia])
        return (rates * velocities**2).sum(axis=1)
    raise TypeError(f"No drag is known for a {type(vehicle).__name__}.")


def water_relative(velocities: Array, currents: Array, orientations: Array) -> Array:
    """Return (N, 6) velocities through the water, body frame.

    Args:
        velocities: (N, 6) over ground, body frame, m/s and rad/s.
        currents: (N, 3) of the water, world frame, m/s.
        orientations: (N, 4) unit quaternions (w, x, y, z), body to world.
    """
    relative = velocities.copy()
    relative[:, :3] -= to_body(currents, orientations)
    return relative


def to_body(vectors: Array, orientations: Array) -> Array:
    """Return (N, 3) world vectors in the body frames of (N, 4) unit quaternions (w, x, y, z), body to world."""
    return _turn(vectors, -orientations[:, 1:], orientations[:, :1])


def to_world(vectors: Array, orientations: Array) -> Array:
    """Return (N, 3) body vectors in the world frame; `orientations` as for `to_body`."""
    return _turn(vectors, orientations[:, 1:], orientations[:, :1])


def _turn(vectors: Array, axes: Array, scalars: Array) -> Array:
    twice = 2.0 * np.cross(axes, vectors)
    turned: Array = vectors + scalars * twice + np.cross(axes, twice)
    return turned
