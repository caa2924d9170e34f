"""Intervals for shares of episodes."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

Z_95 = 1.959963984540054
"""97.5 % point of the standard normal distribution."""


@dataclass(frozen=True)
class Proportion:
    """A share of episodes with its 95 % Wilson interval."""

    rate: float
    low: float
    high: float


def wilson(num_hits: int, num_trials: int) -> Proportion:
    """Return the share of hits with its 95 % Wilson score interval.

    Unlike rate +- 1.96 standard errors it stays in [0, 1] and does not shrink to nothing at 0 % and 100 %.

    Raises:
        ValueError: no trials, or hits outside 0 .. trials.

    Source: Wilson, Probable inference, the law of succession, and statistical inference, JASA 22 (1927).
    """
    if num_trials < 1 or not 0 <= num_hits <= num_trials:
        raise ValueError(f"Cannot take the share of {num_hits} hits in {num_trials} trials.")
    rate = num_hits / num_trials
    scale = 1.0 + Z_95**2 / num_trials
    centre = (rate + Z_95**2 / (2 * num_trials)) / scale
    half = Z_95 / scale * sqrt(rate * (1.0 - rate) / num_trials + Z_95**2 / (4 * num_trials**2))
    # At 0 and at all hits a bound is exactly 0 or 1; rounding must not move it across the rate.
    return Proportion(rate, min(max(centre - half, 0.0), rate), max(min(centre + half, 1.0), rate))
