from __future__ import annotations

import json
import math

import numpy as np
import pytest

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.train.episodes import SUMMARY, EpisodeSummary, LearningCurve, SummaryWrapper


def test_curve_averages_the_last_episodes() -> None:
    curve = LearningCurve()
    curve.add([{}, {SUMMARY: EpisodeSummary(10.0, 100, 0, True)}])
    curve.add([{SUMMARY: EpisodeSummary(20.0, 300, 3, True)}, {SUMMARY: EpisodeSummary(0.0, 200, 0, False)}])
    point = curve.mark(1, 600, 1.5, {"train/loss": 0.5})
    assert (point.steps, point.episodes, point.row["train/loss"]) == (600, 3, 0.5)
    assert (point.mean_reward, point.mean_length, point.mean_collisions) == (10.0, 200.0, 1.0)
    assert point.success_rate == pytest.approx(2 / 3, abs=1e-4)
    assert point.collision_free_success == pytest.approx(1 / 3, abs=1e-4)


def test_curve_has_no_numbers_before_the_first_episode() -> None:
    assert math.isnan(LearningCurve().mark(1, 10, 0.1, {}).success_rate)


def test_rates_with_episodes_cut_short_come_with_a_caveat() -> None:
    curve = LearningCurve()
    assert curve.mark(1, 10, 0.1, {}).caveat == ""
    curve.add([{SUMMARY: EpisodeSummary(10.0, 100, 0, True)}])
    assert curve.mark(1, 20, 0.2, {}).caveat == ""
    curve.add([{SUMMARY: EpisodeSummary(1.0, 7, 0, False, is_cut_short=True)} for _ in range(3)])
    assert curve.mark(1, 30, 0.3, {}).caveat.startswith("75% of these episodes were cut short")


def test_curve_comes_back_from_its_table() -> None:
    curve = LearningCurve()
    curve.add([{SUMMARY: EpisodeSummary(10.0, 100, 0, True)}])
    curve.mark(1, 600, 1.5, {"train/loss": 0.5})
    again = LearningCurve.from_table(json.loads(json.dumps(curve.as_table())))
    assert again.as_table() == curve.as_table()
    assert again.mark(1, 700, 2.0, {}).mean_reward == 10.0


def test_a_lesson_begins_without_the_last_ones_episodes() -> None:
    curve = LearningCurve()
    curve.add([{SUMMARY: EpisodeSummary(10.0, 100, 0, True)}])
    curve.begin_lesson()
    assert math.isnan(curve.mark(2, 600, 1.5, {}).success_rate)


def test_wrapper_sums_up_an_episode_at_its_end(tube: Scenario) -> None:
    env = SummaryWrapper(CaveEnv(tube, max_decisions=5))
    env.reset(seed=0)
    steps = [env.step(np.array([1, 1, 2])) for _ in range(5)]
    assert all(not step[4] for step in steps[:-1])
    summary = steps[-1][4][SUMMARY]
    assert (summary.length, summary.num_collisions, summary.is_success) == (5, 0, False)
    assert summary.reward == pytest.approx(sum(step[1] for step in steps))
    env.close()
