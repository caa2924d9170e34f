"""Episodes that begin shortly before places where others have touched the wall.

In a cave with one squeeze most decisions are taken where nothing is hard. So a fraction of the episodes begins at the
start before a place where an episode in that cave ended in a contact lately; the others begin at any start.

Source: Tavakoli, Levdik, Islam, Smith and Kormushev, Prioritizing Starting States for Reinforcement Learning (2018,
arXiv:1811.11298).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.sim.batch.episode import COLLISION
from aquanav_tools.sim.batch.random import HARD_START, draw_many
from aquanav_tools.types import Array

KEPT = 16
"""Places of a cave that are remembered: those of the latest contacts."""
APART = 0.8
"""The start lies at least so much of the way before the contact, m: about twice a BlueROV2's length."""
STARTS, COUNTS = "hard/starts", "hard/counts"
"""Names of arrays in `state`."""


class _Ways(NamedTuple):
    """The starts of a cave."""

    positions: Array
    """(S, 3) m."""
    remaining: Array
    """(S,) to go along the guide, m."""


class HardPlaces:
    """Remembers where a batch's episodes ended in contacts, and begins others before these places."""

    def __init__(self, batch: CaveBatch, fraction: float) -> None:
        """Prepare; from now on the batch's episodes begin by this.

        Args:
            batch: Of the lesson.
            fraction: Of the episodes in a cave with such a place.
        """
        self._batch, self._fraction = batch, fraction
        self._known: list[_Ways | None] = [None] * len(batch.scenarios)
        self._starts = np.zeros((len(batch.scenarios), KEPT), dtype=np.int64)
        """(C, KEPT) starts before the latest contacts in each cave, in a ring."""
        self._counts = np.zeros(len(batch.scenarios), dtype=np.int64)
        """(C,) contacts in each cave so far."""
        batch.choose_starts = self._choose

    def forget(self, cave: int) -> None:
        """Forget the places of a cave: another has taken its place."""
        self._counts[cave], self._known[cave] = 0, None

    def state(self) -> dict[str, npt.NDArray[np.int64]]:
        """Return what is remembered."""
        return {STARTS: self._starts.copy(), COUNTS: self._counts.copy()}

    def restore(self, state: dict[str, npt.NDArray[np.int64]]) -> None:
        """Remember what `state` returned, in the caves of then."""
        self._starts[:], self._counts[:] = state[STARTS], state[COUNTS]
        self._known = [None] * len(self._known)

    def _choose(self, ended: npt.NDArray[np.int64]) -> None:
        """Remember where these vehicles' episodes ended; choose where some of their next ones begin."""
        batch = self._batch
        touched = ended[batch.view_of("outcomes")[ended] == COLLISION]
        for vehicle, cave in zip(touched.tolist(), batch.cave_of[touched].tolist(), strict=True):
            self._remember(vehicle, cave)
        seeds = batch.view_of("seeds").view(np.uint32)[ended]
        chances, picks = draw_many(seeds, HARD_START) / 2.0**32, draw_many(seeds, HARD_START, 1)
        caves = batch.current_caves[batch.slots[ended]]
        kept = np.minimum(self._counts[caves], KEPT)
        chosen = np.flatnonzero((chances < self._fraction) & (kept > 0))
        wanted = np.array(batch.view_of("wanted_starts"))
        wanted[ended[chosen]] = self._starts[caves[chosen], picks[chosen] % kept[chosen]]
        batch.world.write("wanted_starts", wanted)

    def _remember(self, vehicle: int, cave: int) -> None:
        """Keep the nearest start before the place where a vehicle is; nothing where there is none."""
        ways = self._known[cave] = self._known[cave] or self._ways(cave)
        is_before = ways.remaining > self._batch.view_of("remaining")[vehicle] + APART
        if is_before.any():
            away = np.linalg.norm(ways.positions - self._batch.view_of("positions")[vehicle], axis=1)
            self._starts[cave, self._counts[cave] % KEPT] = np.argmin(np.where(is_before, away, np.inf))
            self._counts[cave] += 1

    def _ways(self, cave: int) -> _Ways:
        starts = self._batch.scenarios[cave].starts
        return _Ways(np.array([start.pose.position for start in starts]), self._batch.remaining_at_starts(cave))
