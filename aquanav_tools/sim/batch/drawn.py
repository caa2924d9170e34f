"""Dynamics that are drawn for every episode: what is drawn of N vehicles, and the vehicles for the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.craft import Craft
from aquanav_tools.sim.batch.motion import Body, Thruster, body_values, mat6, views_of
from aquanav_tools.sim.batch.random import DYNAMICS, NEXT, draw_many
from aquanav_tools.sim.batch.runtime import put_rows
from aquanav_tools.sim.boat import Boat
from aquanav_tools.sim.body_parameters import BodyParameters, DraggedBodyParameters
from aquanav_tools.sim.randomisation import (
    SENSED,
    Draws,
    Randomisation,
    control_factors,
    draw,
    num_thrusters,
    uniform_numbers,
    varied_body,
)
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Array

SENSED_ARRAYS = dict(zip(SENSED, ("ray_gain", "ray_bias", "action_delays", "observation_delays"), strict=True))
"""Where the kernels read what is drawn of sensing."""


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

    def drawn_for(self, seeds: npt.NDArray[np.integer], vehicle: Vehicle | Boat) -> Array:
        """Return the (n, K) numbers that episodes of a vehicle with (n,) seeds draw."""
        words = np.zeros((len(seeds), len(self.names)), dtype=np.uint32)
        for n in range(len(self.names)):
            words[:, n] = draw_many(seeds, DYNAMICS + n)
        draws = draw(self.randomisation, vehicle, uniform_numbers(words))
        return np.stack([draws[name] for name in self.names], axis=1) if self.names else np.zeros(words.shape)

    def write_sensing(self, arrays: Any, vehicles: npt.NDArray[np.integer]) -> None:
        """Write how the rays of (n,) vehicles err and what is late; what is not drawn stays in the arrays as it is."""
        for name, values in self.by_name.items():
            if name in SENSED_ARRAYS:
                put_rows(getattr(arrays, SENSED_ARRAYS[name]), vehicles, values[vehicles])


@dataclass(frozen=True, eq=False)
class CraftRows:
    """The bodies of N vehicles, and what was drawn for them."""

    crafts: npt.NDArray[np.void]
    """(N,) of `Craft`."""
    matrices: Array
    """(N, 2, 6, 6) to which these point: the mass matrices and their inverses."""
    thrusters: npt.NDArray[np.void]
    """(N, T) to which these point."""
    values: Array
    """(N, K)."""

    def copy(self) -> CraftRows:
        """Return the same in memory of its own; the crafts still point to where they did."""
        return CraftRows(self.crafts.copy(), self.matrices.copy(), self.thrusters.copy(), self.values.copy())

    def take(self, rows: npt.NDArray[np.integer], other: CraftRows) -> None:
        """Become the other in (n,) rows."""
        _whole(self.crafts)[rows] = _whole(other.crafts)[rows]
        _whole(self.thrusters)[rows] = _whole(other.thrusters)[rows]
        self.matrices[rows], self.values[rows] = other.matrices[rows], other.values[rows]


class DrawnCrafts(DrawnDynamics):
    """N vehicles, each with a body that is drawn for every episode, from its seed alone.

    To draw a thousand bodies takes little longer than to draw one, and episodes end one by one. So the bodies of the
    episodes that will follow are drawn ahead, for all vehicles that have none in store, when the first of these ends:
    the seed of the next episode follows from that of the last one.
    """

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
        num = len(cave_of)
        super().__init__(randomisation, pairs[0][1], num)
        self._pairs, self._cave_of = list(pairs), np.array(cave_of)
        self._base = wp.array(list(base), dtype=Craft, device="cpu").numpy()
        crafts = self._base[self._cave_of]
        self._nominal_controls = crafts["controls"].copy()
        most = max(1, *(num_thrusters(vehicle) for _, vehicle in pairs))
        self._matrices = wp.zeros((num, 2), dtype=mat6, device=device)
        self._thrusters = wp.zeros((num, most), dtype=Thruster, device=device)
        crafts["body"]["matrix"], crafts["body"]["thrusters"] = views_of(self._matrices), views_of(self._thrusters)
        self.array = wp.array(crafts, dtype=Craft, device=device)
        """(N,) on the device."""
        # On the processor NumPy's arrays are the device's memory.
        self._now = CraftRows(self.array.numpy(), self._matrices.numpy(), self._thrusters.numpy(), self.values)
        self._ahead = self._now.copy()
        self._seeds, self._seeds_ahead = np.zeros((2, num), dtype=np.uint32)
        self._is_ahead = np.zeros(num, dtype=np.bool_)

    def put(self, cave: int, pair: tuple[Scenario, Vehicle], base: Craft) -> None:
        """Put another cave with its vehicle in the place of one that no vehicle is in."""
        self.randomisation.check(pair[1])
        self._pairs[cave] = pair
        self._base[cave] = wp.array([base], dtype=Craft, device="cpu").numpy()[0]

    def move(self, vehicles: npt.NDArray[np.integer], caves: npt.NDArray[np.integer]) -> None:
        """Say that (n,) vehicles are in (n,) caves now; what they draw next is drawn there."""
        self._cave_of[vehicles] = caves
        self._nominal_controls[vehicles] = self._base["controls"][caves]
        self._ahead.crafts["hull"][vehicles] = self._base["hull"][caves]  # all else is drawn, but where floaters are:
        self._ahead.crafts["dragged"]["floaters"][vehicles] = self._base["dragged"]["floaters"][caves]
        self._is_ahead[vehicles] = False

    def draw(self, vehicles: npt.NDArray[np.integer], seeds: npt.NDArray[np.integer]) -> None:
        """Give some vehicles, (n,), the bodies of the episodes with (n,) seeds."""
        if not (self._is_ahead[vehicles] & (self._seeds_ahead[vehicles] == seeds)).all():
            self._draw_ahead(vehicles, seeds)
        self._take(vehicles, seeds)

    def draw_successors(self, vehicles: npt.NDArray[np.integer]) -> None:
        """Give some vehicles, (n,), the bodies of the episodes that follow theirs."""
        if not self._is_ahead[vehicles].all():
            self._draw_ahead(vehicles, draw_many(self._seeds[vehicles], NEXT))
        self._take(vehicles, self._seeds_ahead[vehicles])

    def _take(self, vehicles: npt.NDArray[np.integer], seeds: npt.NDArray[np.integer]) -> None:
        """Give (n,) vehicles the bodies in store, which were drawn for (n,) seeds."""
        self._now.take(vehicles, self._ahead)
        self._seeds[vehicles], self._is_ahead[vehicles] = seeds, False
        if not self.array.device.is_cpu:
            self.array.assign(self._now.crafts)
            self._matrices.assign(self._now.matrices)
            self._thrusters.assign(self._now.thrusters)

    def _draw_ahead(self, vehicles: npt.NDArray[np.integer], seeds: npt.NDArray[np.integer]) -> None:
        """Draw for (n,) vehicles, whose next episodes have (n,) seeds, and for all others that have none in store."""
        self._is_ahead[vehicles] = False
        lacking = np.flatnonzero(~self._is_ahead)
        self._seeds_ahead[lacking] = draw_many(self._seeds[lacking], NEXT)
        self._seeds_ahead[vehicles] = seeds
        for cave in np.unique(self._cave_of[lacking]).tolist():
            self._draw_in(cave, lacking[self._cave_of[lacking] == cave])
        self._is_ahead[lacking] = True

    def _draw_in(self, cave: int, vehicles: npt.NDArray[np.integer]) -> None:
        scenario, vehicle = self._pairs[cave]
        values = self.drawn_for(self._seeds_ahead[vehicles], vehicle)
        draws = dict(zip(self.names, values.T, strict=True))
        density, dt = scenario.settings.water.density, scenario.settings.limits.dt
        parameters = varied_body(vehicle, density, draws, len(vehicles))
        crafts = _whole(self._ahead.crafts)[vehicles].view(self._ahead.crafts.dtype)
        if isinstance(parameters, BodyParameters):
            self._put_bodies(vehicles, crafts, parameters, dt)
        else:
            _put_dragged(crafts, parameters, dt)
        self._put_controls(vehicles, crafts, vehicle, draws)
        _whole(self._ahead.crafts)[vehicles] = _whole(crafts)
        self._ahead.values[vehicles] = values

    def _put_bodies(
        self, vehicles: npt.NDArray[np.integer], crafts: npt.NDArray[np.void], parameters: BodyParameters, dt: float
    ) -> None:
        bodies, pairs, thrusters = body_values(parameters, dt)
        for name in Body.vars:  # type: ignore[attr-defined]  # Warp makes the class a struct
            if name not in ("matrix", "thrusters"):
                crafts["body"][name] = bodies[name]
        masses = np.diagonal(parameters.mass, axis1=1, axis2=2)
        crafts["hull"]["mass"], crafts["hull"]["inertia"] = masses[:, :3].mean(axis=1), masses[:, 3:].mean(axis=1)
        crafts["hull"]["masses"] = masses
        self._ahead.matrices[vehicles] = pairs
        self._ahead.thrusters[vehicles, : thrusters.shape[1]] = thrusters

    def _put_controls(
        self, vehicles: npt.NDArray[np.integer], crafts: npt.NDArray[np.void], vehicle: Vehicle, draws: Draws
    ) -> None:
        nominal, controls = self._nominal_controls[vehicles], crafts["controls"]
        thrust, reverse = control_factors(vehicle, draws, len(vehicles))
        controls["surge"], controls["yaw"] = thrust * nominal["surge"], thrust * nominal["yaw"]
        controls["reverse_fraction"] = reverse * nominal["reverse_fraction"]


def _put_dragged(crafts: npt.NDArray[np.void], parameters: DraggedBodyParameters, dt: float) -> None:
    dragged = crafts["dragged"]
    dragged["mass"], dragged["inertia"] = parameters.mass, parameters.inertia
    dragged["kept"] = 1.0 - np.asarray(parameters.linear_drag) * dt
    dragged["kept_turn"] = 1.0 - np.asarray(parameters.angular_drag) * dt
    dragged["centre"] = parameters.centre_of_mass
    mass, inertia = np.asarray(parameters.mass), np.asarray(parameters.inertia)
    crafts["hull"]["mass"], crafts["hull"]["inertia"] = mass, inertia.mean(axis=-1)
    crafts["hull"]["masses"] = np.concatenate([np.repeat(mass[:, None], 3, axis=1), inertia], axis=1)


def _whole(rows: npt.NDArray[np.void]) -> npt.NDArray[np.void]:
    """Return a structured array as one of bytes without fields, which NumPy copies 50 times as fast."""
    return rows.view(f"V{rows.dtype.itemsize}")
