"""The search for failures: it finds what is there, repeats, goes on, and its protocol flies the same episodes."""

from __future__ import annotations

import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.evaluation import evaluate
from aquanav_tools.evaluate.options import Case, EvaluateOptions, StressOptions
from aquanav_tools.evaluate.protocol import plan_case, read_protocol
from aquanav_tools.evaluate.search import GENERATION, NUM_AXES, CaseSpace, Search, random_points
from aquanav_tools.evaluate.stress import stress
from aquanav_tools.evaluate.stress_report import verdict
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Array
from tests.evaluate.policies import TROUBLE, load_drifting

BUDGET = 8
HALF_WIDTH = 0.1
"""Of a made-up failure region in the first two axes: 4 % of all cases."""


def ignore(done: int, total: int) -> None:
    pass


def made_up_danger(point: Array) -> float:
    """1 within HALF_WIDTH of (0.8, 0.3) in the first two axes; outside, the less the farther."""
    away = float(np.abs(point[:2] - [0.8, 0.3]).max())
    return 1.0 if away < HALF_WIDTH else -away


def searched(seed: int, num_generations: int) -> list[Array]:
    search, found = Search(seed), []
    for _ in range(num_generations):
        points = search.ask()
        search.tell(points, [made_up_danger(point) for point in points])
        found += points
    return found


def test_search_finds_a_region_of_known_size_far_more_often_than_chance() -> None:
    for seed in range(5):
        hits = sum(made_up_danger(point) > 0.0 for point in searched(seed, 25))
        drawn = sum(made_up_danger(point) > 0.0 for point in random_points(seed, 25 * GENERATION))
        expected = 4 * HALF_WIDTH**2 * 25 * GENERATION  # 8 of 200
        assert drawn < expected + 4 * np.sqrt(expected)  # four standard deviations of a Poisson count
        assert hits > 4 * expected


def test_search_repeats_with_its_seed() -> None:
    np.testing.assert_array_equal(searched(3, 6), searched(3, 6))
    assert not np.array_equal(searched(3, 2), searched(4, 2))


def test_points_of_the_cube_become_cases_within_bounds(rng: np.random.Generator) -> None:
    options = StressOptions(policy="baseline:random", scenario=Path("cave"), seed=5, seeds=3)
    space = CaseSpace(options, (4, 2, 9))
    cases = [space.case(point) for point in rng.uniform(-0.1, 1.1, (200, NUM_AXES))]
    assert {case.start for case in cases} == {4, 2, 9}
    assert {case.seed for case in cases} == {5, 6, 7}
    assert max(case.current for case in cases) == options.max_current
    assert min(case.sensor_noise for case in cases) == 0.0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, tube: Scenario) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "tube"
    write_scenario(tube, path)
    return path


def options_of(folder: Path, output: Path, **changes: Any) -> StressOptions:
    rules: dict[str, Any] = {"policy": "drifting", "budget": BUDGET, "max_decisions": 20, "workers": 1, "worst": 3}
    rules["current"] = (0.05, 0.1, 0.0)  # the tube has no flow of its own
    return StressOptions(scenario=folder, output=output, **{**rules, **changes})


@pytest.mark.drawn_reports
def test_worst_cases_are_saved_fly_again_as_they_were_and_a_stopped_search_ends_the_same(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(TROUBLE, "")
    found = stress(options_of(folder, tmp_path / "stress"), ignore, load_drifting)
    assert len(found.drawn) == len(found.searched) == BUDGET
    assert [trial.danger for trial in found.worst] == sorted((trial.danger for trial in found.worst), reverse=True)

    protocol = read_protocol(str(tmp_path / "stress" / "worst.toml"))
    choices = EvaluateOptions(("drifting",), (folder,), tmp_path / "again", record="none", **protocol)
    again = evaluate(choices, ignore, load=load_drifting)
    assert [episode.digest for episode in again.episodes] == [trial.metrics.digest for trial in found.worst]
    assert (tmp_path / "again" / "cases.toml").read_bytes() == (tmp_path / "stress" / "worst.toml").read_bytes()

    whole = (tmp_path / "stress" / "stress.json").read_bytes()
    journal = tmp_path / "stress" / "episodes.jsonl"
    journal.write_bytes(b"".join(journal.read_bytes().splitlines(keepends=True)[:5]))
    stress(options_of(folder, tmp_path / "stress", resume=True), ignore, load_drifting)
    assert (tmp_path / "stress" / "stress.json").read_bytes() == whole
    assert len(json.loads(whole)["worst"]) == 3


def test_policy_that_runs_code_is_searched_with_trust_only_and_the_page_says_how_to_repeat_it(
    folder: Path, tmp_path: Path
) -> None:
    pytest.importorskip("torch", reason="The policy of this test is TorchScript.")
    from tests.evaluate.test_trusted import Fixed, export

    policy = export(Fixed(44, [0, 2, 1], is_integer=True), tmp_path / "policy.pt")
    with pytest.raises(InputError, match="add --trust"):
        stress(options_of(folder, tmp_path / "stress", policy=policy), ignore)
    found = stress(options_of(folder, tmp_path / "stress", policy=policy, trust=True, budget=2), ignore)
    assert {trial.metrics.outcome for trial in (*found.drawn, *found.searched)} <= {"infeasible", "collision"}
    page = found.report.read_text()
    misses = sum(trial.metrics.outcome != "success" for trial in found.drawn)
    assert f"missed the goal in {50 * misses} %" in verdict(found)
    assert ("fails-anyway" in page) == (sum(trial.is_failure for trial in found.drawn) == 2)
    (again,) = re.findall(r"aquanav-eval stress [^<]*", page)
    assert all(word in again for word in ("--trust", "--budget 2", "--max-decisions 20", "--current 0.05 0.1 0.0"))


def test_case_of_another_scenario_is_refused(tube: Scenario) -> None:
    with pytest.raises(InputError, match=r"start 500, and .* has 20 listed starts"):
        plan_case(tube, Case(500, 0))


def test_search_refuses_what_it_chooses_itself(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="--max-noise and --max-current bound the search"):
        dataclasses.replace(options_of(folder, tmp_path), sensor_noise=0.1)
