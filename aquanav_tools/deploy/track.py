"""The sensor `track` on a vehicle: where it was some distances of its way ago, from where it reckons that it is."""

from __future__ import annotations

import math
from collections import deque

import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import InputError

DISTANCES = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)
"""Back along the track, m, as the shipped sheet "a50" has them."""
SPACING = 0.25
"""Between remembered points of the track, m; farther apart where a decision moves farther."""


class Track:
    """Remembers the way of a dive. The simulated sensor (`sim.batch.sensors.track`) reads the same."""

    def __init__(self, distances: tuple[float, ...] = DISTANCES) -> None:
        """Begin without a past.

        Args:
            distances: Of the sheet that the policy learned with, m.
        """
        self._steps = [round(distance / SPACING) for distance in distances]
        self.reset()

    def reset(self) -> None:
        """Begin a dive: the next reading takes it that the vehicle came straight from astern."""
        self._points: deque[npt.NDArray[np.float64]] = deque(maxlen=max(self._steps) + 1)
        self._count, self._way = 0, 0.0
        self._last = self._begin = self._bow = np.zeros(3)

    def __call__(self, position: npt.ArrayLike, heading: float, nose_up: float = 0.0) -> npt.NDArray[np.float64]:
        """Return the reading, (3 * distances,): of each place how far ahead, to the left and up it lies, m.

        To be called once before every decision.

        Args:
            position: (3,) by dead reckoning, from a Doppler log and a gyroscope, in a level frame with z up, m.
            heading: Of the bow in that frame, from x towards y, rad.
            nose_up: Sine of the angle by which the nose points up, as in `Readings.tilt`; asked for at first.

        Raises:
            InputError: a value is not finite.
        """
        place = np.asarray(position, dtype=np.float64).reshape(-1)
        if len(place) != 3 or not np.isfinite([*place, heading, nose_up]).all():
            raise InputError(
                f"The track takes 3 finite coordinates and finite angles, got {place}, {heading}, {nose_up}."
            )
        ahead = np.array([math.cos(heading), math.sin(heading), 0.0])
        if not self._count:
            self._bow = np.append(math.sqrt(max(0.0, 1.0 - nose_up**2)) * ahead[:2], nose_up)
            self._remember(place)
            self._last, self._begin = place, place
        self._way += float(np.linalg.norm(place - self._last))
        self._last = place
        if self._way >= SPACING:
            self._way %= SPACING
            self._remember(place)
        left = np.array([-ahead[1], ahead[0], 0.0])
        back = np.stack([self._before(steps) for steps in self._steps]) - place
        return np.stack([back @ ahead, back @ left, back[:, 2]], axis=1).ravel()

    def _remember(self, place: npt.NDArray[np.float64]) -> None:
        self._points.append(place)
        self._count += 1

    def _before(self, steps: int) -> npt.NDArray[np.float64]:
        """Return the point so many points before the last; before the first, straight astern of it."""
        if steps < self._count:
            return self._points[-1 - steps]
        begun = (self._count - 1) * SPACING + self._way
        place: npt.NDArray[np.float64] = self._begin + min(begun - steps * SPACING, 0.0) * self._bow
        return place
