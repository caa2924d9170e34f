"""Vehicles as the kernels have them: model of motion, actuators, hull; one for each cave, or one for each vehicle."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.actuators import Controls, make_controls
from aquanav_tools.sim.batch.contact import Hull
from aquanav_tools.sim.batch.motion import Body, Thruster, body_values, make_body, mat6, vec6, views_of
from aquanav_tools.sim.batch.original import DraggedBody, make_dragged_body
from aquanav_tools.sim.batch.random import DYNAMICS, draw_many
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.boat import Boat
from aquanav_tools.sim.body_parameters import BodyParameters, DraggedBodyParameters
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.randomisation import (
    Draws,
    Randomisation,
    draw,
    num_thrusters,
    uniform_numbers,
    varied_body,
)
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
FRICTION = 0.09
"""Bullet multiplies the two bodies' 0.3."""
CONTACT_MARGIN = 0.005
"""Bullet makes contacts between surfaces that overlap, or are within 0 to 7 mm of each other (measured), m."""


@wp.struct
class Craft:
    """A vehicle: one of two models of motion, its actuators, its hull."""

    is_original: wp.int32
    body: Body
    dragged: DraggedBody
    controls: Controls
    hull: Hull


def make_craft(scenario: Scenario, vehicle: Vehicle, margin: float, device: Any) -> Craft:
    """Return a vehicle in a scenario's water, for contacts that are kept up to `margin` (m)."""
    craft, dt = Craft(), scenario.settings.limits.dt
    parameters = vehicle.motion_parameters(scenario.settings.water.density)
    craft.is_original = int(isinstance(vehicle, OriginalVehicle))
    if craft.is_original:
        craft.dragged = make_dragged_body(parameters, dt, device)
    else:
        craft.body = make_body(parameters, dt, device)
    craft.controls = make_controls(vehicle, dt)
    craft.hull = _make_hull(scenario, vehicle, margin)
    return craft


def _make_hull(scenario: Scenario, vehicle: Vehicle, margin: float) -> Hull:
    hull, capsule, mass = Hull(), vehicle.capsule, vehicle.total_mass
    hull.half_axis, hull.radius = 0.5 * capsule.axis_length, capsule.radius
    # A distance changes no faster than the position, and the mean distance to a cell's eight corners, weighted as the
    # interpolation does, is at most sqrt(3) / 2 spacings; the axis is sampled at its ends and its middle.
    field_error = 0.5 * np.sqrt(3.0) * scenario.field.spacing
    hull.margin, hull.friction = margin, FRICTION
    hull.reach = capsule.radius + margin + scenario.settings.collision_error + field_error + 0.25 * capsule.axis_length
    hull.mass, hull.inertia, hull.masses = mass[:3].mean(), mass[3:].mean(), vec6(*mass)
    return hull


class DrawnDynamics:
    """What the episodes of N vehicles draw of their dynamics, each from its seed alone."""

    def __init__(self, randomisation: Randomisation, vehicle: Vehicle | Boat, num: int) -> None:
        """Make room for what `num` vehicles of one kind draw from ranges."""
        self.randomisation = randomisation
        self.names = randomisation.names(vehicle)
        """What is drawn."""
        self.values: Array = np.zeros((num, len(self.names)))
        """(N, K) what each vehicle's episode has drawn."""

    @property
    def by_name(self) -> Draws:
        """(N,) of what is drawn, by name."""
        return {name: self.values[:, n] for n, name in enumerate(self.names)}

    def uniform(self, seeds: npt.NDArray[np.integer]) -> Array:
        """Return the (n, K) numbers between 0 and 1 from which episodes with (n,) seeds draw."""
        words = np.zeros((len(seeds), len(self.names)), dtype=np.uint32)
        for n in range(len(self.names)):
            words[:, n] = draw_many(seeds, DYNAMICS + n)
        return uniform_numbers(words)

    def keep(self, vehicles: npt.NDArray[np.integer], vehicle: Vehicle | Boat, uniform: Array) -> Draws:
        """Return what (n,) vehicles draw by (n, K) numbers, and remember it."""
        draws = draw(self.randomisation, vehicle, uniform)
        for n, name in enumerate(self.names):
            self.values[vehicles, n] = draws[name]
        return draws

    def write_sensing(self, arrays: Any, action_delay: int, observation_delay: int) -> None:
        """Write how rays err and what is late into the arrays of all vehicles; the delays are those of the task."""
        arrays.ray_gain.assign(self._value_of("ray_gain", 1.0).astype(np.float32))
        arrays.ray_bias.assign(self._value_of("ray_bias", 0.0).astype(np.float32))
        arrays.action_delays.assign(self._value_of("action_delay", action_delay).astype(np.int32))
        arrays.observation_delays.assign(self._value_of("observation_delay", observation_delay).astype(np.int32))

    def _value_of(self, name: str, default: float) -> Array:
        """Return (N,) what was drawn under a name; the default where there is none."""
        return self.by_name.get(name, np.full(len(self.values), default))


class DrawnCrafts(DrawnDynamics):
    """N vehicles, each with a body that is drawn for every episode, from its seed alone."""

    def __init__(
        self,
        pairs: Sequence[tuple[Scenario, Vehicle]],
        cave_of: npt.NDArray[np.integer],
        base: Sequence[Craft],
        randomisation: Randomisation,
        device: Any,
    ) -> None:
        """Make room for bodies.

        Args:
            pairs: The caves, and the vehicle in each; all of one kind, as what is drawn has one name for all of them.
            cave_of: (N,) index of the cave that each vehicle is in.
            base: The body of each cave's vehicle as its file has it.
            randomisation: The ranges.
            device: Warp's.
        """
        for _, vehicle in pairs:
            randomisation.check(vehicle)
        super().__init__(randomisation, pairs[0][1], len(cave_of))
        self._pairs, self._cave_of = list(pairs), np.array(cave_of)
        self._base = wp.array(list(base), dtype=Craft, device="cpu").numpy()
        self._nominal = self._base[self._cave_of]
        most = max(1, *(num_thrusters(vehicle) for _, vehicle in pairs))
        self._matrices = wp.zeros((len(cave_of), 2), dtype=mat6, device=device)
        self._thrusters = wp.zeros((len(cave_of), most), dtype=Thruster, device=device)
        rows = self._nominal.copy()
        rows["body"]["matrix"], rows["body"]["thrusters"] = views_of(self._matrices), views_of(self._thrusters)
        self._rows = rows
        self.array = wp.array(rows, dtype=Craft, device=device)
        """(N,) on the device."""

    def put(self, cave: int, pair: tuple[Scenario, Vehicle], base: Craft) -> None:
        """Put another cave with its vehicle in the place of one that no vehicle is in."""
        self.randomisation.check(pair[1])
        self._pairs[cave] = pair
        self._base[cave] = wp.array([base], dtype=Craft, device="cpu").numpy()[0]

    def move(self, vehicles: npt.NDArray[np.integer], caves: npt.NDArray[np.integer]) -> None:
        """Say that (n,) vehicles are in (n,) caves now; what they draw next is drawn there."""
        self._cave_of[vehicles] = caves
        self._nominal[vehicles] = self._base[caves]
        self._rows["hull"][vehicles] = self._nominal["hull"][vehicles]  # all else is drawn

    def draw(self, vehicles: npt.NDArray[np.integer], seeds: npt.NDArray[np.integer]) -> None:
        """Give some vehicles, (n,), the bodies of the episodes with (n,) seeds."""
        uniform = self.uniform(seeds)
        for cave in np.unique(self._cave_of[vehicles]).tolist():
            is_here = self._cave_of[vehicles] == cave
            self._draw_in(cave, vehicles[is_here], uniform[is_here])
        self.array.assign(self._rows)

    def _draw_in(self, cave: int, vehicles: npt.NDArray[np.integer], uniform: Array) -> None:
        scenario, vehicle = self._pairs[cave]
        draws = self.keep(vehicles, vehicle, uniform)
        density, dt = scenario.settings.water.density, scenario.settings.limits.dt
        parameters = varied_body(vehicle, density, draws, len(vehicles))
        rows = self._rows[vehicles]
        if isinstance(parameters, BodyParameters):
            self._put_bodies(vehicles, rows, parameters, dt)
        else:
            _put_dragged(rows, parameters, dt)
        self._put_controls(vehicles, rows, vehicle, draws)
        self._rows[vehicles] = rows

    def _put_bodies(
        self, vehicles: npt.NDArray[np.integer], rows: npt.NDArray[np.void], parameters: BodyParameters, dt: float
    ) -> None:
        bodies, pairs, thrusters = body_values(parameters, dt)
        for name in Body.vars:  # type: ignore[attr-defined]  # Warp makes the class a struct
            if name not in ("matrix", "thrusters"):
                rows["body"][name] = bodies[name]
        masses = np.diagonal(parameters.mass, axis1=1, axis2=2)
        rows["hull"]["mass"], rows["hull"]["inertia"] = masses[:, :3].mean(axis=1), masses[:, 3:].mean(axis=1)
        rows["hull"]["masses"] = masses
        _put_rows(self._matrices, vehicles, pairs)
        _put_rows(self._thrusters, vehicles, thrusters)

    def _put_controls(
        self, vehicles: npt.NDArray[np.integer], rows: npt.NDArray[np.void], vehicle: Vehicle, draws: Draws
    ) -> None:
        nominal, controls, one = self._nominal["controls"][vehicles], rows["controls"], np.ones(len(vehicles))
        thrust = draws.get("thrust", one) if num_thrusters(vehicle) == 0 else one
        controls["surge"], controls["yaw"] = thrust * nominal["surge"], thrust * nominal["yaw"]
        controls["reverse_fraction"] = draws.get("reverse", one) * nominal["reverse_fraction"]


def _put_dragged(rows: npt.NDArray[np.void], parameters: DraggedBodyParameters, dt: float) -> None:
    dragged = rows["dragged"]
    dragged["mass"], dragged["inertia"] = parameters.mass, parameters.inertia
    dragged["kept"] = 1.0 - np.asarray(parameters.linear_drag) * dt
    dragged["kept_turn"] = 1.0 - np.asarray(parameters.angular_drag) * dt
    dragged["centre"] = parameters.centre_of_mass
    mass, inertia = np.asarray(parameters.mass), np.asarray(parameters.inertia)
    rows["hull"]["mass"], rows["hull"]["inertia"] = mass, inertia.mean(axis=-1)
    rows["hull"]["masses"] = np.concatenate([np.repeat(mass[:, None], 3, axis=1), inertia], axis=1)


def _put_rows(array: Any, rows: npt.NDArray[np.integer], values: Any) -> None:
    host = array.numpy()
    host[rows, : values.shape[1]] = values
    if not array.device.is_cpu:  # where NumPy's array is not the same memory
        array.assign(host)
