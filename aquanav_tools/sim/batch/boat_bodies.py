"""The bodies of N boats: one for all of them, or one for each that is drawn for every episode."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.sim.batch.boat_hull import HullSurface
from aquanav_tools.sim.batch.boat_motion import BoatBody, boat_parameters, make_boat_body, mobility_of
from aquanav_tools.sim.batch.drawn import DrawnDynamics
from aquanav_tools.sim.batch.motion import Body, body_values
from aquanav_tools.sim.batch.original import DRAGGED_DTYPE, dragged_rows
from aquanav_tools.sim.boat import DENSITY, Boat
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.randomisation import Randomisation, varied_boat
from aquanav_tools.types import Array


class BoatBodies:
    """The bodies of N boats on a device."""

    def __init__(
        self, boat: Boat | OriginalVehicle, num: int, dt: float, ranges: Randomisation | None, device: Any
    ) -> None:
        """Make bodies.

        Args:
            boat: As its file has it.
            num: Boats.
            dt: Physics step, s.
            ranges: From which each episode draws; None leaves all boats as the file has them.
            device: Warp's.

        Raises:
            InputError: a boat may sink, or its centre of mass leaves its hulls.
        """
        self._boat, self._dt = boat, dt
        self._nominal = make_boat_body(boat, DENSITY, dt, device)  # has the arrays to which the rows point
        one = wp.array([self._nominal], dtype=BoatBody, device=device)
        self.drawn: DrawnDynamics | None = None
        """What episodes have drawn; None without ranges."""
        self._boats: list[Boat | OriginalVehicle] = [boat] * num
        if ranges is None:
            self.array, self.body_of = one, np.zeros(num, dtype=np.int32)
            """The bodies on the device, and (N,) which of them each boat has."""
            return
        ranges.check(boat)
        self.drawn = DrawnDynamics(ranges, boat, num)
        self._rows = np.repeat(one.numpy(), num)
        self.array, self.body_of = wp.array(self._rows, dtype=BoatBody, device=device), np.arange(num, dtype=np.int32)

    @property
    def surface(self) -> HullSurface:
        """The hulls of all boats."""
        return self._nominal.surface

    def boat_of(self, i: int) -> Boat | OriginalVehicle:
        """Return boat `i` as it is in its episode."""
        return self._boats[i]

    def draw(self, rows: npt.NDArray[np.integer], seeds: npt.NDArray[np.integer]) -> None:
        """Give (n,) boats the bodies of the episodes with (n,) seeds; nothing without ranges."""
        if self.drawn is None or len(rows) == 0:
            return
        self.drawn.values[rows] = self.drawn.drawn_for(seeds, self._boat)
        names, arms = self.drawn.names, np.zeros((len(rows), 3))
        for n, i in enumerate(rows.tolist()):
            values = dict(zip(names, self.drawn.values[i].tolist(), strict=True))
            self._boats[i], arms[n] = varied_boat(self._boat, values)
        self._rows[rows] = self._varied(self._rows[rows], [self._boats[i] for i in rows.tolist()], arms)
        if self.array.device.is_cpu:
            self.array.numpy()[rows] = self._rows[rows]
        else:
            self.array.assign(self._rows)

    def _varied(
        self, rows: npt.NDArray[np.void], boats: Sequence[Boat | OriginalVehicle], arms: Array
    ) -> npt.NDArray[np.void]:
        """Return (n,) bodies with the numbers of as many boats."""
        rows["mobility"] = [mobility_of(boat) for boat in boats]
        floating = [boat for boat in boats if isinstance(boat, Boat)]
        if floating:
            values, _, _ = body_values(boat_parameters(floating, arms), self._dt)
            for name in Body.vars:  # type: ignore[attr-defined]  # Warp makes the class a struct
                if name not in ("matrix", "thrusters"):
                    rows["body"][name] = values[name]
            rows["mass"] = [boat.mass for boat in floating]
            rows["surface"]["drag"] = [(DENSITY, boat.normal_drag, boat.friction) for boat in floating]
            drives = [(boat.surge_force, boat.yaw_moment, boat.reverse_fraction) for boat in floating]
        else:
            drives = self._put_dragged(rows, [boat for boat in boats if isinstance(boat, OriginalVehicle)])
        for name, column in zip(("surge", "yaw", "reverse_fraction"), np.array(drives).T, strict=True):
            rows["controls"][name] = column
        return rows

    def _put_dragged(
        self, rows: npt.NDArray[np.void], boats: Sequence[OriginalVehicle]
    ) -> list[tuple[float, float, float]]:
        """Write the motion of the original's boats into rows, and return what their drives do."""
        for n, boat in enumerate(boats):
            made = dragged_rows(boat.motion_parameters(DENSITY), self._dt, self.array.device).rows[0]
            for name in DRAGGED_DTYPE.names or ():
                if name != "floaters":
                    rows["dragged"][name][n] = made[name]
        return [(boat.drive.force, boat.drive.steer_moment, boat.drive.reverse_fraction) for boat in boats]
