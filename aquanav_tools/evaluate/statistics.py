"""Intervals, bounds and tests for what episodes and training runs came to.

Episodes: a rate has a Wilson interval, a failure probability an exact upper bound, any other mean a bootstrap interval.
Training runs: interquartile means with a bootstrap stratified by task, as in Agarwal et al., Deep reinforcement
learning at the edge of the statistical precipice, NeurIPS 2021 (rliable).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, sqrt

import numpy as np

from aquanav_tools.types import Array

Z_95 = 1.959963984540054
"""97.5 % point of the standard normal distribution."""
Z_POWER = 0.8416212335729143
"""80 % point of it."""
RESAMPLES = 2000
"""Of a bootstrap: moves a bound by about 1 % of the interval's width."""
BOOTSTRAP_SEED = 20210
CHUNK = 2_000_000
"""Numbers drawn at a time, so that memory does not grow with episodes times resamples."""


@dataclass(frozen=True)
class Proportion:
    """A fraction of episodes with its 95 % Wilson interval."""

    rate: float
    low: float
    high: float


UNKNOWN = Proportion(0.0, 0.0, 1.0)
"""The fraction of no episodes at all."""


@dataclass(frozen=True)
class Estimate:
    """A mean with its 95 % interval."""

    mean: float
    low: float
    high: float


def wilson(num_hits: int, num_trials: int) -> Proportion:
    """Return the fraction of hits with its 95 % Wilson score interval.

    Unlike rate +- 1.96 standard errors it stays in [0, 1] and does not shrink to nothing at 0 % and 100 %.

    Raises:
        ValueError: no trials, or hits outside 0 .. trials.

    Source: Wilson, Probable inference, the law of succession, and statistical inference, JASA 22 (1927).
    """
    _check_counts(num_hits, num_trials)
    rate = num_hits / num_trials
    scale = 1.0 + Z_95**2 / num_trials
    centre = (rate + Z_95**2 / (2 * num_trials)) / scale
    half = _wilson_half_width(rate, num_trials)
    # At 0 and at all hits a bound is exactly 0 or 1; rounding must not move it across the rate.
    return Proportion(rate, min(max(centre - half, 0.0), rate), max(min(centre + half, 1.0), rate))


def failure_bound(num_failures: int, num_trials: int) -> float:
    """Return the probability of failure that is not exceeded with 95 % confidence, from independent trials.

    Exact and one-sided (Clopper and Pearson, Biometrika 26, 1934); without a failure it is about 3 / trials.

    Raises:
        ValueError: no trials, or failures outside 0 .. trials.
    """
    from scipy.special import betaincinv

    _check_counts(num_failures, num_trials)
    if num_failures == num_trials:
        return 1.0
    return float(betaincinv(num_failures + 1, num_trials - num_failures, 0.95))


def episodes_for(rate: float, half_width: float) -> int:
    """Return the smallest number of episodes whose 95 % Wilson interval at `rate` reaches at most so far each way.

    Raises:
        ValueError: the rate is outside [0, 1], or the half width outside (0, 0.5).
    """
    if not 0.0 <= rate <= 1.0 or not 0.0 < half_width < 0.5:
        raise ValueError(f"No number of episodes shows a rate of {rate} to within {half_width}.")
    low, high = 0, 1
    while _wilson_half_width(rate, high) > half_width:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if _wilson_half_width(rate, middle) > half_width else (low, middle)
    return high


def bootstrap_means(values: Array, resamples: int = RESAMPLES) -> list[Estimate]:
    """Return the mean of each column of (N, M) values with its 95 % percentile bootstrap interval over rows.

    The resamples are always the same, so that the interval repeats.
    """
    means = values.mean(axis=0)
    low, high = np.percentile(resampled_means(values, resamples), [2.5, 97.5], axis=0)
    return [Estimate(*map(float, triple)) for triple in zip(means, low, high, strict=True)]


def bootstrap_ratio(above: Array, below: Array, resamples: int = RESAMPLES) -> Estimate:
    """Return the sum of `above` over that of `below`, both (N,), with its 95 % bootstrap interval; 0 over 0 is 0."""
    means = np.vstack([[above.mean(), below.mean()], resampled_means(np.stack([above, below], axis=1), resamples)])
    ratios = np.divide(means[:, 0], means[:, 1], out=np.zeros(len(means)), where=means[:, 1] > 0.0)
    low, high = np.percentile(ratios[1:], [2.5, 97.5])
    return Estimate(float(ratios[0]), float(low), float(high))


def interquartile_mean(scores: Array) -> float:
    """Return the mean of the middle half of all scores: robust like the median, steadier."""
    return float(interquartile_means(scores.reshape(1, -1))[0])


def stratified_iqm(scores: Array, resamples: int = RESAMPLES) -> Estimate:
    """Return the interquartile mean of (runs, tasks) scores with its 95 % interval over training runs.

    Each resample draws runs anew for each task: a run's luck in one task says nothing about another.
    """
    runs, tasks = scores.shape
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    drawn = rng.integers(runs, size=(resamples, runs, tasks))
    values = interquartile_means(scores[drawn, np.arange(tasks)].reshape(resamples, -1))
    low, high = np.percentile(values, [2.5, 97.5])
    return Estimate(interquartile_mean(scores), float(low), float(high))


def interquartile_means(rows: Array) -> Array:
    """Return the (N,) interquartile means of (N, M) scores: of each row the mean of its middle half."""
    from scipy.stats import trim_mean

    means: Array = trim_mean(rows, 0.25, axis=1)
    return means


def resampled_means(values: Array, resamples: int = RESAMPLES, seed: int = BOOTSTRAP_SEED) -> Array:
    """Return the (resamples, ...) means of the rows of (N, ...) values drawn with replacement; the same for a seed."""
    rng = np.random.default_rng(seed)
    count = len(values)
    weights = np.full(count, 1.0 / count)
    chunks = np.array_split(np.arange(resamples), max(1, ceil(resamples * count / CHUNK)))
    return np.concatenate([rng.multinomial(count, weights, size=len(chunk)) @ values / count for chunk in chunks])


def _wilson_half_width(rate: float, num_trials: int) -> float:
    scale = 1.0 + Z_95**2 / num_trials
    return Z_95 / scale * sqrt(rate * (1.0 - rate) / num_trials + Z_95**2 / (4 * num_trials**2))


def _check_counts(num_hits: int, num_trials: int) -> None:
    if num_trials < 1 or not 0 <= num_hits <= num_trials:
        raise ValueError(f"Cannot take the fraction of {num_hits} hits in {num_trials} trials.")
