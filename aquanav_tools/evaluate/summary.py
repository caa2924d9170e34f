"""What an evaluation is worth: all its episodes in numbers with intervals, and groups of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aquanav_tools.evaluate.metrics import OUTCOMES, REGIONS, EpisodeMetrics
from aquanav_tools.evaluate.statistics import (
    Estimate,
    Proportion,
    bootstrap_means,
    bootstrap_ratio,
    failure_bound,
    wilson,
)

MEANS = (
    "spl", "progress", "collisions", "min_clearance", "clearance_p5", "mean_clearance", "time_close", "time",
    "time_ratio", "path_length", "reward", "cost", "control_effort", "control_change", "energy", "jerk",
    "interventions",
)  # fmt: skip
"""Metrics that are averaged over episodes; those that an episode lacks, over the episodes that have them."""
GROUPINGS = ("scenario", "region", "condition")


@dataclass(frozen=True)
class Summary:
    """Episodes in numbers. Rates carry 95 % Wilson intervals, means 95 % bootstrap intervals."""

    episodes: int
    distinct_episodes: int
    """Different to the bit. Fewer than the episodes where nothing is random and starts come again: the intervals count
    these only."""
    success: Proportion
    collision_free_success: Proportion
    failure_bound: float
    """Probability of anything but collision-free success that is not exceeded with 95 % confidence."""
    outcomes: dict[str, int]
    """Number of episodes per outcome."""
    collisions_per_100m: Estimate
    """Collisions of all episodes over the way of all, per 100 m."""
    min_clearance: float
    """Smallest over all episodes, m."""
    means: dict[str, Estimate]
    """Mean over episodes of each of MEANS that any episode has."""


@dataclass(frozen=True)
class Group:
    """The episodes that have something in common."""

    by: str
    """One of GROUPINGS."""
    name: str
    summary: Summary


def summarise(episodes: Sequence[EpisodeMetrics]) -> Summary:
    """Return the summary of at least one episode.

    An episode that repeats another to the bit adds nothing to what is known, so it is counted once.
    """
    distinct = list({(episode.scenario, episode.digest): episode for episode in episodes}.values())
    clean = sum(episode.is_collision_free_success for episode in distinct)
    collisions = np.array([float(episode.collisions) for episode in distinct])
    metres = np.array([episode.path_length for episode in distinct])
    return Summary(
        episodes=len(episodes),
        distinct_episodes=len(distinct),
        success=wilson(sum(episode.is_success for episode in distinct), len(distinct)),
        collision_free_success=wilson(clean, len(distinct)),
        failure_bound=failure_bound(len(distinct) - clean, len(distinct)),
        outcomes={outcome: sum(episode.outcome == outcome for episode in episodes) for outcome in OUTCOMES},
        collisions_per_100m=bootstrap_ratio(collisions, metres / 100.0),
        min_clearance=min(episode.min_clearance for episode in episodes),
        means=_means(distinct),
    )


def group(episodes: Sequence[EpisodeMetrics]) -> tuple[Group, ...]:
    """Return the summaries per scenario, start region (along the route) and condition; others as they first come."""
    groups = []
    for by in GROUPINGS:
        names = list(dict.fromkeys(getattr(episode, by) for episode in episodes))
        for name in sorted(names, key=REGIONS.index) if by == "region" else names:
            members = [episode for episode in episodes if getattr(episode, by) == name]
            groups.append(Group(by, name, summarise(members)))
    return tuple(groups)


def _means(episodes: Sequence[EpisodeMetrics]) -> dict[str, Estimate]:
    columns = {name: [getattr(episode, name) for episode in episodes] for name in MEANS}
    whole = [name for name, values in columns.items() if None not in values]
    found = dict(zip(whole, bootstrap_means(np.array([columns[name] for name in whole], dtype=float).T), strict=True))
    for name in set(columns) - set(whole):
        values = [value for value in columns[name] if value is not None]
        if values:
            found[name] = bootstrap_means(np.array(values, dtype=float)[:, None])[0]
    return {name: found[name] for name in MEANS if name in found}
