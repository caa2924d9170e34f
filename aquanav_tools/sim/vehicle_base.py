"""What the simulation asks of any vehicle, and the checks that the vehicles' files have in common."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from aquanav_tools.sim.body_parameters import MotionParameters
from aquanav_tools.types import Array, Capsule, Pose

GRAVITY = 9.81
"""m/s^2."""
STATE_SIZE = 13
"""A state begins with position (3,) in the world, quaternion (w, x, y, z) world from body, velocity (6,) over ground
in the body frame; behind these come the values that the vehicle's own model adds."""

Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]
SixRows = tuple[Six, Six, Six, Six, Six, Six]


@dataclass(frozen=True)
class Vehicle(ABC):
    """A vehicle that can be moved by its actions and collides as a capsule."""

    name: str
    capsule: Capsule
    """Its hull."""

    @property
    @abstractmethod
    def total_mass(self) -> Array:
        """(6,) what resists acceleration along and about body x, y, z: kg and kg m^2, with added mass."""

    @abstractmethod
    def motion_parameters(self, density: float) -> MotionParameters:
        """Return the parameters of its motion in water of `density` (kg/m^3)."""

    @abstractmethod
    def state_at(self, pose: Pose) -> Array:
        """Return the state of the vehicle at rest: (13,) and what its model adds."""

    @abstractmethod
    def summary(self) -> str:
        """Return what a list of vehicles says of it, in a few words."""


def rest_state(pose: Pose, extra: int) -> Array:
    """Return a state at rest with `extra` zeros behind the first 13 values."""
    return np.concatenate([pose.position, pose.orientation, np.zeros(6 + extra)])


def check_positive(name: str, *values: float) -> None:
    """Refuse values that are not positive.

    Raises:
        ValueError: one is zero, negative or not finite; the message has the field's name.
    """
    if not all(math.isfinite(value) and value > 0 for value in values):
        raise ValueError(f"{name} must be positive, got {_listed(values)}.")


def check_not_negative(name: str, *values: float) -> None:
    """Refuse negative values.

    Raises:
        ValueError: one is negative or not finite; the message has the field's name.
    """
    if not all(math.isfinite(value) and value >= 0 for value in values):
        raise ValueError(f"{name} must not be negative, got {_listed(values)}.")


def check_finite(name: str, *values: float) -> None:
    """Refuse values that are not numbers.

    Raises:
        ValueError: one is not finite; the message has the field's name.
    """
    if not all(math.isfinite(value) for value in values):
        raise ValueError(f"{name} must be finite, got {_listed(values)}.")


def check_inertia(name: str, inertia: Three) -> None:
    """Refuse moments of inertia that no body has.

    Raises:
        ValueError: one is not positive, or larger than the sum of the other two.
    """
    check_positive(name, *inertia)
    largest = max(inertia)
    others = sum(inertia) - largest
    if largest > others * (1.0 + 1e-9):
        axis = "xyz"[inertia.index(largest)]
        raise ValueError(
            f"{name} about {axis} is {largest:g}, more than the other two together ({others:g}), which no body has: "
            "Ix + Iy >= Iz for every order of the axes. Is a value in another unit, or about another point?"
        )


def _listed(values: tuple[float, ...]) -> str:
    return ", ".join(f"{value:g}" for value in values)
