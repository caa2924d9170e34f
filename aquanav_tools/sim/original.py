"""The original benchmark's vehicles, whose body a game engine moves: see `sim/batch/original.py`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from aquanav_tools.sim.body_parameters import DraggedBodyParameters
from aquanav_tools.sim.vehicle_base import (
    GRAVITY,
    Three,
    Vehicle,
    check_finite,
    check_inertia,
    check_not_negative,
    check_positive,
    rest_state,
)
from aquanav_tools.types import Array, Pose

STABILISER_STEP = 0.02
"""Step for which the stabiliser's share is given, s."""


@dataclass(frozen=True)
class DraggedBody:
    """A rigid body whose motion fades at a constant rate."""

    mass: float
    """kg."""
    inertia: Three
    """About body x, y, z through the centre of mass, kg m^2."""
    linear_drag: float
    """1/s."""
    angular_drag: float
    """1/s."""
    centre_of_mass: Three = (0.0, 0.0, 0.0)
    """In the body frame, m."""
    max_turn_rate: float = 7.0
    """rad/s; the engine's default."""

    def __post_init__(self) -> None:
        check_positive("mass", self.mass)
        check_inertia("inertia", self.inertia)
        check_not_negative("linear_drag", self.linear_drag)
        check_not_negative("angular_drag", self.angular_drag)
        check_finite("centre_of_mass", *self.centre_of_mass)
        check_positive("max_turn_rate", self.max_turn_rate)


@dataclass(frozen=True)
class Drive:
    """What steer and thrust do."""

    force: float
    """Full thrust ahead, N."""
    reverse_fraction: float
    """Full thrust in reverse, as a share of force."""
    steer_moment: float
    """Full steer at full thrust, about body z, N m."""
    steers_at_rest: bool = False
    """Whether steer works without thrust; otherwise the moment is steer times thrust, reversed in reverse."""

    def __post_init__(self) -> None:
        for name in ("force", "reverse_fraction", "steer_moment"):
            check_positive(name, getattr(self, name))


@dataclass(frozen=True)
class Ballast:
    """Floaters whose lift is their power times their depth."""

    floaters: tuple[Three, ...]
    """In the body frame, m."""
    power: float
    """At the start of an episode, N per metre of depth and floater."""
    min_power: float
    max_power: float
    power_rate: float
    """Change of the power while up or down is commanded, N/m per second."""

    def __post_init__(self) -> None:
        if not self.floaters:
            raise ValueError("floaters must be at least one point.")
        for n, floater in enumerate(self.floaters):
            check_finite(f"floaters[{n}]", *floater)
        check_positive("min_power", self.min_power)
        check_positive("power_rate", self.power_rate)
        if not self.min_power < self.power < self.max_power:
            raise ValueError(
                f"power must lie between min_power and max_power, got {self.power:g} with {self.min_power:g} and "
                f"{self.max_power:g}."
            )


@dataclass(frozen=True)
class OriginalVehicle(Vehicle):
    """A vehicle of the original benchmark: under water with ballast, or afloat without."""

    body: DraggedBody
    drive: Drive
    ballast: Ballast | None = None
    """None for a vehicle that stays at its height, afloat on still water."""
    stabiliser: float = 0.0
    """Share of the tilt that is taken away in 0.02 s."""
    model: Literal["original"] = "original"

    def __post_init__(self) -> None:
        if not 0.0 <= self.stabiliser < 1.0:
            raise ValueError(f"stabiliser must be at least 0 and below 1, got {self.stabiliser:g}.")

    @property
    def total_mass(self) -> Array:
        """(6,) mass and inertia, kg and kg m^2."""
        return np.array([self.body.mass] * 3 + list(self.body.inertia))

    @property
    def neutral_depth(self) -> float:
        """Depth at which the floaters carry the vehicle at the start's power, m; 0 for a vehicle afloat."""
        if self.ballast is None:
            return 0.0
        return self.body.mass * GRAVITY / (len(self.ballast.floaters) * self.ballast.power)

    def motion_parameters(self, density: float) -> DraggedBodyParameters:
        """Return the parameters of its motion; the original's water has no density."""
        return DraggedBodyParameters(
            mass=self.body.mass,
            inertia=np.array(self.body.inertia),
            linear_drag=self.body.linear_drag,
            angular_drag=self.body.angular_drag,
            max_turn_rate=self.body.max_turn_rate,
            centre_of_mass=np.array(self.body.centre_of_mass),
            stabiliser_rate=-np.log1p(-self.stabiliser) / STABILISER_STEP,
            floaters=np.array(self.ballast.floaters if self.ballast else ()).reshape(-1, 3),
            is_afloat=self.ballast is None,
        )

    def state_at(self, pose: Pose) -> Array:
        """Return the state at rest: (13,), and the height of the water's surface, m.

        The surface is where the floaters just carry the vehicle at its start: the caves of the original lost theirs,
        and its starts are taken for neutral.
        """
        state = rest_state(pose, 1)
        state[-1] = pose.position[2] + self.neutral_depth
        return state

    def top_speed(self, dt: float = 0.02) -> float:
        """Return the speed ahead (m/s) to which the engine's steps of `dt` lead."""
        drag = self.body.linear_drag
        return self.drive.force / self.body.mass * (1.0 - drag * dt) / drag if drag > 0 else float("inf")

    def summary(self) -> str:
        """Return what a list of vehicles says of it."""
        return (
            f"{self.body.mass:g} kg, {self.capsule.length:.2f} m long, {self.top_speed():.2f} m/s ahead, "
            "the original benchmark's body"
        )
