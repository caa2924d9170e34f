"""What the equations of motion take of a vehicle in its water: two models, each with named fields.

Every field may have a leading axis of N for as many bodies with parameters of their own; a field without it holds for
all of them.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from aquanav_tools.types import Array, BoolArray

MAX_ANGLE = 1.0
"""Most that a body may swing in one Runge-Kutta step, rad; the method gains energy from 2.8 on."""


@dataclass(frozen=True, eq=False)
class ThrusterParameters:
    """T thrusters and how a wrench is allocated to them."""

    wrenches: Array
    """(T, 6) wrench per newton, body frame, 1 and m."""
    allocation: Array
    """(T, 6) newtons per unit of wrench."""
    max_reverse: Array
    """(T,) most force in reverse, N."""
    max_forward: Array
    """(T,) most force forward, N."""
    time_constant: float | Array
    """Of the first-order lag of their forces, s; 0 for none."""


@dataclass(frozen=True, eq=False)
class BodyParameters:
    """A rigid body in water after Fossen, for `sim/batch/motion.py`."""

    mass: Array
    """(6, 6) rigid-body plus added mass, kg, kg m and kg m^2; positive definite."""
    linear_damping: Array
    """(6,) N s/m and N m s/rad; not negative."""
    quadratic_damping: Array
    """(6,) N s^2/m^2 and N m s^2/rad^2; not negative."""
    net_weight: float | Array = 0.0
    """Weight minus buoyancy, N; negative floats up."""
    arm: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) whose cross product with the vertical is the moment of weight and buoyancy, N m; for a body in trim that is
    buoyancy times its height above the centre of mass, along body z."""
    rate_gain: Array = field(default_factory=lambda: np.zeros(3))
    """(3,) moment that the autopilot asks its thrusters for per rate of turn about body x, y, z, N m s/rad."""
    level_gain: float | Array = 0.0
    """The same per sine of the tilt, N m."""
    thrusters: ThrusterParameters | None = None
    """None where what is asked for acts as it is."""

    def __post_init__(self) -> None:
        symmetric = 0.5 * (self.mass + np.swapaxes(self.mass, -1, -2))
        if not np.isfinite(self.mass).all() or not (np.linalg.eigvalsh(symmetric)[..., 0] > 0).all():
            raise ValueError(f"Masses must be positive, got {np.diagonal(self.mass, axis1=-2, axis2=-1)}.")
        for damping in (self.linear_damping, self.quadratic_damping):
            if not (damping >= 0).all():
                raise ValueError(f"Damping must not be negative, got {damping}.")

    @property
    def swing_per_speed(self) -> Array:
        """(...,) bound on the rate at which the Munk moment swings the body, per speed through the water, rad/m."""
        linear = np.linalg.eigvalsh(self.mass[..., :3, :3])[..., -1]
        angular = np.linalg.eigvalsh(self.mass[..., 3:, 3:])[..., 0]
        return np.sqrt(linear / angular)

    @property
    def is_coupled(self) -> Array:
        """(...,) whether the mass matrix couples axes."""
        return ((self.mass != 0.0) & ~np.eye(6, dtype=bool)).any(axis=(-2, -1))


@dataclass(frozen=True, eq=False)
class DraggedBodyParameters:
    """A game engine's rigid body with drag, for `sim/batch/original.py`."""

    mass: float | Array
    """kg."""
    inertia: Array
    """(3,) about body x, y, z through the centre of mass, kg m^2."""
    linear_drag: float | Array
    """1/s."""
    angular_drag: float | Array
    """1/s."""
    max_turn_rate: float | Array
    """rad/s."""
    centre_of_mass: Array
    """(3,) in the body frame, m."""
    stabiliser_rate: float | Array
    """Rate at which the tilt is taken away, 1/s."""
    floaters: Array
    """(F, 3) in the body frame, m; may be empty."""
    is_afloat: bool | BoolArray
    """Whether the body stays upright at its height, as on still water."""


MotionParameters = BodyParameters | DraggedBodyParameters
