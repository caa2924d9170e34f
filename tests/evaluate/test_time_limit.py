"""Long ways: the limit leaves time for them, and where it does not, nobody is blamed."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from aquanav_tools.cli.evaluate import main
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.evaluate.batch_runner import BatchRunner
from aquanav_tools.evaluate.env_cache import EpisodeSpec, numbered, open_env_cache
from aquanav_tools.evaluate.metrics import INFEASIBLE, EpisodeMetrics
from aquanav_tools.evaluate.options import ProtocolOptions
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.protocol import EpisodePlan, conditions_of, plan_condition
from aquanav_tools.evaluate.results import check_results
from aquanav_tools.evaluate.rollout import run_episode
from aquanav_tools.evaluate.summary import summarise
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import Scenario
from tests import caves
from tests.caves import tube_field, tube_scenario
from tests.commands import run_here

LONG = 260.0
"""m, which the vehicle swims in 261 s at best, and the original's limit is 240 s."""
TOP_SPEED, TOLERANCE = 0.9947, 0.5
"""Of bluerov2, m/s; of the goal, m."""


def test_the_oracle_arrives_at_the_end_of_a_long_way(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(caves, "TUBE_LENGTH", LONG)
    monkeypatch.setattr(caves, "tube_field", partial(tube_field, 0.25))
    env, oracle = CaveEnv(tube_scenario()), load_policy("baseline:oracle")
    trajectory = run_episode(env, oracle.policy, EpisodePlan(0, 0))
    assert trajectory.outcome == "success"
    assert trajectory.num_decisions > 2400  # the original's limit would have cut it off


def episodes_of(tube: Scenario, options: ProtocolOptions) -> tuple[EpisodeSpec, ...]:
    (condition,) = conditions_of(options.grid)
    return numbered([EpisodeSpec(0, tube, condition, plan) for plan in plan_condition(tube, options, condition)])


def finished(tube: Scenario, **rules: Any) -> list[EpisodeMetrics]:
    """Return the episodes of one who goes nowhere in particular."""
    options = ProtocolOptions(**rules)
    with open_env_cache(load_policy("baseline:random"), options) as env_cache:
        return [env_cache.run(episode)[1] for episode in episodes_of(tube, options)]


def outcomes(episodes: list[EpisodeMetrics]) -> set[str]:
    return {episode.outcome for episode in episodes}


def test_a_timeout_counts_only_where_the_way_can_be_made_in_time() -> None:
    """Starts of the tube are 11 to 17.5 m from the goal: 13.2 s at top speed bring a vehicle to it from some."""
    episodes = finished(tube_scenario(), episodes=20, max_decisions=132)
    assert outcomes(episodes) == {INFEASIBLE, "timeout"}
    for episode in episodes:
        is_in_reach = (episode.geodesic - TOLERANCE) / TOP_SPEED <= 13.2
        assert episode.outcome == ("timeout" if is_in_reach else INFEASIBLE)
    summary, in_reach = summarise(episodes), sum(episode.outcome == "timeout" for episode in episodes)
    assert summary.counted_episodes == in_reach == 20 - summary.infeasible_episodes
    # No success in n: Wilson's upper bound is z^2 / (n + z^2), with z = 1.96.
    assert summary.success.high == pytest.approx(3.8415 / (in_reach + 3.8415), abs=1e-4)


def test_a_contact_that_ends_an_episode_is_the_policy_s_whatever_the_limit() -> None:
    episodes = finished(tube_scenario(), episodes=20, max_decisions=2400, on_collision="end")
    assert INFEASIBLE not in outcomes(episodes)
    assert "collision" in outcomes(episodes)


def test_a_current_against_the_vehicle_is_taken_into_account() -> None:
    """20 s are enough for 17.5 m at 0.995 m/s and more, and for none of 11 m and more at 0.495 m/s."""
    tube = tube_scenario()
    assert outcomes(finished(tube, episodes=3, max_decisions=200, current=(-0.5, 0.0, 0.0))) == {INFEASIBLE}
    assert outcomes(finished(tube, episodes=3, max_decisions=200, current=(0.1, 0.0, 0.0))) == {"timeout"}


def test_a_batch_tells_them_apart_as_well() -> None:
    options = ProtocolOptions(episodes=3, max_decisions=50)
    runner = BatchRunner([load_policy("baseline:random") for _ in range(3)], options)
    finished = runner.run(episodes_of(tube_scenario(), options))
    runner.close()
    assert outcomes([metrics for _, metrics in finished]) == {INFEASIBLE}


@pytest.mark.drawn_reports
def test_an_evaluation_without_a_chance_says_so_and_blames_nobody(tmp_path: Path) -> None:
    folder, output = tmp_path / "tube", tmp_path / "out"
    write_scenario(tube_scenario(), folder)
    words = ("--episodes", 2, "--max-decisions", 50, "--record", "none", "--workers", 1)
    done = run_here(main, "baseline:random", "--scenario", folder, *words, "-o", output)
    assert done.returncode == 0
    assert "In 2 of 2 episodes the time limit is shorter than the path takes" in done.stdout
    assert "not known" in done.stdout and "--max-decisions" in done.stdout
    assert "infeasible-episodes" in (output / "report.html").read_text()
    table = json.loads((output / "results.json").read_text())
    check_results(table)
    assert table["summary"]["outcomes"][INFEASIBLE] == table["summary"]["infeasible_episodes"] == 2


def test_results_without_infeasible_episodes_do_not_name_them() -> None:
    summary = summarise(finished(tube_scenario(), episodes=2, max_decisions=200))
    assert INFEASIBLE not in json.dumps(summary.as_table())
