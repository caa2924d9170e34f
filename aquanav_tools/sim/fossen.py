"""Vehicles after Fossen: a rigid body with added mass, damping, righting, and actions through force or thrusters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from aquanav_tools.sim.body_parameters import BodyParameters
from aquanav_tools.sim.thrusters import Thrusters, check_reach
from aquanav_tools.sim.vehicle_base import (
    GRAVITY,
    Six,
    SixRows,
    Three,
    Vehicle,
    check_finite,
    check_inertia,
    check_not_negative,
    check_positive,
    rest_state,
)
from aquanav_tools.types import Array, Pose

FRESH_WATER = 1000.0
"""kg/m^3."""
MAX_BALLAST = 0.1
"""Share of its mass by which a vehicle may be out of trim before ballast is no explanation; chosen."""
YAW = 5


@dataclass(frozen=True)
class Body:
    """The rigid body."""

    mass: float
    """kg."""
    volume: float
    """Displaced water, m^3."""
    inertia: Three
    """About body x, y, z through the centre of mass, kg m^2."""
    buoyancy_height: float
    """Height of the centre of buoyancy above the centre of mass, m."""
    centre_of_mass: Three = (0.0, 0.0, 0.0)
    """In the body frame, m. Its origin is the capsule's middle, to which everything else in the file refers."""
    ballasted: bool = True
    """Whether weights are added or taken until it floats in the water at hand; otherwise it rises or sinks by
    what mass and volume say."""

    def __post_init__(self) -> None:
        check_positive("mass", self.mass)
        check_positive("volume", self.volume)
        check_inertia("inertia", self.inertia)
        check_not_negative("buoyancy_height", self.buoyancy_height)
        check_finite("centre_of_mass", *self.centre_of_mass)
        displaced = FRESH_WATER * self.volume
        if self.ballasted and abs(displaced - self.mass) > MAX_BALLAST * self.mass:
            raise ValueError(
                f"volume is {self.volume:g} m^3, which displaces {displaced:.4g} kg of fresh water, but mass is "
                f"{self.mass:g} kg: too far apart for ballast to trim. Correct either, or set ballasted = false for a "
                "vehicle that is meant to rise or sink."
            )

    def rigid_mass(self) -> Array:
        """Return the (6, 6) mass matrix about the body frame's origin (Fossen 2011, equation 3.44)."""
        x, y, z = self.centre_of_mass
        shift = np.eye(6)
        shift[:3, 3:] = -np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
        matrix: Array = shift.T @ np.diag([self.mass] * 3 + list(self.inertia)) @ shift
        return matrix

    def restoring(self, density: float) -> tuple[float, Array]:
        """Return the weight less the buoyancy, N, and the (3,) arm: the moment of both is arm x (world z), N m."""
        buoyancy = density * GRAVITY * self.volume
        weight = buoyancy if self.ballasted else self.mass * GRAVITY
        centre = np.array(self.centre_of_mass)
        return weight - buoyancy, (buoyancy - weight) * centre + buoyancy * np.array([0.0, 0.0, self.buoyancy_height])


@dataclass(frozen=True)
class WaterCoefficients:
    """What the water adds, per axis: surge, sway, heave, roll, pitch, yaw."""

    linear_damping: Six
    """N s/m and N m s/rad."""
    quadratic_damping: Six
    """N s^2/m^2 and N m s^2/rad^2."""
    added_mass: Six | None = None
    """kg and kg m^2."""
    added_mass_matrix: SixRows | None = None
    """Instead of added_mass, where axes are coupled: kg, kg m and kg m^2."""

    def __post_init__(self) -> None:
        check_not_negative("linear_damping", *self.linear_damping)
        check_not_negative("quadratic_damping", *self.quadratic_damping)
        if (self.added_mass is None) == (self.added_mass_matrix is None):
            raise ValueError("added_mass (6 values) or added_mass_matrix (6 rows of 6) must be given, one of the two.")
        if self.added_mass is not None:
            check_not_negative("added_mass", *self.added_mass)
        else:
            _check_added_mass(self.matrix())

    def matrix(self) -> Array:
        """Return the (6, 6) added mass."""
        return np.diag(self.added_mass) if self.added_mass is not None else np.array(self.added_mass_matrix)


def _check_added_mass(matrix: Array) -> None:
    """Refuse a matrix that is not symmetric or would give energy away."""
    check_finite("added_mass_matrix", *matrix.ravel())
    difference = np.abs(matrix - matrix.T)
    if difference.max() > 1e-6 * np.abs(matrix).max():
        row, column = np.unravel_index(difference.argmax(), matrix.shape)
        raise ValueError(
            f"added_mass_matrix must be symmetric, but row {row + 1} column {column + 1} has "
            f"{matrix[row, column]:g} and its mirror image {matrix[column, row]:g}."
        )
    least = float(np.linalg.eigvalsh(matrix)[0])
    if least < -1e-9 * np.abs(matrix).max():
        raise ValueError(
            f"added_mass_matrix must be positive definite, but has the eigenvalue {least:g}: some motion would take "
            "energy out of still water. Values as papers print them (X_udot, ...) are the negative of added mass."
        )


@dataclass(frozen=True)
class Actuators:
    """What the three actions do."""

    surge_force: float
    """Full thrust ahead, N."""
    reverse_fraction: float
    """Full thrust in reverse, as a share of surge_force."""
    yaw_rate: float
    """Rate of turn that full steer asks for, rad/s."""
    heave_force: float
    """Force of the ballast at full trim, N."""
    trim_rate: float
    """Change of the trim (in [-1, 1]) while up or down is commanded, 1/s."""

    def __post_init__(self) -> None:
        for name in ("surge_force", "reverse_fraction", "yaw_rate", "heave_force", "trim_rate"):
            check_positive(name, getattr(self, name))


@dataclass(frozen=True)
class Autopilot:
    """Keeps the vehicle level and its rates at what is asked for."""

    rate_gain: Three
    """Moment per missing rate of turn about body x, y, z, N m s/rad."""
    level_gain: float
    """Moment per sine of the tilt, N m."""

    def __post_init__(self) -> None:
        check_not_negative("rate_gain", *self.rate_gain)
        check_not_negative("level_gain", self.level_gain)


@dataclass(frozen=True)
class FossenVehicle(Vehicle):
    """A vehicle with hydrodynamics."""

    body: Body
    water: WaterCoefficients
    actuators: Actuators
    autopilot: Autopilot
    thrusters: Thrusters | None = None
    """Without them the actions' forces and the autopilot's moments act at once and as asked for."""
    model: Literal["fossen"] = "fossen"

    def __post_init__(self) -> None:
        if self.thrusters is not None:
            check_reach(self.thrusters, self.demands(), self._autopilot_axes())

    def demands(self) -> dict[str, Array]:
        """Return the (6,) wrench of each full action alone, N and N m."""
        demands = {}
        for name, axis, size in (
            ("full ahead", 0, self.actuators.surge_force),
            ("full reverse", 0, -self.actuators.surge_force * self.actuators.reverse_fraction),
            ("full ballast up", 2, self.actuators.heave_force),
            ("full ballast down", 2, -self.actuators.heave_force),
            ("full steer left", YAW, self.full_steer),
            ("full steer right", YAW, -self.full_steer),
        ):
            demands[name] = np.zeros(6)
            demands[name][axis] = size
        return demands

    @property
    def full_steer(self) -> float:
        """Moment that full steer asks for while the vehicle does not turn yet, N m."""
        return self.actuators.yaw_rate * self.autopilot.rate_gain[2]

    def _autopilot_axes(self) -> list[int]:
        gains = np.array(self.autopilot.rate_gain) + [self.autopilot.level_gain, self.autopilot.level_gain, 0.0]
        return [3 + axis for axis in range(3) if gains[axis] > 0]

    @property
    def mass_matrix(self) -> Array:
        """(6, 6) rigid-body plus added mass about the body frame's origin, kg, kg m and kg m^2."""
        matrix: Array = self.body.rigid_mass() + self.water.matrix()
        return matrix

    @property
    def total_mass(self) -> Array:
        """(6,) diagonal of the mass matrix, kg and kg m^2."""
        return np.diag(self.mass_matrix).copy()

    def motion_parameters(self, density: float) -> BodyParameters:
        """Return the parameters of its motion in water of `density` (kg/m^3).

        Without thrusters the autopilot's rate loop acts as damping and its level loop as metacentric height, so that
        the integrator's exact damping flow covers them. With thrusters it is a feedback, once per step.
        """
        net_weight, arm = self.body.restoring(density)
        linear, quadratic = np.array(self.water.linear_damping), np.array(self.water.quadratic_damping)
        rate_gain, level_gain = np.array(self.autopilot.rate_gain), self.autopilot.level_gain
        if self.thrusters is None:
            linear[3:] += rate_gain
            arm[2] += level_gain
            return BodyParameters(self.mass_matrix, linear, quadratic, net_weight, arm)
        thrusters = self.thrusters.parameters()
        return BodyParameters(self.mass_matrix, linear, quadratic, net_weight, arm, rate_gain, level_gain, thrusters)

    def state_at(self, pose: Pose) -> Array:
        """Return the state at rest: (13,), and the force of every thruster, N."""
        return rest_state(pose, 0 if self.thrusters is None else len(self.thrusters.positions))

    def top_speed(self) -> float:
        """Return the speed (m/s) at which full thrust ahead and the water's drag balance."""
        linear, quadratic = self.water.linear_damping[0], self.water.quadratic_damping[0]
        force = self.actuators.surge_force
        if quadratic == 0.0:
            return force / linear if linear > 0.0 else float("inf")
        return float((np.sqrt(linear * linear + 4.0 * quadratic * force) - linear) / (2.0 * quadratic))

    def summary(self) -> str:
        """Return what a list of vehicles says of it."""
        driven = "ideal forces" if self.thrusters is None else f"{len(self.thrusters.positions)} thrusters"
        return f"{self.body.mass:g} kg, {self.capsule.length:.2f} m long, {self.top_speed():.2f} m/s ahead, {driven}"
