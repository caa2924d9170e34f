"""Telling two policies apart pair by pair, with an error that holds whenever one stops.

Of each pair of episodes counts the difference x: 1 where only the first policy succeeded, -1 where only the second did,
else 0. Somebody who does not believe that the mean difference is m bets a predictable share of what he owns on it:
his wealth is the product of 1 + bet * (x - m). Is the mean m, no betting makes the expected wealth grow, and it ever
reaches 1/a with a probability of a at most (Ville, Etude critique de la notion de collectif, 1939). Wealth against
equal policies and wealth against a difference of a given size make Wald's sequential test (Annals of Mathematical
Statistics 16, 1945, 117) without knowing how often pairs differ, and the means that are not bet away so far are an
interval that holds at all times together (Waudby-Smith and Ramdas, Journal of the Royal Statistical Society B 86,
2024, 1).

Where all pairs that there are can be listed, they are drawn without putting back: the mean of those that are left
stands for m then, as in section 5 there. That is exact for the list, however alike the episodes of a cave are.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from aquanav_tools.evaluate.paired import episodes_for
from aquanav_tools.evaluate.statistics import Estimate
from aquanav_tools.types import Array, BoolArray

PRIOR_PAIRS, PRIOR_DIFFERING = 10.0, 1.0
"""Pairs, and those of them that differ, that the first bets go by. Chosen: wrong ones cost pairs, never the error."""
MOST = 0.9
"""Largest part of the wealth that a pair may lose. Chosen, so that no pair ruins."""
LEVEL, MISSED = 0.05, 0.01
"""Bounds of the two errors: to call one of two equal policies better, and to call policies alike of which one is better
by the smallest difference or more. With them a pair five points apart takes half of the episodes of a test of fixed
size and of the same power (docs/evaluate.md)."""
Z_MISSED = 2.3263478740408408
"""Normal quantile of 1 - MISSED."""
MEANS = np.linspace(-1.0, 1.0, 801)
"""Differences that the interval tries: steps of a quarter of a point."""
ROUNDING = 1e-9
Verdict = Literal["first", "second", "alike", "open"]


@dataclass(frozen=True)
class Sequential:
    """What the pairs so far say."""

    verdict: Verdict
    """Which is better; alike, where neither is better by the smallest difference; open, where it cannot be said yet."""
    num_pairs: int
    only_first: int
    only_second: int
    e_value: float
    """Largest wealth so far against equal policies: evidence against them."""
    p_value: float
    """Its inverse, 1 at most: holds at any time."""
    smallest: float
    """Difference of rates that matters."""
    difference: Estimate
    """Rate of the first less that of the second with the interval that holds at all times together."""
    max_pairs: int | None = None
    """Pairs that would have been flown at most."""

    @property
    def fixed_pairs(self) -> int | None:
        """Pairs that McNemar's test on a number fixed beforehand needs to show the smallest difference as surely.

        With pairs that differ as often as seen; None where none differed.
        """
        differing = (self.only_first + self.only_second) / max(self.num_pairs, 1)
        return episodes_for(max(differing, self.smallest), self.smallest, Z_MISSED) if differing else None


def log_wealth(differences: Array, mean: float, direction: int, smallest: float, population: int | None) -> Array:
    """Return the logarithm of the wealth after each pair of one who bets that the mean is above or below `mean`.

    Args:
        differences: (..., N) of each pair: 1, 0 or -1.
        mean: What is bet against.
        direction: 1 bets that the mean is above it, -1 below.
        smallest: Distance of the mean that the bets are best for, in (0, 1).
        population: Pairs that there are where they are drawn without putting back; None for no end of them.

    Returns:
        (..., N); infinite where `mean` has become impossible.
    """
    number = np.arange(differences.shape[-1])
    total = np.cumsum(differences, axis=-1) - differences
    differing = np.cumsum(differences**2, axis=-1) - differences**2
    spread = (differing + PRIOR_DIFFERING) / (number + PRIOR_PAIRS)
    left = np.full_like(spread, mean) if population is None else (population * mean - total) / (population - number)
    seen = direction * (total / (number + PRIOR_PAIRS) - mean) - np.sqrt(spread / (number + PRIOR_PAIRS))
    bet = np.minimum(np.maximum(seen, smallest) / spread, MOST / np.maximum(1.0 + direction * left, ROUNDING))
    gain = np.log(np.maximum(1.0 + direction * bet * (differences - left), ROUNDING))
    return np.cumsum(np.where(np.abs(left) > 1.0 + ROUNDING, np.inf, gain), axis=-1)


def evidence(differences: Array, mean: float, smallest: float, population: int | None = None) -> Array:
    """Return the (..., N) e-values against a mean difference, for bets on both sides with half of the wealth each."""
    sides = [log_wealth(differences, mean, direction, smallest, population) for direction in (1, -1)]
    return np.exp(np.minimum(np.logaddexp(*sides), 700.0)) / 2.0


def is_smaller(differences: Array, smallest: float, population: int | None = None) -> BoolArray:
    """Return (..., N) whether a difference of `smallest` or more, either way, is ruled out by then."""
    above = log_wealth(differences, -smallest, 1, smallest, population)
    below = log_wealth(differences, smallest, -1, smallest, population)
    reached = [np.maximum.accumulate(side, axis=-1) >= -np.log(MISSED) for side in (above, below)]
    found: BoolArray = reached[0] & reached[1]
    return found


def verdict_of(differences: Array, smallest: float, population: int | None = None) -> Verdict:
    """Return the verdict of (N,) pairs in the order in which they were drawn; the first that came stays."""
    apart = evidence(differences, 0.0, smallest, population) >= 1.0 / LEVEL
    alike = is_smaller(differences, smallest, population)
    is_over = apart | alike
    place = int(np.argmax(is_over)) if is_over.any() else len(differences) - 1
    if alike[place] and not apart[place]:
        return "alike"
    if not is_over.any() and len(differences) != population:
        return "open"
    mean = differences[: place + 1].mean()
    if not is_over.any() and abs(mean) < smallest:  # all that there are: nothing is left to chance
        return "alike"
    return "first" if mean > 0.0 else "second"


def judge(differences: Array, smallest: float, population: int | None = None) -> Sequential:
    """Return what (N,) pairs in the order in which they were drawn say.

    Args:
        differences: 1 where only the first succeeded, -1 where only the second did, else 0; one or more.
        smallest: Difference of rates that matters, in (0, 1).
        population: Pairs that there are; None for no end of them.
    """
    e_value = max(1.0, float(evidence(differences, 0.0, smallest, population).max()))
    return Sequential(
        verdict=verdict_of(differences, smallest, population),
        num_pairs=len(differences),
        only_first=int((differences > 0).sum()),
        only_second=int((differences < 0).sum()),
        e_value=e_value,
        p_value=1.0 / e_value,
        smallest=smallest,
        difference=_interval(differences, smallest, population),
    )


def _interval(differences: Array, smallest: float, population: int | None) -> Estimate:
    """Return the mean with the interval of the means that no wealth so far ruled out, one step of the grid wider."""
    seen = float(differences.mean())
    if len(differences) == population:
        return Estimate(seen, seen, seen)
    kept = [mean for mean in MEANS if (evidence(differences, mean, smallest, population) < 1.0 / LEVEL).all()]
    step = MEANS[1] - MEANS[0]
    low, high = max(-1.0, min(kept, default=seen) - step), min(1.0, max(kept, default=seen) + step)
    return Estimate(seen, float(low), float(high))
