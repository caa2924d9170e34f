"""The numbers of a summary as text: for the terminal, and for the pages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aquanav_tools.evaluate.episode_table import EpisodeTable
from aquanav_tools.evaluate.metrics import INFEASIBLE, EpisodeMetrics
from aquanav_tools.evaluate.statistics import UNKNOWN, Estimate, Proportion, episodes_for, failure_bound
from aquanav_tools.evaluate.summary import Summary

GOAL_HALF_WIDTH = 0.05
"""Of the interval that the advice on the number of episodes aims at: policies seldom differ by less than 10 points."""


def percent(proportion: Proportion) -> str:
    """Return a rate with its interval: 80 % [66, 89]."""
    if proportion == UNKNOWN:
        return rate_text(proportion)
    return f"{fraction_text(proportion.rate)} [{100 * proportion.low:.0f}, {100 * proportion.high:.0f}]"


def rate_text(rate: Proportion) -> str:
    """Return a rate without its interval."""
    return "not known" if rate == UNKNOWN else fraction_text(rate.rate)


def fraction_text(value: float) -> str:
    """Return a fraction in per cent, with a decimal where it is small: 80 %, 2.3 %."""
    return f"{100 * value:.1f} %" if 0.0 < value < 0.095 else f"{100 * value:.0f} %"


def estimate_text(estimate: Estimate, form: str = "2f", unit: str = "") -> str:
    """Return a mean with its interval: 12.3 m [11.9, 12.8]."""
    unit = f" {unit}" if unit else ""
    return f"{figure(estimate.mean, form)}{unit} [{figure(estimate.low, form)}, {figure(estimate.high, form)}]"


def figure(value: float, form: str) -> str:
    """Return a number in a format such as 2f, without the minus of one that rounds to nothing."""
    text = f"{value:.{form}}"
    return text.removeprefix("-") if float(text) == 0.0 else text


def metres(value: float) -> str:
    """Return a length to the centimetre: 0.00 where a hull touches."""
    return figure(value, "2f")


def sentence(summary: Summary) -> str:
    """Return how it went, in two sentences."""
    if not summary.counted_episodes:
        return infeasible_text(summary)
    free = round(summary.collision_free_success.rate * summary.counted_episodes)
    clearance = summary.means["mean_clearance"].mean
    label, value = bound(summary)
    return (
        f"It reached the goal without a collision in {free} of {summary.counted_episodes} different episodes, and "
        f"kept {metres(clearance)} m clear of everything on average. With 95 % confidence it {label} {value} of such "
        "episodes."
    )


def bound(summary: Summary) -> tuple[str, str]:
    """Return what 95 % confidence bounds, and the bound: ("fails in at most", "7.2 %").

    Failures are bounded where most episodes were collision-free successes, and these where they were few: the other
    bound would be near 100 % and say nothing.
    """
    count = summary.counted_episodes
    num_free = round(summary.collision_free_success.rate * count)
    if 2 * num_free >= count:
        return "fails in at most", fraction_text(summary.failure_bound)
    return "is collision-free in at most", fraction_text(failure_bound(num_free, count))


def infeasible_text(summary: Summary) -> str:
    """Return what is said of episodes in which no policy could have arrived in time."""
    count = summary.outcomes[INFEASIBLE]
    return (
        f"In {count} of {summary.episodes} episodes the time limit is shorter than the path takes at the vehicle's top "
        "speed, so no policy could arrive. They ran out of time, and count neither as success nor as failure. Give "
        "more time with --max-decisions; without it, and without a limit in the scenario, the limit follows from the "
        "path."
    )


def variety_text(episodes: Sequence[EpisodeMetrics], summary: Summary, num_possible: int | None) -> str:
    """Return how many different episodes there can be, and whether more of them would tell more.

    Args:
        episodes: What was run.
        summary: Of these.
        num_possible: How many that differ there are in these scenarios under these conditions; None for no end.
    """
    repeats = summary.episodes - summary.distinct_episodes
    again = f"{repeats} of the {summary.episodes} repeat others to the bit and count once. " if repeats else ""
    if num_possible is None:
        advice = _advice(summary.collision_free_success)
        return f"{again}Nothing limits the number of different episodes here.{f' {advice}' if advice else ''}"
    cause = "Nothing here is random, so that each listed start leads to one episode"
    if _num_beginnings(episodes) < num_possible:
        return f"{again}{cause}: there are {num_possible}, of which {summary.distinct_episodes} were run."
    return (
        f"{again}{cause}, and all {summary.distinct_episodes} were run: more tell nothing. The intervals are for other "
        "starts like these; to run some take --starts anywhere, or let something be random (--current, --sensor-noise)."
    )


def _num_beginnings(episodes: Sequence[EpisodeMetrics]) -> int:
    """Return from how many starts, in how many scenarios and conditions, episodes began."""
    table = episodes if isinstance(episodes, EpisodeTable) else EpisodeTable(episodes)
    columns = [table.column(name) for name in ("scenario", "condition", "start")]
    return len(np.unique(np.stack(columns, axis=1), axis=0))


def _advice(rate: Proportion) -> str:
    """Return how many episodes are enough wherever in its interval the rate lies; empty where there were as many."""
    if max(rate.high - rate.rate, rate.rate - rate.low) <= GOAL_HALF_WIDTH:
        return ""
    hardest = 0.5 if rate.low <= 0.5 <= rate.high else min((rate.low, rate.high), key=lambda value: abs(value - 0.5))
    count = episodes_for(hardest, GOAL_HALF_WIDTH)
    goal = 100 * GOAL_HALF_WIDTH
    return f"With {count} of them the rate of collision-free success is known to within {goal:.0f} points."
