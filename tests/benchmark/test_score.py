"""The score of a benchmark against numbers worked out by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from aquanav_tools.benchmark.leaderboard import holm, paired_p_value
from aquanav_tools.benchmark.score import score_of
from aquanav_tools.evaluate.metrics import EpisodeMetrics

EPISODE = EpisodeMetrics(
    index=0, scenario="", condition="", region="first third", seed=0, start=0, outcome="success", reason="",
    collisions=0, min_clearance=0.2, clearance_p5=0.3, mean_clearance=0.5, time_close=0.0, time=20.0, time_ratio=1.0,
    path_length=50.0, geodesic=40.0, progress=40.0, spl=0.8, reward=0.0, cost=0.0, control_effort=0.0,
    control_change=0.0, energy=None, jerk=0.0, interventions=None, digest="",
)  # fmt: skip


def dives(scenario: str, clean: int, scraped: int = 0, lost: int = 0) -> list[EpisodeMetrics]:
    """Return dives in a cave that end clean, at the goal after two contacts, and not at all."""
    kinds = [("success", 0)] * clean + [("success", 2)] * scraped + [("timeout", 1)] * lost
    return [
        dataclasses.replace(EPISODE, scenario=scenario, outcome=outcome, collisions=count, digest=f"{scenario}{n}")
        for n, (outcome, count) in enumerate(kinds)
    ]


def test_a_cave_counts_by_its_clean_dives_and_a_tier_by_its_caves() -> None:
    episodes = dives("a", clean=10) + dives("b", clean=5, scraped=3, lost=2) + dives("c", clean=0, lost=10)
    score = score_of(episodes, {"a": "one", "b": "one", "c": "two"})
    assert {cave.scenario: cave.collision_free_success for cave in score.caves} == {"a": 1.0, "b": 0.5, "c": 0.0}
    assert [(tier.name, tier.caves, tier.mean.mean, tier.worst) for tier in score.tiers] == [
        ("one", 2, 0.75, 0.5),
        ("two", 1, 0.0, 0.0),
    ]
    assert score.total.mean.mean == pytest.approx(0.5)
    assert score.total.means["success"] == pytest.approx((1.0 + 0.8 + 0.0) / 3)
    # 3 * 2 + 2 + 10 contacts in 30 dives of 50 m
    assert score.total.collisions_per_100m.mean == pytest.approx(18 / 15.0)


def test_the_interquartile_mean_leaves_out_the_best_and_the_worst_quarter_of_caves() -> None:
    clean = [0, 1, 5, 6, 7, 8, 10, 10]
    episodes = [dive for n, count in enumerate(clean) for dive in dives(f"c{n}", clean=count, lost=10 - count)]
    score = score_of(episodes, {f"c{n}": "tier" for n in range(8)})
    assert score.total.iqm.mean == pytest.approx((0.5 + 0.6 + 0.7 + 0.8) / 4)
    assert score.total.mean.mean == pytest.approx(4.7 / 8)


def test_intervals_are_those_of_the_mean_over_caves_of_each_tier() -> None:
    rng = np.random.default_rng(3)
    sure, unsure = [10] * 60, rng.binomial(10, rng.uniform(0.0, 1.0, 60)).tolist()
    tiers = {f"c{n}": "sure" if n < 60 else "unsure" for n in range(120)}
    episodes = [d for n, count in enumerate(sure + unsure) for d in dives(f"c{n}", clean=count, lost=10 - count)]
    score = score_of(episodes, tiers)
    # Caves of the sure tier add nothing to the spread: the mean of 120 has half the standard error of the other 60.
    error = np.std(np.array(unsure) / 10) / np.sqrt(60)
    for found, expected in ((score.tiers[1], 1.96 * error), (score.total, 0.5 * 1.96 * error)):
        # 2000 resamples know the width to some per cent
        assert (found.mean.high - found.mean.low) / 2 == pytest.approx(expected, rel=0.08)
    assert score.tiers[0].mean.low == score.tiers[0].mean.high == 1.0


def test_caves_of_ones_own_do_not_count_in_the_total() -> None:
    episodes = dives("a", clean=10) + dives("mine", clean=0, lost=10)
    score = score_of(episodes, {"a": "one", "mine": "real"}, apart="real")
    assert score.total.mean.mean == 1.0 and score.tiers[1].mean.mean == 0.0


def test_the_paired_test_counts_signs() -> None:
    # Of the 2^5 ways to choose the signs of five equal differences, two are as far from zero as all positive.
    assert paired_p_value(np.full(5, 0.6), np.full(5, 0.5)) == pytest.approx(2 / 32)
    assert paired_p_value(np.full(5, 0.6), np.full(5, 0.6)) == 1.0


def test_p_values_of_several_rows_are_corrected_by_holm() -> None:
    # Holm's own procedure by hand: 4 * 0.005, then 3 * 0.01, then max(0.03, 2 * 0.012), then 0.4.
    assert holm([0.01, 0.4, 0.005, 0.012]) == pytest.approx([0.03, 0.4, 0.02, 0.03])
    assert holm([0.6, 0.7]) == pytest.approx([1.0, 1.0])
    assert holm([]) == []
