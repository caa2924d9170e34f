"""What a policy's episodes in a benchmark come to: means over caves, with intervals over caves.

A cave counts by the fraction of its episodes that ended at the goal without a collision. Intervals are of a bootstrap
over caves within each tier: another draw of caves by the same rule would give a score in them. The interquartile mean
leaves out the best and the worst quarter of caves (Agarwal et al., Deep reinforcement learning at the edge of the
statistical precipice, NeurIPS 2021).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from aquanav_tools.evaluate.episode_table import EpisodeTable
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.statistics import BOOTSTRAP_SEED, RESAMPLES, Estimate, bootstrap_ratio, interquartile_means
from aquanav_tools.types import Array

MEANS = ("success", "spl", "min_clearance", "mean_clearance", "time")
"""Beside the score, mean over caves of their episodes' means: fractions, m, s."""


@dataclass(frozen=True)
class CaveScore:
    """One cave."""

    scenario: str
    tier: str
    episodes: int
    collision_free_success: float
    """Fraction of the episodes."""
    means: dict[str, float]
    """Of each of MEANS."""


@dataclass(frozen=True)
class TierScore:
    """Some caves: a tier, or all."""

    name: str
    caves: int
    mean: Estimate
    """Of collision-free success over caves."""
    iqm: Estimate
    """Its interquartile mean over caves."""
    worst: float
    """Of the cave with the least."""
    collisions_per_100m: Estimate
    """Collisions of all episodes over the path of all, intervals over episodes."""
    means: dict[str, float]
    """Of each of MEANS, over caves."""


@dataclass(frozen=True)
class Score:
    """What a benchmark says of a policy."""

    total: TierScore
    """Over all tiers but that of the user's own caves."""
    tiers: tuple[TierScore, ...]
    caves: tuple[CaveScore, ...]


def score_of(episodes: Sequence[EpisodeMetrics], tier_of: Mapping[str, str], apart: str = "") -> Score:
    """Return the score of a benchmark's episodes.

    Args:
        episodes: Of whole caves; at least one.
        tier_of: The tier of each scenario, by its name; tiers come in the order in which they are first named.
        apart: A tier that does not count in the total, unless there is no other.
    """
    table = episodes if isinstance(episodes, EpisodeTable) else EpisodeTable(episodes)
    parts = {name: table.rows(table.are("scenario", name)) for name in table.names("scenario")}
    caves = tuple(_cave_score(name, tier_of[name], rows) for name, rows in parts.items())
    names = [tier for tier in dict.fromkeys(tier_of.values()) if any(cave.tier == tier for cave in caves)]
    counted = [name for name in names if name != apart] or names
    tiers = tuple(_tier_score(name, [name], caves, parts) for name in names)
    return Score(_tier_score("all tiers", counted, caves, parts), tiers, caves)


def _cave_score(name: str, tier: str, rows: EpisodeTable) -> CaveScore:
    successes = rows.are("outcome", "success")
    clean = successes & (rows.column("collisions") == 0)
    means = {key: float(rows.column(key).mean()) for key in MEANS if key != "success"}
    return CaveScore(name, tier, len(rows), float(clean.mean()), {"success": float(successes.mean()), **means})


def _tier_score(
    name: str, tiers: Sequence[str], caves: Sequence[CaveScore], parts: Mapping[str, EpisodeTable]
) -> TierScore:
    strata = [np.array([cave.collision_free_success for cave in caves if cave.tier == tier]) for tier in tiers]
    own = [cave for cave in caves if cave.tier in tiers]
    collisions = np.concatenate([parts[cave.scenario].column("collisions") for cave in own]).astype(float)
    paths = np.concatenate([parts[cave.scenario].column("path_length") for cave in own])
    mean, iqm = _over_caves(strata)
    return TierScore(
        name=name,
        caves=len(own),
        mean=mean,
        iqm=iqm,
        worst=min(cave.collision_free_success for cave in own),
        collisions_per_100m=bootstrap_ratio(collisions, paths / 100.0),
        means={key: float(np.mean([cave.means[key] for cave in own])) for key in MEANS},
    )


def _over_caves(strata: Sequence[Array]) -> tuple[Estimate, Estimate]:
    """Return the mean and the interquartile mean of all caves' scores, each with its 95 % interval."""
    rng = np.random.default_rng(BOOTSTRAP_SEED)
    drawn = [scores[rng.integers(len(scores), size=(RESAMPLES, len(scores)))] for scores in strata]
    resampled, scores = np.concatenate(drawn, axis=1), np.concatenate(strata)[None]
    found = []
    for of in (lambda rows: rows.mean(axis=1), interquartile_means):
        low, high = np.percentile(of(resampled), [2.5, 97.5])
        found.append(Estimate(float(of(scores)[0]), float(low), float(high)))
    return found[0], found[1]
