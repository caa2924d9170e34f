"""Vehicles are data: one TOML file each, in the folder `vehicles` beside this module or anywhere else."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.sim.hydrodynamics import pack_parameters
from aquanav_tools.tables import from_table, parse_toml, read_toml
from aquanav_tools.types import Array, Capsule

VEHICLE_DIR = Path(__file__).parent / "vehicles"
GRAVITY = 9.81
"""m/s^2."""

Three = tuple[float, float, float]
Six = tuple[float, float, float, float, float, float]


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

    def __post_init__(self) -> None:
        _check_positive("mass", self.mass)
        _check_positive("volume", self.volume)
        _check_positive("inertia", *self.inertia)
        _check_not_negative("buoyancy_height", self.buoyancy_height)


@dataclass(frozen=True)
class WaterCoefficients:
    """What the water adds, per axis: surge, sway, heave, roll, pitch, yaw."""

    added_mass: Six
    """kg and kg m^2."""
    linear_damping: Six
    """N s/m and N m s/rad."""
    quadratic_damping: Six
    """N s^2/m^2 and N m s^2/rad^2."""

    def __post_init__(self) -> None:
        _check_not_negative("added_mass", *self.added_mass)
        _check_not_negative("linear_damping", *self.linear_damping)
        _check_not_negative("quadratic_damping", *self.quadratic_damping)


@dataclass(frozen=True)
class Actuators:
    """What the three actions do."""

    surge_force: float
    """Full thrust ahead, N."""
    reverse_share: float
    """Full thrust in reverse, as a share of surge_force."""
    yaw_rate: float
    """Rate of turn that full steer asks for, rad/s."""
    heave_force: float
    """Force of the ballast at full trim, N."""
    trim_rate: float
    """Change of the trim (in [-1, 1]) while up or down is commanded, 1/s."""

    def __post_init__(self) -> None:
        for name in ("surge_force", "reverse_share", "yaw_rate", "heave_force", "trim_rate"):
            _check_positive(name, getattr(self, name))


@dataclass(frozen=True)
class Autopilot:
    """Keeps the vehicle level and its rates at what is asked for."""

    rate_gain: Three
    """Moment per missing rate of turn about body x, y, z, N m s/rad."""
    level_gain: float
    """Moment per sine of the tilt, N m."""

    def __post_init__(self) -> None:
        _check_not_negative("rate_gain", *self.rate_gain)
        _check_not_negative("level_gain", self.level_gain)


@dataclass(frozen=True)
class Vehicle:
    """Everything the simulation knows about a vehicle."""

    name: str
    capsule: Capsule
    """Its hull."""
    body: Body
    water: WaterCoefficients
    actuators: Actuators
    autopilot: Autopilot

    def motion_parameters(self, density: float) -> Array:
        """Return the parameters for `hydrodynamics.advance` in water of `density` (kg/m^3).

        The vehicle is ballasted to float at neutral trim. The autopilot's rate loop acts as damping and its level
        loop as metacentric height, so that the integrator's exact damping flow covers them.
        """
        buoyancy = density * GRAVITY * self.body.volume
        return pack_parameters(
            mass=self.total_mass,
            linear_damping=np.add(self.water.linear_damping, (0.0, 0.0, 0.0, *self.autopilot.rate_gain)),
            quadratic_damping=np.array(self.water.quadratic_damping),
            righting=buoyancy * self.body.buoyancy_height + self.autopilot.level_gain,
        )

    @property
    def total_mass(self) -> Array:
        """(6,) rigid-body plus added mass and inertia, kg and kg m^2."""
        mass = self.body.mass
        total: Array = np.add((mass, mass, mass, *self.body.inertia), self.water.added_mass)
        return total


def known_vehicles() -> tuple[str, ...]:
    """Return the names of the vehicles that ship with aquanav."""
    return tuple(sorted(path.stem for path in VEHICLE_DIR.glob("*.toml")))


def load_vehicle(name: str | Path) -> Vehicle:
    """Return a vehicle by its name, or from the TOML file at a path that ends in .toml.

    Raises:
        InputError: no such vehicle (with the closest name), or the file has an unknown, missing or senseless value
            (with the name of the field).
    """
    path = vehicle_path(name)
    return from_table(Vehicle, read_toml(path), path.name)


def vehicle_path(name: str | Path) -> Path:
    """Return the file of a shipped vehicle by its name; a path that ends in .toml is returned as it is.

    Raises:
        InputError: no vehicle of that name ships with aquanav; the message has the closest one.
    """
    if Path(name).suffix == ".toml":
        return Path(name)
    if str(name) not in known_vehicles():
        raise InputError(f"There is no vehicle '{name}'.{did_you_mean(str(name), known_vehicles())}")
    return VEHICLE_DIR / f"{name}.toml"


def parse_vehicle(text: str, where: str) -> Vehicle:
    """Return the vehicle in the text of a TOML file; `where` is what messages call it.

    Raises:
        InputError: as `load_vehicle`.
    """
    return from_table(Vehicle, parse_toml(text, where), where)


def _check_positive(name: str, *values: float) -> None:
    if not all(math.isfinite(value) and value > 0 for value in values):
        raise ValueError(f"{name} must be positive, got {', '.join(f'{value:g}' for value in values)}.")


def _check_not_negative(name: str, *values: float) -> None:
    if not all(math.isfinite(value) and value >= 0 for value in values):
        raise ValueError(f"{name} must not be negative, got {', '.join(f'{value:g}' for value in values)}.")
