"""What an evaluation is worth: all its episodes in numbers with intervals, and groups of them."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from aquanav_tools.evaluate.episode_table import EpisodeTable
from aquanav_tools.evaluate.metrics import ENDED, INFEASIBLE, OUTCOMES, REGIONS, EpisodeMetrics
from aquanav_tools.evaluate.statistics import (
    UNKNOWN,
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
    """Number of episodes per outcome; infeasible ones are named where there are any."""
    collisions_per_100m: Estimate
    """Collisions of all episodes over the path of all, per 100 m."""
    min_clearance: float
    """Smallest over all episodes, m."""
    means: dict[str, Estimate]
    """Mean over episodes of each of MEANS that any episode has."""
    infeasible_episodes: int = 0
    """Different ones in which no policy could have arrived in time: rates and SPL leave them out."""

    @property
    def counted_episodes(self) -> int:
        """Different episodes that the rates are fractions of; 0 where the limit left none a chance."""
        return self.distinct_episodes - self.infeasible_episodes

    def as_table(self) -> dict[str, Any]:
        """Return plain values for JSON; infeasible episodes are named where there are any."""
        table = dataclasses.asdict(self)
        if not self.infeasible_episodes:
            del table["infeasible_episodes"]
        return table


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
    table = _in_columns(episodes)
    distinct = table.distinct()
    successes, collisions = distinct.are("outcome", "success"), distinct.column("collisions")
    clean = int((successes & (collisions == 0)).sum())
    infeasible = int(distinct.are("outcome", INFEASIBLE).sum())
    counted = len(distinct) - infeasible
    return Summary(
        episodes=len(table),
        distinct_episodes=len(distinct),
        success=wilson(int(successes.sum()), counted) if counted else UNKNOWN,
        collision_free_success=wilson(clean, counted) if counted else UNKNOWN,
        failure_bound=failure_bound(counted - clean, counted) if counted else 1.0,
        outcomes=_counts(table),
        collisions_per_100m=bootstrap_ratio(collisions.astype(float), distinct.column("path_length") / 100.0),
        min_clearance=float(table.column("min_clearance").min()),
        means=_means(distinct),
        infeasible_episodes=infeasible,
    )


def _counts(table: EpisodeTable) -> dict[str, int]:
    counts = {outcome: int(table.are("outcome", outcome).sum()) for outcome in OUTCOMES}
    return {outcome: count for outcome, count in counts.items() if count or outcome not in (INFEASIBLE, ENDED)}


def group(episodes: Sequence[EpisodeMetrics]) -> tuple[Group, ...]:
    """Return the summaries per scenario, start region (along the route) and condition; others as they first come."""
    table = _in_columns(episodes)
    groups = []
    for by in GROUPINGS:
        names = table.names(by)
        for name in sorted(names, key=REGIONS.index) if by == "region" else names:
            are_in = table.are(by, name)
            groups.append(Group(by, name, summarise(table if are_in.all() else table.rows(are_in))))
    return tuple(groups)


def _in_columns(episodes: Sequence[EpisodeMetrics]) -> EpisodeTable:
    return episodes if isinstance(episodes, EpisodeTable) else EpisodeTable(episodes)


def _means(episodes: EpisodeTable) -> dict[str, Estimate]:
    values = np.stack([episodes.column(name) for name in MEANS], axis=1).astype(float, copy=False)
    infeasible = episodes.are("outcome", INFEASIBLE)
    if not infeasible.all():
        values[infeasible, MEANS.index("spl")] = np.nan
    lacks = np.isnan(values)
    is_whole = ~lacks.any(axis=0)
    whole = [name for name, all_have_it in zip(MEANS, is_whole, strict=True) if all_have_it]
    found = dict(zip(whole, bootstrap_means(values[:, is_whole]), strict=True))
    for column in np.flatnonzero(~is_whole & ~lacks.all(axis=0)):
        found[MEANS[column]] = bootstrap_means(values[~lacks[:, column], column, None])[0]
    return {name: found[name] for name in MEANS if name in found}
