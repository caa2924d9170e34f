"""Dynamics that differ from episode to episode: the ranges of a vehicle's numbers, and what comes of those drawn.

A range file is TOML, and each of its entries is a field of `Randomisation`, but for `extends`: the ranges that ship to
begin with. What is drawn is a number for each of
`Randomisation.names`, evenly from its range, by the episode's seed alone. `varied_body` makes a body of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.sim.boat import DENSITY, Boat, footprint_of
from aquanav_tools.sim.body_parameters import BodyParameters, DraggedBodyParameters, MotionParameters
from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.vehicle_base import GRAVITY, Vehicle
from aquanav_tools.tables import from_table, read_toml
from aquanav_tools.task import MAX_DELAY
from aquanav_tools.types import Array

Range = tuple[float, float]
FOLDER = Path(__file__).parent / "randomisations"
FACTORS = (
    "mass", "inertia", "volume", "added_mass", "linear_damping", "quadratic_damping", "thrust", "reverse", "thrusters",
    "lag", "ray_gain",
)  # fmt: skip
"""Fields that multiply; none of them may be zero or less."""
DELAYS = ("action_delay", "observation_delay")
SENSED = ("ray_gain", "ray_bias", *DELAYS)
AFLOAT = ("mass", "inertia", "payload", "linear_damping", "quadratic_damping", "thrust", "reverse", *SENSED)
"""What there is to draw of the original's boat, which stays level at its height."""
FLOATING = ("added_mass", "centre_of_mass_x", "centre_of_mass_y", "centre_of_mass_z", *AFLOAT)
"""What there is to draw of a boat that floats on its hulls. Its lift is what the water gives them, and its drives have
neither parts nor a lag: `volume`, `net_buoyancy`, `thrusters`, `weak_thruster` and `lag` are left out."""
MAX_OFFSET = 0.5
"""Of the hull's length: the centre of mass stays inside."""
Draws = dict[str, Array]
"""(N,) numbers by name."""


@dataclass(frozen=True, kw_only=True)
class Randomisation:
    """The ranges; None leaves a number as the vehicle's file has it."""

    mass: Range | None = None
    """Factor of the rigid body's mass."""
    inertia: Range | None = None
    """Factor of its moments of inertia."""
    volume: Range | None = None
    """Factor of the water that it displaces. A ballasted vehicle stays in trim, and only buoyancy's arm grows."""
    added_mass: Range | None = None
    linear_damping: Range | None = None
    """Factor, also of the original's linear drag."""
    quadratic_damping: Range | None = None
    """Factor, also of the original's angular drag."""
    net_buoyancy: Range | None = None
    """Lift that the trim has left, as a fraction of the ballast's full force."""
    centre_of_mass_x: Range | None = None
    """Offset ahead, m; it moves the weight. Mass matrices keep their centre."""
    centre_of_mass_y: Range | None = None
    """To the left, m."""
    centre_of_mass_z: Range | None = None
    """Up, m."""
    payload: Range | None = None
    """kg, at the hull's lowest point; its weight is trimmed away, its arm and its inertia are not."""
    thrust: Range | None = None
    """Factor of the thrust ahead and of the moment of steering, of all thrusters alike."""
    reverse: Range | None = None
    """Factor of the share of the thrust that reverse has."""
    thrusters: Range | None = None
    """Factor of each thruster by itself, for vehicles that have them."""
    lag: Range | None = None
    """Factor of the thrusters' time constant."""
    weak_thruster: float = 0.0
    """Probability that one thruster, each as likely as the others, has only `weak_thruster_gain` of its force."""
    weak_thruster_gain: Range = (0.0, 0.0)
    """0 is a dead one."""
    ray_gain: Range | None = None
    """Factor of the distances that rays measure."""
    ray_bias: Range | None = None
    """What is added to them, m."""
    action_delay: tuple[int, int] | None = None
    """Decisions, in place of the task's."""
    observation_delay: tuple[int, int] | None = None

    def __post_init__(self) -> None:
        for name, (low, high) in self.ranges.items():
            _check(math.isfinite(low) and math.isfinite(high) and low <= high, name, low, high, "a range rises")
        for name in FACTORS:
            low, high = getattr(self, name) or (1.0, 1.0)
            _check(low > 0.0, name, low, high, "a factor is more than 0: no body has no mass, and none moves without")
        for name in DELAYS:
            low, high = getattr(self, name) or (0, 0)
            _check(0 <= low and high <= MAX_DELAY, name, low, high, f"a delay is 0 to {MAX_DELAY} decisions")
        low, high = self.net_buoyancy or (0.0, 0.0)
        _check(
            -1.0 < low and high < 1.0, "net_buoyancy", low, high, "beyond -1 to 1 the ballast cannot hold the vehicle"
        )
        low, high = self.payload or (0.0, 0.0)
        _check(low >= 0.0, "payload", low, high, "no load weighs less than nothing")
        low, high = self.weak_thruster_gain
        _check(0.0 <= low and high <= 1.0, "weak_thruster_gain", low, high, "a weak thruster has 0 to 1 of its force")
        if not 0.0 <= self.weak_thruster <= 1.0:
            raise InputError(f"weak_thruster is {self.weak_thruster:g}; it is a probability from 0 to 1.")

    @property
    def ranges(self) -> dict[str, Range]:
        """The ranges that are given, by name."""
        named = {field.name: getattr(self, field.name) for field in fields(self) if field.name != "weak_thruster"}
        return {name: value for name, value in named.items() if value is not None}

    def names(self, vehicle: Vehicle | Boat) -> tuple[str, ...]:
        """Return what is drawn for a vehicle, in an order that stays: thrusters are numbered from 1."""
        if isinstance(vehicle, Boat):
            return tuple(name for name in self.ranges if name in FLOATING)
        if isinstance(vehicle, OriginalVehicle) and vehicle.ballast is None:
            return tuple(name for name in self.ranges if name in AFLOAT)
        num = num_thrusters(vehicle)
        singles = [name for name in self.ranges if name not in ("thrusters", "weak_thruster_gain")]
        each = [f"thruster_{n + 1}" for n in range(num)] if self.thrusters is not None else []
        weak = ["weak_thruster", "weak_thruster_gain"] if self.weak_thruster > 0.0 and num > 0 else []
        return (*singles, *each, *weak)

    def most_delays(self) -> tuple[int, int]:
        """Return the longest delays of actions and of observations, decisions."""
        longest = [0 if getattr(self, name) is None else int(getattr(self, name)[1]) for name in DELAYS]
        return longest[0], longest[1]

    def check(self, vehicle: Vehicle | Boat) -> None:
        """Refuse ranges that make an impossible body of a vehicle.

        Raises:
            InputError: the centre of mass leaves the hull, or a boat sinks.
        """
        if isinstance(vehicle, Boat):
            heaviest = (self.mass or (1.0, 1.0))[1] * vehicle.mass + (self.payload or (0.0, 0.0))[1]
            if heaviest >= DENSITY * vehicle.volume:
                raise InputError(
                    f"With mass and payload of the randomisation the boat {vehicle.name} weighs up to {heaviest:.3g} "
                    f"kg, and its hulls carry {DENSITY * vehicle.volume:.3g} kg. Lower these ranges."
                )
        most = MAX_OFFSET * (footprint_of(vehicle) if isinstance(vehicle, Boat) else vehicle.capsule).length
        for axis in "xyz":
            low, high = getattr(self, f"centre_of_mass_{axis}") or (0.0, 0.0)
            if max(abs(low), abs(high)) >= most:
                raise InputError(
                    f"centre_of_mass_{axis} is {low:g} to {high:g} m; the hull ends {most:.2f} m from its middle, and "
                    "its centre of mass lies inside. Is the range in another unit?"
                )


def read_randomisation(spec: str | Path) -> Randomisation:
    """Return the ranges of a name ("late", "mild", "wide") or of a TOML file.

    Raises:
        InputError: there is no such name, or the file's ranges make no sense.
    """
    known = sorted(path.stem for path in FOLDER.glob("*.toml"))
    path = Path(spec) if str(spec).endswith(".toml") else FOLDER / f"{spec}.toml"
    if not path.exists():
        hint = "There is no such file." if str(spec).endswith(".toml") else did_you_mean(str(spec), known).strip()
        raise InputError(f"There is no randomisation '{spec}'. {hint} Known are {', '.join(known)}, and TOML files.")
    table = read_toml(path)
    base = table.pop("extends", None)
    if base is not None:
        if base not in known:
            raise InputError(
                f"{path.name} extends {base!r}, and what can be extended are the ranges that ship: {', '.join(known)}."
            )
        table = read_toml(FOLDER / f"{base}.toml") | table
    return from_table(Randomisation, table, path.name)


def num_thrusters(vehicle: Vehicle | Boat) -> int:
    """Return how many thrusters a vehicle has; 0 where its forces act as they are asked for."""
    thrusters = vehicle.thrusters if isinstance(vehicle, FossenVehicle) else None
    return 0 if thrusters is None else len(thrusters.positions)


def draw(ranges: Randomisation, vehicle: Vehicle | Boat, uniform: Array) -> Draws:
    """Return what N episodes draw.

    Args:
        ranges: From which.
        vehicle: Whose.
        uniform: (N, K) numbers evenly drawn between 0 and 1, for the K `names` of the ranges.
    """
    draws: Draws = {}
    for column, name in zip(uniform.T, ranges.names(vehicle), strict=True):
        if name == "weak_thruster":
            # Which one is drawn from where in the probability's range the number lies; 0 is none.
            num, fraction = num_thrusters(vehicle), column / ranges.weak_thruster
            draws[name] = np.where(fraction < 1.0, np.floor(np.minimum(fraction, 0.999999) * num) + 1.0, 0.0)
            continue
        low, high = ranges.thrusters or (1.0, 1.0) if name.startswith("thruster_") else getattr(ranges, name)
        if name in DELAYS:
            draws[name] = np.minimum(np.floor(low + column * (high - low + 1)), high)
        else:
            draws[name] = low + column * (high - low)
    return draws


def varied_body(vehicle: Vehicle, density: float, draws: Draws, num: int) -> MotionParameters:
    """Return the motion parameters of N vehicles, each with what was drawn for it.

    Raises:
        TypeError: the vehicle is of no model that swims.
    """

    def of(name: str, default: float) -> Array:
        return draws.get(name, np.full(num, default))

    if isinstance(vehicle, FossenVehicle):
        return _varied_fossen(vehicle, density, of, draws, num)
    if isinstance(vehicle, OriginalVehicle):
        return _varied_original(vehicle, density, of)
    raise TypeError(f"No dynamics are known for a {type(vehicle).__name__}.")


def water_damping(vehicle: FossenVehicle, draws: Draws, num: int) -> tuple[Array, Array]:
    """Return the (N, 6) linear and quadratic damping of N vehicles by the water, each with what was drawn for it."""
    one = np.ones(num)
    linear = draws.get("linear_damping", one)[:, None] * np.array(vehicle.water.linear_damping)
    quadratic = draws.get("quadratic_damping", one)[:, None] * np.array(vehicle.water.quadratic_damping)
    return linear, quadratic


def control_factors(vehicle: Vehicle, draws: Draws, num: int) -> tuple[Array, Array]:
    """Return (N,) factors of the thrust and the moment that commands ask for, and of the share that reverse has.

    Where a vehicle has thrusters, their gains are part of its body, and commands ask for what they always did.
    """
    one = np.ones(num)
    return draws.get("thrust", one) if num_thrusters(vehicle) == 0 else one, draws.get("reverse", one)


def _varied_fossen(vehicle: FossenVehicle, density: float, of: Any, draws: Draws, num: int) -> BodyParameters:
    nominal = vehicle.motion_parameters(density)
    payload, place = of("payload", 0.0), np.array([0.0, 0.0, -vehicle.capsule.radius])
    rigid = np.repeat(vehicle.body.rigid_mass()[None], num, axis=0)
    rigid[:, :3] *= of("mass", 1.0)[:, None, None]
    rigid[:, 3:, :3] *= of("mass", 1.0)[:, None, None]
    rigid[:, 3:, 3:] *= of("inertia", 1.0)[:, None, None]
    rigid[:, range(3), range(3)] += payload[:, None]
    rigid[:, range(3, 6), range(3, 6)] += payload[:, None] * (place @ place - place**2)
    mass = rigid + of("added_mass", 1.0)[:, None, None] * vehicle.water.matrix()
    linear, quadratic = water_damping(vehicle, draws, num)
    linear = linear + (
        nominal.linear_damping - np.array(vehicle.water.linear_damping)
    )  # the autopilot's, if it is there
    weight = nominal.net_weight - of("net_buoyancy", 0.0) * vehicle.actuators.heave_force
    buoyancy = density * GRAVITY * vehicle.body.volume
    arm = np.repeat(np.asarray(nominal.arm)[None], num, axis=0)
    arm[:, 2] += (of("volume", 1.0) - 1.0) * buoyancy * vehicle.body.buoyancy_height
    offset = np.stack([of(f"centre_of_mass_{axis}", 0.0) for axis in "xyz"], axis=1)
    arm -= buoyancy * offset + GRAVITY * payload[:, None] * place
    thrusters = nominal.thrusters
    if thrusters is not None:
        gains = np.stack([of(f"thruster_{n + 1}", 1.0) for n in range(len(thrusters.wrenches))], axis=1)
        gains *= of("thrust", 1.0)[:, None]
        which, gain = of("weak_thruster", 0.0).astype(int), of("weak_thruster_gain", 1.0)
        weak = np.flatnonzero(which)
        gains[weak, which[weak] - 1] *= gain[weak]
        thrusters = replace(
            thrusters,
            wrenches=gains[:, :, None] * thrusters.wrenches,
            time_constant=of("lag", 1.0) * thrusters.time_constant,
        )
    return replace(
        nominal,
        mass=mass,
        linear_damping=linear,
        quadratic_damping=quadratic,
        net_weight=weight,
        arm=arm,
        thrusters=thrusters,
    )


def _varied_original(vehicle: OriginalVehicle, density: float, of: Any) -> DraggedBodyParameters:
    nominal = vehicle.motion_parameters(density)
    offset = np.stack([of(f"centre_of_mass_{axis}", 0.0) for axis in "xyz"], axis=1)
    return replace(
        nominal,
        mass=of("mass", 1.0) * nominal.mass + of("payload", 0.0),
        inertia=of("inertia", 1.0)[:, None] * nominal.inertia,
        linear_drag=of("linear_damping", 1.0) * nominal.linear_drag,
        angular_drag=of("quadratic_damping", 1.0) * nominal.angular_drag,
        centre_of_mass=nominal.centre_of_mass + offset,
    )


def varied_boat(boat: Boat | OriginalVehicle, drawn: Mapping[str, float]) -> tuple[Boat | OriginalVehicle, Array]:
    """Return the boat whose file says what was drawn for one episode, and how far its weight is off its origin.

    The second is the (3,) whose cross product with the vertical is the weight's moment about the origin, N m, by an
    offset of the centre of mass and by the payload, which lies at the hulls' bottom. No file of a boat has it.
    """

    def times(name: str, *values: float) -> Any:
        products = tuple(drawn.get(name, 1.0) * value for value in values)
        return products if len(values) > 1 else products[0]

    payload = drawn.get("payload", 0.0)
    if isinstance(boat, OriginalVehicle):
        body, drive = boat.body, boat.drive
        body = replace(
            body,
            mass=times("mass", body.mass) + payload,
            inertia=times("inertia", *body.inertia),
            linear_drag=times("linear_damping", body.linear_drag),
            angular_drag=times("quadratic_damping", body.angular_drag),
        )
        force, moment = times("thrust", drive.force, drive.steer_moment)
        reverse = times("reverse", drive.reverse_fraction)
        drive = replace(drive, force=force, steer_moment=moment, reverse_fraction=reverse)
        return replace(boat, body=body, drive=drive), np.zeros(3)
    bottom = footprint_of(boat).bottom
    force, moment = times("thrust", boat.surge_force, boat.yaw_moment)
    normal_drag, friction = times("quadratic_damping", boat.normal_drag, boat.friction)
    roll, pitch, yaw = times("inertia", *boat.inertia)
    offset = np.array([drawn.get(f"centre_of_mass_{axis}", 0.0) for axis in "xyz"])
    varied = replace(
        boat,
        mass=times("mass", boat.mass) + payload,
        inertia=(roll + payload * bottom**2, pitch + payload * bottom**2, yaw),
        added_mass=times("added_mass", *boat.added_mass),
        added_inertia=times("added_mass", *boat.added_inertia),
        linear_damping=times("linear_damping", *boat.linear_damping),
        normal_drag=normal_drag,
        friction=friction,
        surge_force=force,
        reverse_fraction=times("reverse", boat.reverse_fraction),
        yaw_moment=moment,
    )
    moments = times("mass", boat.mass) * offset + payload * np.array([0.0, 0.0, bottom])
    return varied, -GRAVITY * moments


def _check(is_right: bool, name: str, low: float, high: float, rule: str) -> None:
    if not is_right:
        raise InputError(f"{name} of the randomisation is {low:g} to {high:g}; {rule}.")


def uniform_numbers(words: npt.NDArray[np.uint32]) -> Array:
    """Return numbers of the open interval between 0 and 1 from 32 random bits each."""
    return (words.astype(np.float64) + 0.5) / 2.0**32
