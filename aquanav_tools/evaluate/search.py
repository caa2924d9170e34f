"""Searching the cases in which a policy fails: CMA-ES over start, current, noise and seed, restarted where it is done.

Source: Hansen and Ostermeier, Completely derandomized self-adaptation in evolution strategies, Evolutionary Computation
9 (2001), as the library cmaes has it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.options import Case, StressOptions
from aquanav_tools.libraries import require
from aquanav_tools.types import Array

NUM_AXES = 4
"""Start, current, noise, seed; each from 0 to 1."""
STEP = 0.25
"""First standard deviation: a quarter of each range, so that one generation spans it."""
GENERATION = 8
"""Cases; what the library chooses for four axes."""
DONE_AFTER = 2
"""A search begins anew after so many generations without a success: what it found is known, others may be elsewhere."""
NUM_OFFERS = 64
"""Places drawn for a new beginning, of which the farthest from all earlier ones is taken."""
DIGITS = 4
"""Decimals of noise and current in a case: what the protocol's file says is what was run."""


@dataclass(frozen=True, eq=False)
class CaseSpace:
    """What cases are made of."""

    options: StressOptions
    starts: tuple[int, ...]
    """From the farthest from the goal to the nearest, so that neighbours are near each other in the cave."""

    def case(self, point: Array) -> Case:
        """Return the case at a point of the unit cube."""
        start, current, noise, seed = np.clip(point, 0.0, 1.0)
        options = self.options
        return Case(
            start=self.starts[min(int(start * len(self.starts)), len(self.starts) - 1)],
            seed=options.seed + min(int(seed * options.seeds), options.seeds - 1),
            sensor_noise=round(float(noise) * options.max_noise, DIGITS),
            current=round(float(current) * options.max_current, DIGITS),
        )


def danger(metrics: EpisodeMetrics, route_length: float) -> float:
    """Return how badly an episode went: at most 0 for a success without contact, 1 to 3 for a failure.

    A success is the worse the nearer it came to a wall, a failure the more often it touched and the less way it made.
    """
    if metrics.is_collision_free_success:
        return -min(max(metrics.min_clearance, 0.0), 1.0)
    missed = 1.0 - min(max(metrics.progress / route_length, 0.0), 1.0)
    return 1.0 + (0.0 if metrics.is_success else missed) + 1.0 - 0.5 ** min(metrics.collisions, 50)


class Search:
    """Proposes points of the unit cube, a generation at a time, and learns from how dangerous they are."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 1])
        self._begun: list[Array] = []
        self._num_without_success = 0
        self._optimiser = self._begin()

    def ask(self) -> list[Array]:
        """Return the points of the next generation."""
        if self._optimiser.should_stop() or self._num_without_success >= DONE_AFTER:
            self._optimiser, self._num_without_success = self._begin(), 0
        return [self._optimiser.ask() for _ in range(GENERATION)]

    def tell(self, points: list[Array], dangers: list[float]) -> None:
        """Take in how dangerous the points of the last generation were."""
        self._optimiser.tell([(point, -value) for point, value in zip(points, dangers, strict=True)])
        self._num_without_success = self._num_without_success + 1 if min(dangers) > 0.0 else 0

    def _begin(self) -> Any:
        cmaes = load_cmaes()
        offers = self._rng.random((NUM_OFFERS, NUM_AXES))
        gaps = [min((float(np.abs(offer - old).max()) for old in self._begun), default=0.0) for offer in offers]
        mean = offers[int(np.argmax(gaps))]
        self._begun.append(mean)
        bounds = np.tile([0.0, 1.0], (NUM_AXES, 1))
        seed = int(self._rng.integers(1 << 31))
        return cmaes.CMA(mean, STEP, bounds, seed=seed, population_size=GENERATION)


def random_points(seed: int, count: int) -> Array:
    """Return (count, NUM_AXES) points drawn evenly from the unit cube."""
    return np.random.default_rng([seed, 0]).random((count, NUM_AXES))


def load_cmaes() -> Any:
    """Return the library.

    Raises:
        LibraryError: it is not installed.
    """
    require("A search for failures", "cmaes")
    import cmaes

    return cmaes
