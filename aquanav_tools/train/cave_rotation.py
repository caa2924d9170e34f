"""When drawn caves take the place of others while a policy learns, and where: by what was learned, never by the clock.

The caves of a batch are in places. After every `new_cave_every` decisions of all environments together, the next cave
of the sequence takes a place: the next in turn, or that of the cave which is dived best by now, so that hard caves stay
longer and more of the time goes into them. Each vehicle there goes into the new cave when its episode ends. A place in
which vehicles are still in the cave before cannot be taken. That caves are chosen by how well they are dived is
prioritised level replay (Jiang, Grefenstette and Rocktaeschel 2021) with the fraction of clean dives as the score.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.train.cave_supply import CaveSupply
from aquanav_tools.train.episodes import EpisodeSummary
from aquanav_tools.train.settings import TrainSettings

NUMBERS, COUNTS, ENDED = "rotation/numbers", "rotation/counts", "rotation/ended"
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
        self._interval, self._leaves = steps_between(settings), settings.cave_that_leaves
        self._steps, self._next, self._turn = 0, max(numbers) + 1, 0
        self.numbers = np.array(numbers).repeat(2).reshape(-1, 2)
        """(P, 2) number of the cave in either half of each place."""
        self._ended = np.zeros((len(numbers), 2), dtype=np.int64)
        """(P, 2) episodes that ended in the cave of now in each place, and how many of them were clean."""
        self._caves_before: np.ndarray | None = None
        self._began, self._taking = time.perf_counter(), 0.0

    def begin(self) -> None:
        """Have the next caves built; from now on the time counts."""
        self._supply.expect(self._next)
        self._began = time.perf_counter()

    def step(self, batch: CaveBatch, ended: Mapping[int, EpisodeSummary]) -> None:
        """Bring in the next cave where the batch has taken enough decisions for it.

        Args:
            batch: After a decision; vehicles whose episodes ended are in the cave of their next.
            ended: By vehicle, the episodes that the decision ended.
        """
        self._count(batch, ended)
        self._steps += 1
        if self._steps % self._interval:
            return
        scenario = self._supply.take(self._next)
        began = time.perf_counter()
        for turn in self._candidates():
            place = self._first(batch) + turn
            if batch.replace(place, scenario):
                half = int(batch.current_caves[place] != place)
                self.numbers[turn, half] = self._next
                self._ended[turn] = 0
                self._next += 1
                self._turn = (turn + 1) % self._num_places
                self._supply.expect(self._next)
                break
        self._taking += time.perf_counter() - began

    def _first(self, batch: CaveBatch) -> int:
        """Return the first place of a batch that is for drawn caves."""
        return len(batch.slices) - self._num_places

    def _candidates(self) -> list[int]:
        """Return the places that the next cave may take, the best first."""
        if self._leaves == "oldest":
            return [self._turn]
        episodes, clean = self._ended.T
        # Few clean dives tell little, so count two more that were not; a cave of which nothing is known does not leave.
        known_best = -clean / (episodes + 2.0)
        oldest = self.numbers.max(axis=1)  # of the cave of now
        order: list[int] = np.lexsort((oldest, known_best)).tolist()
        return order

    def _count(self, batch: CaveBatch, ended: Mapping[int, EpisodeSummary]) -> None:
        """Count episodes that ended in the caves of now; not those that were cut short, nor those in caves before."""
        if self._caves_before is not None:
            for vehicle, episode in ended.items():
                place = int(batch.slots[vehicle])
                turn = place - self._first(batch)
                if turn < 0 or episode.is_cut_short or self._caves_before[vehicle] != batch.current_caves[place]:
                    continue
                self._ended[turn] += 1, episode.is_success and not episode.num_collisions
        self._caves_before = batch.cave_of.copy()

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
        """Return which caves are where, how they were dived, and whose turn is next."""
        counts = np.array([self._steps, self._next, self._turn])
        return {NUMBERS: self.numbers.copy(), COUNTS: counts, ENDED: self._ended.copy()}

    def restore(self, state: dict[str, np.ndarray], batch: CaveBatch) -> None:
        """Put the caves where `state` has them."""
        numbers, first = state[NUMBERS], self._first(batch)
        changed = [tuple(row) for row in np.argwhere(numbers != self.numbers).tolist()]
        scenarios = self._supply.at_once([int(numbers[row]) for row in changed])
        for (turn, half), scenario in zip(changed, scenarios, strict=True):
            batch.put(first + turn + half * len(batch.slices), scenario)
        self.numbers[:] = numbers
        self._steps, self._next, self._turn = state[COUNTS].tolist()
        self._ended[:] = state.get(ENDED, 0)  # runs of earlier versions did not count them
        self._caves_before = np.array(state["cave_of"])


def current_numbers(state: dict[str, Any], places: np.ndarray) -> list[int]:
    """Return the numbers of the drawn caves of now in a batch's state, by its own array of the caves of now."""
    numbers = np.asarray(state[NUMBERS])
    first = len(places) - len(numbers)
    halves = (np.asarray(places)[first:] != np.arange(first, len(places))).astype(int)
    return [int(number) for number in numbers[np.arange(len(numbers)), halves]]


def steps_between(settings: TrainSettings) -> int:
    """Return the decisions of each environment between two new caves."""
    return max(1, round(settings.new_cave_every / settings.num_envs))
