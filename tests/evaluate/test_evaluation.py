from __future__ import annotations

import copy
import dataclasses
import hashlib
import json
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pytest

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.evaluate.evaluation import evaluate
from aquanav_tools.evaluate.options import EvaluateOptions
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.protocol import EpisodePlan
from aquanav_tools.evaluate.results import check_results
from aquanav_tools.evaluate.rollout import run_episode
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import LimitSettings, Scenario
from tests.evaluate.models import make_model


def aquanav_eval(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from aquanav_tools.cli.evaluate import main; main()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, tube: Scenario) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "tube"
    limits = LimitSettings(decisions=300)
    write_scenario(dataclasses.replace(tube, settings=dataclasses.replace(tube.settings, limits=limits)), path)
    return path


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, folder: Path) -> tuple[Path, str]:
    """Return the output folder of an evaluation, and what the command printed."""
    output = tmp_path_factory.mktemp("eval")
    result = aquanav_eval("baseline:reactive", "--scenario", folder, "--episodes", 4, "--seed", 5, "-o", output)
    assert result.returncode == 0, result.stderr
    return output, result.stdout


@pytest.fixture
def table(finished: tuple[Path, str]) -> Any:
    return json.loads((finished[0] / "results.json").read_text())


def test_evaluation_leaves_results_report_pictures_and_recordings(finished: tuple[Path, str]) -> None:
    output, _ = finished
    names = {path.name for path in output.iterdir()}
    assert names == {"results.json", "report.html", "pictures", *(f"episode-0000{seed}.rrd" for seed in (5, 6, 7, 8))}
    assert len(list((output / "pictures").glob("*.png"))) == 5


def test_command_prints_the_rates_and_where_to_look(finished: tuple[Path, str]) -> None:
    output, printed = finished
    for part in ("100 % [51, 100]", "SPL", "report.html", "results.json", f"rerun {output}/episode-00005.rrd"):
        assert part in printed  # [51, 100] is the Wilson interval of 4 of 4: 4 / (4 + 1.96^2) = 0.510


def test_results_follow_the_schema_and_the_protocol(table: Any) -> None:
    check_results(table)
    assert [episode["seed"] for episode in table["episodes"]] == [5, 6, 7, 8]
    assert table["policy"] == {"name": "baseline:reactive", "sha256": None}
    assert len(table["scenario"]["content_hash"]) == 64


@pytest.mark.parametrize("path", [("summary", "spl"), ("policy", "sha256"), ("episodes", 0, "outcome"), ("format",)])
def test_schema_refuses_results_without_a_part(table: Any, path: tuple[str | int, ...]) -> None:
    broken = copy.deepcopy(table)
    parent = broken
    for key in path[:-1]:
        parent = parent[key]
    del parent[path[-1]]
    with pytest.raises(jsonschema.ValidationError):
        check_results(broken)


@pytest.fixture
def run(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Any]:
    """Return a function that evaluates in this process, with coarse pictures, and returns results.json."""
    monkeypatch.setattr("aquanav_tools.report.picture.DPI", 20)

    def evaluate_here(policy: str, **options: Any) -> Any:
        evaluation = evaluate(EvaluateOptions(policy, folder, tmp_path / "eval", **options), lambda done, total: None)
        return json.loads(evaluation.results.read_text())

    return evaluate_here


def test_repeated_evaluation_gives_the_same_bytes_but_for_the_run(table: Any, run: Callable[..., Any]) -> None:
    repeated = run("baseline:reactive", episodes=4, seed=5, record="none")
    del table["run"], repeated["run"]
    assert json.dumps(repeated) == json.dumps(table)


def test_only_failures_are_recorded_on_request_and_old_recordings_go(tmp_path: Path, run: Callable[..., Any]) -> None:
    run("baseline:random", episodes=2, record="failures", max_recordings=1)
    assert [path.name for path in (tmp_path / "eval").glob("*.rrd")] == ["episode-00000.rrd"]
    run("baseline:reactive", episodes=1, record="failures")
    assert not list((tmp_path / "eval").glob("*.rrd"))


def test_saved_policy_is_evaluated_with_its_hash(tmp_path: Path, run: Callable[..., Any]) -> None:
    make_model(action="discrete", num_observations=31).save(tmp_path / "policy.zip")
    table = run(str(tmp_path / "policy.zip"), episodes=1)
    digest = hashlib.sha256((tmp_path / "policy.zip").read_bytes()).hexdigest()
    assert table["policy"] == {"name": "policy.zip", "sha256": digest}
    assert (table["options"]["observation"], table["options"]["action"]) == ("paper", "discrete")


def test_contact_ends_the_episode_on_request(run: Callable[..., Any]) -> None:
    table = run("baseline:random", episodes=2, on_collision="end", record="none")
    assert {episode["outcome"] for episode in table["episodes"]} == {"collision"}
    assert table["summary"]["collisions_per_episode"] == 1.0


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (("none.zip",), 2, "no policy at none.zip"),
        (("baseline:best",), 2, "no baseline 'best'"),
        (("baseline:random", "--episodes", "0"), 2, "--episodes is 0"),
        (("baseline:random", "--seed", "-1"), 2, "--seed is -1"),
    ],
)
def test_bad_input_ends_with_a_sentence_and_leaves_nothing(
    folder: Path, tmp_path: Path, arguments: tuple[str, ...], code: int, message: str
) -> None:
    result = aquanav_eval(*arguments, "--scenario", folder, "-o", tmp_path / "eval")
    assert result.returncode == code
    assert message in result.stderr
    assert "Traceback" not in result.stderr
    assert not (tmp_path / "eval").exists()


def test_folder_that_is_no_scenario_has_its_own_exit_code(tmp_path: Path) -> None:
    result = aquanav_eval("baseline:random", "--scenario", tmp_path, "-o", tmp_path / "eval")
    assert result.returncode == 5
    assert "is not a scenario" in result.stderr


def test_output_that_is_a_file_is_refused(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "eval").write_text("mine")
    result = aquanav_eval("baseline:random", "--scenario", folder, "--episodes", "1", "-o", tmp_path / "eval")
    assert result.returncode == 2
    assert "Cannot write to the output folder" in result.stderr
    assert (tmp_path / "eval").read_text() == "mine"


def test_help_answers_at_once() -> None:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert aquanav_eval("--help").returncode == 0
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    assert after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime < 0.5  # CPU time, whoever else runs


def test_track_holds_the_environments_own_numbers(tube: Scenario) -> None:
    loaded = load_policy("baseline:reactive")
    env = CaveEnv(tube, observation=loaded.observation, action=loaded.action, max_decisions=40)
    track = run_episode(env, loaded.policy, EpisodePlan(seed=2, start_index=4))
    env.close()
    assert track.outcome == "timeout"
    assert track.num_decisions == 40
    assert track.times[-1] == pytest.approx(4.0)
    np.testing.assert_allclose(track.positions[0], tube.starts[4].pose.position)
    np.testing.assert_allclose(sum(track.reward_terms.values()), track.rewards)
    assert np.unique(track.positions, axis=0).shape == track.positions.shape  # states are kept, not a reused buffer
