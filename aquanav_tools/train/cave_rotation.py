"""When drawn caves take the place of others while a policy learns, and where: by decisions alone, never by the clock.

The caves of a batch are in places. After every `new_cave_every` decisions of all environments together, the next cave
of the sequence takes the next place in turn; each vehicle there goes into it when its episode ends. A place in which
vehicles are still in the cave before that is left to the next time.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import numpy as np

from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.train.cave_supply import CaveSupply
from aquanav_tools.train.settings import TrainSettings

NUMBERS, COUNTS = "rotation/numbers", "rotation/counts"
"""Names of arrays in `state`."""
FLOWN, WAITING, TAKING = "caves/flown", "caves/waiting_fraction", "caves/taking_fraction"
"""Names of `statistics`, in the learning curve."""


class CaveRotation:
    """Brings the caves of a supply into a batch, whose last places are for drawn caves."""

    def __init__(self, supply: CaveSupply, numbers: Sequence[int], settings: TrainSettings) -> None:
        """Prepare.

        Args:
            supply: Of caves.
            numbers: Of the drawn caves that the batch begins with.
            settings: Of the lesson.
        """
        self._supply, self._num_places = supply, len(numbers)
        self._interval = steps_between(settings)
        self._steps, self._next, self._turn = 0, max(numbers) + 1, 0
        self.numbers = np.array(numbers).repeat(2).reshape(-1, 2)
        """(P, 2) number of the cave in either half of each place."""
        self._began, self._taking = time.perf_counter(), 0.0

    def begin(self) -> None:
        """Have the next caves built; from now on the time counts."""
        self._supply.expect(self._next)
        self._began = time.perf_counter()

    def step(self, batch: CaveBatch) -> None:
        """Bring in the next cave where the batch has taken enough decisions for it."""
        self._steps += 1
        if self._steps % self._interval:
            return
        scenario = self._supply.take(self._next)
        began = time.perf_counter()
        place = len(batch.slices) - self._num_places + self._turn
        if batch.replace(place, scenario):
            half = int(batch.current_caves[place] != place)
            self.numbers[self._turn, half] = self._next
            self._next += 1
            self._turn = (self._turn + 1) % self._num_places
            self._supply.expect(self._next)
        self._taking += time.perf_counter() - began

    @property
    def statistics(self) -> dict[str, float]:
        """Caves so far, and the fractions of this process's time that went into waiting for them and taking them in."""
        passed = time.perf_counter() - self._began
        return {
            FLOWN: float(self.numbers.max() + 1),
            WAITING: round(self._supply.waited / passed, 6),
            TAKING: round(self._taking / passed, 6),
        }

    def state(self) -> dict[str, np.ndarray]:
        """Return which caves are where, and whose turn is next."""
        return {NUMBERS: self.numbers.copy(), COUNTS: np.array([self._steps, self._next, self._turn])}

    def restore(self, state: dict[str, np.ndarray], batch: CaveBatch) -> None:
        """Put the caves where `state` has them."""
        numbers, first = state[NUMBERS], len(batch.slices) - self._num_places
        changed = [tuple(row) for row in np.argwhere(numbers != self.numbers).tolist()]
        scenarios = self._supply.at_once([int(numbers[row]) for row in changed])
        for (turn, half), scenario in zip(changed, scenarios, strict=True):
            batch.put(first + turn + half * len(batch.slices), scenario)
        self.numbers[:] = numbers
        self._steps, self._next, self._turn = state[COUNTS].tolist()


def current_numbers(state: dict[str, Any], places: np.ndarray) -> list[int]:
    """Return the numbers of the drawn caves of now in a batch's state, by its own array of the caves of now."""
    numbers = np.asarray(state[NUMBERS])
    first = len(places) - len(numbers)
    halves = (np.asarray(places)[first:] != np.arange(first, len(places))).astype(int)
    return [int(number) for number in numbers[np.arange(len(numbers)), halves]]


def steps_between(settings: TrainSettings) -> int:
    """Return the decisions of each environment between two new caves."""
    return max(1, round(settings.new_cave_every / settings.num_envs))
