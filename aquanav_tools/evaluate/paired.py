"""Two policies that met the same episodes: is one better than the other?"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from aquanav_tools.evaluate.statistics import Estimate, bootstrap_means, wilson
from aquanav_tools.types import Array, BoolArray


@dataclass(frozen=True)
class PairedRates:
    """How often two policies succeeded in the same episodes."""

    both: int
    only_first: int
    only_second: int
    neither: int
    difference: Estimate
    """Rate of the first less that of the second, with its 95 % interval."""
    p_value: float
    """Of McNemar's exact test: the chance of so uneven a split of the episodes in which just one succeeded, or a more
    uneven one, were both policies equally good."""


def compare_rates(first: BoolArray, second: BoolArray) -> PairedRates:
    """Return the comparison of two policies' (N,) successes in the same episodes.

    Sources: McNemar, Psychometrika 12 (1947), in its exact form; the interval is method 10 of Newcombe, Statistics in
    Medicine 17 (1998) 2635, which is right also where hardly an episode differs.
    """
    from scipy.stats import binom

    both, neither = int((first & second).sum()), int((~first & ~second).sum())
    only_first, only_second = int((first & ~second).sum()), int((second & ~first).sum())
    differing = only_first + only_second
    p_value = min(1.0, 2.0 * float(binom.cdf(min(only_first, only_second), differing, 0.5)))
    difference = _newcombe(both, only_first, only_second, neither)
    return PairedRates(both, only_first, only_second, neither, difference, p_value)


def compare_means(first: Array, second: Array) -> Estimate:
    """Return the mean of first less second, (N,) values of the same episodes each, with its bootstrap interval."""
    return bootstrap_means((first - second)[:, None])[0]


def probability_of_improvement(first: Array, second: Array) -> float:
    """Return the probability that a score drawn from `first` is above one drawn from `second`; ties count half.

    That is the Mann-Whitney statistic over the number of pairs, as in rliable.
    """
    above = (first[:, None] > second).mean() + 0.5 * (first[:, None] == second).mean()
    return float(above)


def share_won(first: Array, second: Array) -> Estimate:
    """Return the share of the same episodes that the first scored higher in, ties half, with a bootstrap interval."""
    return bootstrap_means((0.5 + 0.5 * np.sign(first - second))[:, None])[0]


def _newcombe(both: int, only_first: int, only_second: int, neither: int) -> Estimate:
    count = both + only_first + only_second + neither
    one, two = wilson(both + only_first, count), wilson(both + only_second, count)
    correlation = _correlation(both, only_first, only_second, neither)

    def reach(first: float, second: float) -> float:
        return sqrt(max(first**2 - 2.0 * correlation * first * second + second**2, 0.0))

    difference = (only_first - only_second) / count
    low = difference - reach(one.rate - one.low, two.high - two.rate)
    high = difference + reach(one.high - one.rate, two.rate - two.low)
    return Estimate(difference, max(low, -1.0), min(high, 1.0))


def _correlation(both: int, only_first: int, only_second: int, neither: int) -> float:
    """Return the phi coefficient with Newcombe's correction for continuity; 0 where one always or never succeeded."""
    margins = (both + only_first) * (only_second + neither) * (both + only_second) * (only_first + neither)
    if margins == 0:
        return 0.0
    product = both * neither - only_first * only_second
    count = both + only_first + only_second + neither
    corrected = max(product - 0.5 * count, 0.0) if product > 0 else product
    return float(corrected / sqrt(margins))
