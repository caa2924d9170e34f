from __future__ import annotations

import dataclasses

import pytest

from aquanav_tools.evaluate.metrics import EpisodeMetrics, measure, spl, summarise
from tests.report.tracks import straight_track


def episode(**overrides: object) -> EpisodeMetrics:
    return dataclasses.replace(measure(straight_track(), geodesic=18.0), **overrides)  # type: ignore[arg-type]


def test_metrics_of_a_straight_episode_are_those_computed_by_hand() -> None:
    result = measure(straight_track(100), geodesic=9.0)
    assert result.time == pytest.approx(10.0)
    assert result.path_length == pytest.approx(18.0)
    assert result.progress == pytest.approx(18.0)
    assert (result.min_clearance, result.mean_clearance) == pytest.approx((0.5, 0.75))
    assert result.reward == pytest.approx(50.0)
    assert result.cost == 3.0
    assert result.collisions == 1
    assert result.spl == pytest.approx(0.5)


def test_contact_over_several_states_is_drawn_once() -> None:
    assert straight_track(100).contact_states.tolist() == [50]


def test_spl_is_one_for_the_shortest_way_and_zero_for_a_failure() -> None:
    assert spl(True, 10.0, 10.0) == 1.0
    assert spl(True, 10.0, 9.5) == 1.0  # the goal's tolerance can save half a metre
    assert spl(False, 10.0, 10.0) == 0.0


def test_one_contact_spoils_collision_free_success_but_not_success() -> None:
    summary = summarise(
        [episode(collisions=0), episode(collisions=1), episode(outcome="timeout", collisions=0, spl=0.0)]
    )
    assert summary.success.rate == pytest.approx(2 / 3)
    assert summary.collision_free_success.rate == pytest.approx(1 / 3)
    assert summary.outcomes == {"success": 2, "collision": 0, "timeout": 1}
    assert summary.collisions_per_episode == pytest.approx(1 / 3)
    assert summary.spl == pytest.approx(2 / 3)


def test_minimum_clearance_is_over_episodes_and_the_mean_is_of_means() -> None:
    summary = summarise(
        [episode(min_clearance=0.1, mean_clearance=0.2), episode(min_clearance=0.3, mean_clearance=0.6)]
    )
    assert summary.min_clearance == 0.1
    assert summary.mean_clearance == pytest.approx(0.4)
