"""How many different episodes there are, how many are run unless asked for, and what is said of more."""

from __future__ import annotations

import dataclasses
import functools
import html
import json
from pathlib import Path
from typing import Any

import pytest

from aquanav_tools.cli.evaluate import main
from aquanav_tools.envs.factory import read_any_scenario
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.env_cache import EpisodeSpec, open_env_cache
from aquanav_tools.evaluate.episode_counts import USUAL, is_drawn, possible_episodes, usual_episodes
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.options import Grid, ProtocolOptions
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.protocol import EpisodePlan, conditions_of, plan_condition
from aquanav_tools.evaluate.summary import summarise
from aquanav_tools.evaluate.summary_text import bound, variety_text
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sea.generate import generate_map
from aquanav_tools.sea.sea_map import write_map
from aquanav_tools.task import TaskOptions
from tests.commands import run_here

aquanav_eval = functools.partial(run_here, main)
NUM_STARTS = 20
"""Of the tube."""


def finished(scenario: Scenario, options: ProtocolOptions, *plans: EpisodePlan) -> list[EpisodeMetrics]:
    (condition,) = conditions_of(Grid())
    with open_env_cache(load_policy("baseline:reactive"), options) as env_cache:
        return [env_cache.run(EpisodeSpec(0, scenario, condition, plan))[1] for plan in plans]


@pytest.fixture(scope="module")
def template(tube: Scenario) -> EpisodeMetrics:
    """A success without a collision."""
    (metrics,) = finished(tube, ProtocolOptions(), EpisodePlan(0, NUM_STARTS - 1))
    assert metrics.is_collision_free_success
    return metrics


def with_start(template: EpisodeMetrics, start: int, **changes: Any) -> EpisodeMetrics:
    return dataclasses.replace(template, start=start, digest=f"{start:064d}", **changes)


@pytest.mark.parametrize(
    ("task", "drawn"),
    [
        ({}, False),
        ({"current": (0.2, 0.0, 0.0)}, False),
        ({"current": (0.2, 0.0, 0.0), "current_range": (0.0, 1.0)}, True),
        ({"current_range": (0.0, 1.0)}, False),
        ({"sensor_noise": 0.5}, True),
        ({"randomisation": "mild"}, True),
        ({"sensor_dropout": 0.5}, True),
        ({"starts": "anywhere"}, True),
        ({"action_delay": 2, "observation_delay": 1}, False),
    ],
)
def test_episodes_from_a_start_repeat_to_the_bit_just_where_nothing_is_said_to_be_random(
    tube: Scenario, task: dict[str, Any], drawn: bool
) -> None:
    options = ProtocolOptions(max_decisions=100, **task)
    start = None if options.starts == "anywhere" else 3
    one, two = finished(tube, options, EpisodePlan(1, start), EpisodePlan(2, start))
    assert is_drawn(tube, options) == (one.digest != two.digest) == drawn


def test_a_current_that_has_gusts_makes_episodes_differ_and_none_of_it_does_not(tube: Scenario) -> None:
    assert is_drawn(tube, TaskOptions(current="half"))
    assert not is_drawn(tube, TaskOptions(current="half", current_range=(0.0, 0.0)))


def test_in_bays_waves_wind_and_tides_make_episodes_differ(tmp_path: Path) -> None:
    write_map(generate_map(3), tmp_path / "bay.json")
    for sea in ("still", "calm"):
        (tmp_path / f"{sea}.toml").write_text(f'format = 1\nmap = "bay.json"\nsea = "{sea}"\n')
    still, calm = (read_any_scenario(tmp_path / f"{sea}.toml") for sea in ("still", "calm"))
    assert not is_drawn(still, TaskOptions())
    assert is_drawn(still, TaskOptions(current=0.3))
    assert is_drawn(calm, TaskOptions())
    assert is_drawn(read_any_scenario("bay-calm"), TaskOptions())


@pytest.mark.parametrize(
    ("task", "starts", "usual", "possible"),
    [
        ({}, NUM_STARTS, NUM_STARTS, NUM_STARTS),
        ({"sensor_noise": 0.1}, NUM_STARTS, 40, None),
        ({"sensor_noise": 0.1}, 15, 45, None),
        ({"sensor_noise": 0.1}, 60, 60, None),
        ({"starts": "anywhere"}, NUM_STARTS, USUAL, None),
    ],
)
def test_every_start_comes_equally_often_and_once_where_more_would_repeat(
    tube: Scenario, task: dict[str, Any], starts: int, usual: int, possible: int | None
) -> None:
    options = TaskOptions(**task)
    assert usual_episodes(tube, options, starts) == usual
    assert possible_episodes(tube, options, starts, draws=False) == possible
    assert possible_episodes(tube, options, starts, draws=True) is None


def test_usual_number_follows_the_condition_and_leaves_a_given_one_alone(tube: Scenario) -> None:
    conditions = conditions_of(Grid(sensor_noise=(0.0, 0.1)))
    assert [len(plan_condition(tube, ProtocolOptions(), condition)) for condition in conditions] == [NUM_STARTS, 40]
    assert len(plan_condition(tube, ProtocolOptions(episodes=7), conditions[0])) == 7
    (regional,) = conditions_of(Grid(region=("first third",)))
    starts = [plan.start_index for plan in plan_condition(tube, ProtocolOptions(), regional)]
    assert len(starts) == len(set(starts)) < NUM_STARTS


def test_an_evaluation_flies_every_start_of_the_chosen_share_once(tube: Scenario) -> None:
    (condition,) = conditions_of(Grid())
    plans = plan_condition(tube, ProtocolOptions(start_range=(0.7, 0.85)), condition)
    wanted = {n for n, start in enumerate(tube.starts) if 0.7 <= (19.0 - start.pose.position[0]) / 18.0 <= 0.85}
    assert len(plans) == len(wanted) and {plan.start_index for plan in plans} == wanted
    with pytest.raises(InputError, match="None of the 20 starts"):
        plan_condition(tube, ProtocolOptions(start_range=(0.0, 0.1)), condition)


def test_evaluation_of_all_there_is_says_so_in_terminal_and_report(folder: Path, tmp_path: Path) -> None:
    flags = ("--max-decisions", 5, "--record", "none", "--workers", 1)
    result = aquanav_eval("baseline:reactive", "--scenario", folder, *flags, "-o", tmp_path)
    said = f"Nothing here is random, so that each listed start leads to one episode, and all {NUM_STARTS} were run"
    table = json.loads((tmp_path / "results.json").read_text())
    assert (table["summary"]["episodes"], table["possible_episodes"]) == (NUM_STARTS, NUM_STARTS)
    assert said in result.stdout
    report = (tmp_path / "report.html").read_text()
    assert said in report
    assert "is known to within 5 points" not in report
    assert 'return, the sum of the reward "careful"' in html.unescape(report)


def test_repeats_are_counted_and_what_is_missing_is_named(template: EpisodeMetrics) -> None:
    episodes = [with_start(template, start) for start in (0, 1, 2, 0)]
    assert variety_text(episodes, summarise(episodes), 3).startswith(
        "1 of the 4 repeat others to the bit and count once"
    )
    assert "there are 20, of which 3 were run" in variety_text(episodes, summarise(episodes), 20)


def test_a_number_of_episodes_is_advised_and_none_where_there_were_enough(template: EpisodeMetrics) -> None:
    few, many = ([with_start(template, start) for start in range(count)] for count in (20, 200))
    # After 20 of 20 the rate may be as low as 0.839 = 20 / (20 + 1.96^2), and 1.96^2 0.839 0.161 / 0.05^2 = 208
    number = int(variety_text(few, summarise(few), None).split("With ")[1].split()[0])
    assert number == pytest.approx(208, rel=0.03)  # the normal interval's number; Wilson's is a little smaller
    assert "With" not in variety_text(many, summarise(many), None)


@pytest.mark.parametrize("count", [1, 2, 7, 40])
def test_the_bound_never_says_at_most_100_percent(template: EpisodeMetrics, count: int) -> None:
    for clean in range(count + 1):
        episodes = [with_start(template, start, collisions=int(start >= clean)) for start in range(count)]
        label, value = bound(summarise(episodes))
        assert value not in ("100 %", "99 %")
        assert label == ("fails in at most" if 2 * clean >= count else "is collision-free in at most")
