"""Two policies that met the same episodes: is one better than the other?"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from math import ceil, comb, sqrt

import numpy as np

from aquanav_tools.evaluate.statistics import (
    BOOTSTRAP_SEED,
    Z_95,
    Z_POWER,
    Estimate,
    bootstrap_means,
    resampled_means,
    wilson,
)
from aquanav_tools.types import Array, BoolArray

MAX_DEALS = 20_000
"""Ways to deal out runs that are looked at; all of them for up to 8 runs of each method."""
ROUNDING = 1e-12
"""By which equal differences of means may differ."""


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


def episodes_to_tell(rates: PairedRates) -> int | None:
    """Return how many episodes McNemar's test needs to tell the policies apart with a probability of 80 %.

    It is for a difference as large as the one seen, at a level of 5 %; None where none was seen.

    Source: Connor, Biometrics 43 (1987) 207, formula for paired samples.
    """
    count = rates.both + rates.only_first + rates.only_second + rates.neither
    differing, difference = (rates.only_first + rates.only_second) / count, rates.difference.mean
    if rates.only_first == rates.only_second:
        return None
    return episodes_for(differing, difference, Z_POWER)


def episodes_for(differing: float, difference: float, z_power: float) -> int:
    """Return how many episodes McNemar's test at a level of 5 % needs, by the formula of `episodes_to_tell`.

    Args:
        differing: Share of the episodes in which just one of the two succeeds.
        difference: Of the rates; not 0, and not above `differing`.
        z_power: Normal quantile of the wanted probability to tell them apart.
    """
    root = Z_95 * sqrt(differing) + z_power * sqrt(differing - difference**2)
    return ceil((root / difference) ** 2)


@dataclass(frozen=True)
class RunRates:
    """How the training runs of two methods scored, each run by its mean over tasks."""

    first: int
    """Runs of the first."""
    second: int
    difference: Estimate
    """Mean score of the first's runs less that of the second's, with its 95 % bootstrap interval."""
    p_value: float
    """Of the exact permutation test: the fraction of all divisions of the runs between the two methods in which their
    means differ at least as much."""


def compare_runs(first: Array, second: Array) -> RunRates:
    """Return the comparison of (R,) mean scores of training runs with (S,) of another method's, two or more of each."""
    low, high = np.percentile(resampled_means(first) - resampled_means(second, seed=BOOTSTRAP_SEED + 1), [2.5, 97.5])
    difference = Estimate(float(first.mean() - second.mean()), float(low), float(high))
    return RunRates(len(first), len(second), difference, _permutation_p(first, second))


def _permutation_p(first: Array, second: Array) -> float:
    """Return the fraction of ways to deal out scores whose means differ by as much as those of `first` and `second`."""
    scores, size = np.concatenate([first, second]), len(first)
    if comb(len(scores), size) <= MAX_DEALS:
        deals = np.array(list(combinations(range(len(scores)), size)))
    else:
        rng = np.random.default_rng(BOOTSTRAP_SEED)
        deals = np.array([np.arange(size), *(rng.permutation(len(scores))[:size] for _ in range(MAX_DEALS))])
    sums = scores[deals].sum(axis=1)
    gaps = np.abs(sums / size - (scores.sum() - sums) / len(second))
    return float((gaps >= abs(first.mean() - second.mean()) - ROUNDING).mean())


def compare_means(first: Array, second: Array) -> Estimate:
    """Return the mean of first less second, (N,) values of the same episodes each, with its bootstrap interval."""
    return bootstrap_means((first - second)[:, None])[0]


def probability_of_improvement(first: Array, second: Array) -> float:
    """Return the probability that a score drawn from `first` is above one drawn from `second`; ties count half.

    That is the Mann-Whitney statistic over the number of pairs, as in rliable.
    """
    above = (first[:, None] > second).mean() + 0.5 * (first[:, None] == second).mean()
    return float(above)


def fraction_won(first: Array, second: Array) -> Estimate:
    """Return the fraction of the same episodes that the first scored higher in, ties half, with its interval."""
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
