"""Which sea an episode has: the directions of wind and tide, the waves, and the first gusts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aquanav_tools.envs.choices import check_choice
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import PRESETS
from aquanav_tools.sim.sea_state import SeaState, sea_state
from aquanav_tools.sim.sea_water import SeaWater


class Seas:
    """Draws the sea of an episode."""

    def __init__(self, sea: str | SeaState, current: str | float | tuple[float, float, float] | None) -> None:
        """Prepare seas.

        Args:
            sea: A state by its name, whose wind blows in another direction in each episode; or a state as it is.
            current: The tide's, as `TaskOptions` has it: a speed, to another direction in each episode, or a velocity.

        Raises:
            InputError: there is no such state or current.
        """
        self._state, self._turns = (sea, False) if isinstance(sea, SeaState) else (sea_state(sea), True)
        self._tide = tide_of(current)

    @property
    def num_waves(self) -> int:
        """How many waves a sea is the sum of."""
        return self._state.num_waves if self._state.wind_speed > 0.0 else 0

    @property
    def is_still(self) -> bool:
        """Whether the water is flat and nothing flows or blows."""
        tide = self._state.current if self._tide is None else self._tide
        return self._state.wind_speed == 0.0 and not np.any(tide)

    def draw(self, rng: np.random.Generator, depth: float, fractions: tuple[float, float]) -> tuple[SeaWater, float]:
        """Return the sea of an episode over a bed of a depth (m), and the drawn fraction of its current."""
        wind, tide = rng.uniform(-180.0, 180.0), rng.uniform(-np.pi, np.pi)
        state = replace(self._state, direction_deg=wind) if self._turns else self._state
        if isinstance(self._tide, float):
            state = replace(state, current=(self._tide * np.cos(tide), self._tide * np.sin(tide)))
        elif self._tide is not None:
            state = replace(state, current=self._tide)
        water = SeaWater(state, depth, rng)
        low, high = fractions
        return water, low if low == high else float(rng.uniform(low, high))


def tide_of(current: str | float | tuple[float, float, float] | None) -> float | tuple[float, float] | None:
    """Return the tide that a task asks for: a speed (m/s), a velocity over x and y, or None for the sea's own.

    Raises:
        InputError: the current is no preset, is too fast for a sea, or flows up or down.
    """
    if current is None:
        return None
    if isinstance(current, str):
        check_choice("current", current, PRESETS)
        return PRESETS[current]
    if isinstance(current, int | float):
        return float(current)
    east, north, up = current
    if up != 0.0:
        raise InputError(f"The current {tuple(current)} flows up or down; on the surface its third number is 0.")
    return float(east), float(north)
