"""The sensor `waypoint` on a vehicle: a map of what its sonar meets, and the place ahead on the way by it."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import InputError
from aquanav_tools.sim import occupancy, way


class Waypoint:
    """Maps a dive. The simulated sensor (`sim.batch.sensors.waypoint`) reads the same from the same echoes."""

    def __init__(self) -> None:
        """Make room; memory is taken as the map grows."""
        self._maps, self._search = occupancy.make_maps(1), way.make_search()
        self._goal: npt.NDArray[np.float64] | None = None

    def reset(self, position: npt.ArrayLike, goal: npt.ArrayLike, heading: float) -> None:
        """Begin a dive.

        Args:
            position: (3,) where it begins, by dead reckoning in a level frame with z up, m.
            goal: (3,) in the same frame, m.
            heading: Of the bow in it, from x towards y, rad: ways do not lead back past where the dive begins.

        Raises:
            InputError: a value is not finite.
        """
        _check_heading(heading)
        self._goal = _finite(goal, (3,), "The goal")
        occupancy.begin(self._maps, 0, _finite(position, (3,), "The place"), self._goal, float(heading))

    def see(self, position: npt.ArrayLike, rays: npt.ArrayLike, ranges: npt.ArrayLike, reaches: npt.ArrayLike) -> None:
        """Note what the sonar has met: twice a second in training.

        Args:
            position: (3,) where the rays begin, m.
            rays: (R, 3) unit vectors in the same frame.
            ranges: (R,) m; the reach where there was no echo.
            reaches: (R,) of the rays, m.

        Raises:
            InputError: a value is not finite, or there are not as many of one as of the others.
        """
        measured = np.asarray(ranges, dtype=np.float64)
        count = (len(np.atleast_1d(measured)),)
        occupancy.see(
            self._maps,
            0,
            self._at(position),
            _finite(rays, (*count, 3), "The rays"),
            _finite(measured, count, "The ranges"),
            _finite(reaches, count, "The reaches"),
        )

    def plan(self, position: npt.ArrayLike) -> None:
        """Find the way anew by what is known where the last one does not hold: asked once a second in training.

        Raises:
            InputError: a value is not finite, or no dive has begun.
        """
        way.plan(self._maps, self._search, 0, self._at(position), self._begun())

    def __call__(self, position: npt.ArrayLike, heading: float) -> npt.NDArray[np.float64]:
        """Return the reading, (4,), as the sensor's space has it.

        Args:
            position: (3,) m.
            heading: Of the bow in the frame, from x towards y, rad.

        Raises:
            InputError: a value is not finite.
        """
        _check_heading(heading)
        place = self._at(position)
        shown: npt.NDArray[np.float64] = way.reading(self._maps, 0, place, float(heading), self._begun())
        return shown

    def _at(self, position: npt.ArrayLike) -> npt.NDArray[np.float64]:
        place = _finite(position, (3,), "The place")
        occupancy.be_at(self._maps, 0, place)
        return place

    def _begun(self) -> npt.NDArray[np.float64]:
        if self._goal is None:
            raise InputError("No dive has begun, so there is no goal to find a way to. Call reset first.")
        return self._goal


def _check_heading(heading: float) -> None:
    if not math.isfinite(heading):
        raise InputError(f"The heading must be a finite angle, and it is {heading}.")


def _finite(values: npt.ArrayLike, shape: tuple[int, ...], what: str) -> npt.NDArray[np.float64]:
    array = np.ascontiguousarray(values, dtype=np.float64)
    if array.shape != shape or not np.isfinite(array).all():
        raise InputError(f"{what} must be finite numbers of shape {shape}, and they have {array.shape}: {array}.")
    return array
