from __future__ import annotations

import copy
import dataclasses
import functools
import hashlib
import json
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import jsonschema
import numpy as np
import pyarrow.parquet
import pytest
from scipy.stats import binomtest

from aquanav_tools.cli.evaluate import main
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.pictures import film as films
from aquanav_tools.evaluate.evaluation import evaluate
from aquanav_tools.evaluate.options import EvaluateOptions
from aquanav_tools.evaluate.policies import LoadedPolicy, load_policy
from aquanav_tools.evaluate.protocol import EpisodePlan
from aquanav_tools.evaluate.results import check_results
from aquanav_tools.evaluate.rollout import CallTimeout, run_episode
from aquanav_tools.evaluate.summary_text import metres
from aquanav_tools.scenario.schema import Scenario
from tests.caves import write_short
from tests.commands import run_here
from tests.evaluate.models import make_model

aquanav_eval = functools.partial(run_here, main)


def as_a_process(*arguments: str | int | Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from aquanav_tools.cli.evaluate import main; main()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, tube: Scenario) -> Path:
    return write_short(tube, tmp_path_factory.mktemp("scenario") / "tube", 300)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory, folder: Path) -> tuple[Path, str]:
    """Return the output folder of an evaluation, and what the command printed."""
    output = tmp_path_factory.mktemp("eval")
    result = as_a_process("baseline:reactive", "--scenario", folder, "--episodes", 4, "--seed", 5, "-o", output)
    assert result.returncode == 0, result.stderr
    return output, result.stdout


@pytest.fixture
def table(finished: tuple[Path, str]) -> Any:
    return json.loads((finished[0] / "results.json").read_text())


def test_evaluation_leaves_results_report_pictures_and_recordings(finished: tuple[Path, str]) -> None:
    output, _ = finished
    names = {path.name for path in output.iterdir()}
    files = {"results.json", "episodes.parquet", "report.html", "run.json", "episodes.jsonl", "pictures", "trails"}
    assert names == files | {f"episode-0000{index}.rrd" for index in range(4)}
    assert len(list((output / "pictures").glob("*.png"))) == 5


def test_command_prints_the_rates_and_where_to_look(finished: tuple[Path, str]) -> None:
    output, printed = finished
    for part in ("100 % [51, 100]", "SPL", "report.html", "results.json", f"rerun {output}/episode-00000.rrd"):
        assert part in printed  # [51, 100] is the Wilson interval of 4 of 4: 4 / (4 + 1.96^2) = 0.510


def test_results_follow_the_schema_and_the_protocol(table: Any) -> None:
    check_results(table)
    assert [episode["seed"] for episode in table["episodes"]] == [5, 6, 7, 8]
    name = "baseline:reactive"
    assert table["policy"] == {"name": name, "sha256": None, "path": name, "is_trusted": False}
    assert len(table["scenarios"][0]["content_hash"]) == 64


@pytest.mark.parametrize(
    "path", [("summary", "means", "spl"), ("policy", "sha256"), ("episodes", 0, "outcome"), ("format",)]
)
def test_schema_refuses_results_without_a_part(table: Any, path: tuple[str | int, ...]) -> None:
    broken = copy.deepcopy(table)
    parent = broken
    for key in path[:-1]:
        parent = parent[key]
    del parent[path[-1]]
    with pytest.raises(jsonschema.ValidationError):
        check_results(broken)


@pytest.fixture
def run(folder: Path, tmp_path: Path) -> Callable[..., Any]:
    """Return a function that evaluates in this process and returns results.json."""

    def evaluate_here(policy: str, load: Callable[[str], LoadedPolicy] = load_policy, **options: Any) -> Any:
        choices = EvaluateOptions((policy,), (folder,), tmp_path / "eval", **options)
        evaluation = evaluate(choices, lambda done, total: None, load=load)
        return json.loads(evaluation.results.read_text())

    return evaluate_here


def test_repeated_evaluation_gives_the_same_bytes(table: Any, run: Callable[..., Any]) -> None:
    repeated = run("baseline:reactive", episodes=4, seed=5, record="none")
    assert json.dumps(repeated) == json.dumps(table)


def test_parquet_has_the_rows_of_results(finished: tuple[Path, str], table: Any) -> None:
    rows = pyarrow.parquet.read_table(finished[0] / "episodes.parquet").to_pylist()
    assert rows == table["episodes"]


def test_rates_follow_from_the_table_of_episodes_by_another_route(finished: tuple[Path, str], table: Any) -> None:
    rows = pyarrow.parquet.read_table(finished[0] / "episodes.parquet").to_pylist()
    clean = [row["outcome"] == "success" and row["collisions"] == 0 for row in rows]
    interval = binomtest(sum(clean), len(clean)).proportion_ci(0.95, method="wilson")
    rate = table["summary"]["collision_free_success"]
    assert (rate["low"], rate["high"]) == pytest.approx((interval.low, interval.high), abs=1e-6)
    bound = binomtest(len(clean) - sum(clean), len(clean), alternative="less").proportion_ci(0.95).high
    assert table["summary"]["failure_bound"] == pytest.approx(bound, abs=1e-6)
    assert table["summary"]["means"]["spl"]["mean"] == pytest.approx(np.mean([row["spl"] for row in rows]), abs=1e-6)


def test_stopped_evaluation_goes_on_to_the_same_files(finished: tuple[Path, str], folder: Path, tmp_path: Path) -> None:
    whole, output = finished[0], tmp_path / "eval"
    output.mkdir()
    shutil.copytree(whole / "trails", output / "trails")
    lines = (whole / "episodes.jsonl").read_bytes().splitlines(keepends=True)
    (output / "episodes.jsonl").write_bytes(b"".join(lines[:3]) + lines[3][:40])  # two episodes, and a cut line
    again = ("baseline:reactive", "--scenario", folder, "--episodes", 4, "--seed", 5, "-o", output, "--resume")
    result = aquanav_eval(*again, "--record", "none")
    assert result.returncode == 0, result.stderr
    for name in ("results.json", "episodes.parquet"):
        assert (output / name).read_bytes() == (whole / name).read_bytes()


def test_episodes_of_another_evaluation_are_not_gone_on_with(finished: tuple[Path, str], folder: Path) -> None:
    output = finished[0]
    result = aquanav_eval("baseline:random", "--scenario", folder, "--episodes", 4, "-o", output, "--resume")
    assert result.returncode == 2
    assert "policy (name), seed differ" in result.stderr


def test_replay_repeats_to_the_bit_and_records(finished: tuple[Path, str], tmp_path: Path) -> None:
    result = aquanav_eval("replay", finished[0], "--episode", 2, "-o", tmp_path / "again.rrd")
    assert result.returncode == 0, result.stderr
    assert "Episode 2 repeats to the bit: success" in result.stdout
    assert (tmp_path / "again.rrd").stat().st_size > 10_000


def test_replay_repeats_an_episode_in_a_share_of_the_current(folder: Path, tmp_path: Path) -> None:
    flags = ["--episodes", 1, "--max-decisions", 5, "--record", "none", "--workers", 1, "-o", tmp_path]
    water = ["--current", 0.2, 0, 0, "--grid.current", 0.5]
    assert aquanav_eval("baseline:random", "--scenario", folder, *water, *flags).returncode == 0
    result = aquanav_eval("replay", tmp_path, "--episode", 0)
    assert "Episode 0 repeats to the bit" in result.stdout, result.stderr


@pytest.mark.slow
def test_replay_films_an_episode(folder: Path, tmp_path: Path) -> None:
    flags = ["--episodes", 1, "--max-decisions", 5, "--record", "none", "-o", tmp_path / "eval"]
    assert aquanav_eval("baseline:random", "--scenario", folder, *flags).returncode == 0
    result = aquanav_eval("replay", tmp_path / "eval", "--episode", 0, "--film", tmp_path / "dive.mp4")
    assert result.returncode == 0, result.stderr
    assert f"Film: {tmp_path / 'dive.mp4'}" in result.stdout
    assert (tmp_path / "dive.mp4").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        (("--film", "dive.avi"), "no films like dive.avi"),
        (("--film", "dive.gif", "--view", "chse"), "invalid choice 'chse'"),
    ],
)
def test_a_film_that_cannot_be_made_is_refused_before_the_flight(
    finished: tuple[Path, str], tmp_path: Path, flags: tuple[str, ...], message: str
) -> None:
    result = aquanav_eval("replay", finished[0], "--episode", 0, "-o", tmp_path / "again.rrd", *flags)
    assert result.returncode == 2
    assert message in result.stderr
    assert not (tmp_path / "again.rrd").exists()


def test_recorded_episodes_are_filmed_on_request_and_old_films_go(
    tmp_path: Path, run: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(films.FILM_SIZES, ".webm", (96, 72))  # pictures of full size take seconds
    run("baseline:random", episodes=2, max_decisions=2, record="worst", max_recordings=1, film=True)
    (recording,) = (tmp_path / "eval").glob("*.rrd")
    (film,) = (tmp_path / "eval").glob("*.webm")
    assert film.stem == recording.stem
    assert film.stat().st_size > 1000
    report = (tmp_path / "eval" / "report.html").read_text()
    assert report.count("<video") == 1 and "data:video/webm;base64," in report
    assert report.count('<script type="text/plain">') == 1 and "readGlb" in report  # the trails in 3D
    run("baseline:random", episodes=1, max_decisions=2, record="all")
    assert not list((tmp_path / "eval").glob("*.webm"))


class Broken:
    def __init__(self, act: Callable[[], Any]) -> None:
        self.num_episodes, self._act = 0, act

    def reset(self, seed: int) -> None:
        self.num_episodes += 1

    def act(self, observation: Any) -> Any:
        return self._act() if self.num_episodes == 1 else np.array([1, 1, 2])


@pytest.mark.parametrize(
    ("act", "reason"),
    [
        (lambda: 1 / 0, "ZeroDivisionError"),
        (lambda: np.array([np.nan, 0.0, 0.0]), "got array([nan,  0.,  0.])"),
        (lambda: np.array([7, 0, 0]), "3 choices from 0 to 2"),
        (lambda: time.sleep(60.0), "no action within 0.2 s"),
    ],
)
def test_failing_policy_costs_its_episode_only(tube: Scenario, act: Callable[[], Any], reason: str) -> None:
    env, policy = CaveEnv(tube, max_decisions=5), Broken(act)
    first = run_episode(env, policy, EpisodePlan(0, 0), CallTimeout(0.2))
    second = run_episode(env, policy, EpisodePlan(1, 0), CallTimeout(5.0))
    env.close()
    assert first.outcome == "failed"
    assert reason in first.reason
    assert (second.outcome, second.reason, second.num_decisions) == ("timeout", "", 5)


def test_policy_that_never_acts_fails_every_episode_and_gets_its_report(
    tmp_path: Path, run: Callable[..., Any]
) -> None:
    def load_silent(name: str) -> LoadedPolicy:
        loaded = load_policy(name)
        return dataclasses.replace(loaded, policy=Broken(lambda: 1 / 0))

    table = run("baseline:random", load_silent, episodes=1)
    assert table["episodes"][0]["outcome"] == "failed"
    assert table["summary"]["collision_free_success"]["rate"] == 0.0
    assert "ZeroDivisionError" in (tmp_path / "eval" / "report.html").read_text()
    assert (tmp_path / "eval" / "episode-00000.rrd").is_file()


def test_only_failures_are_recorded_on_request_and_old_recordings_go(tmp_path: Path, run: Callable[..., Any]) -> None:
    run("baseline:random", episodes=2, record="failures", max_recordings=1)
    assert [path.name for path in (tmp_path / "eval").glob("*.rrd")] == ["episode-00000.rrd"]
    run("baseline:reactive", episodes=1, record="failures")
    assert not list((tmp_path / "eval").glob("*.rrd"))


def test_saved_policy_is_evaluated_with_its_hash(tmp_path: Path, run: Callable[..., Any]) -> None:
    make_model(action="discrete", num_observations=31).save(tmp_path / "policy.zip")
    table = run(str(tmp_path / "policy.zip"), episodes=1)
    digest = hashlib.sha256((tmp_path / "policy.zip").read_bytes()).hexdigest()
    path = str(tmp_path / "policy.zip")
    assert table["policy"] == {"name": "policy.zip", "sha256": digest, "path": path, "is_trusted": False}
    assert (table["protocol"]["observation"], table["protocol"]["action"]) == ("paper", "discrete")


def test_folder_of_a_training_run_stands_for_its_best_policy_and_says_so(folder: Path, tmp_path: Path) -> None:
    run = tmp_path / "train"
    run.mkdir()
    make_model(action="discrete", num_observations=31).save(run / "best.zip")
    make_model(action="discrete", num_observations=44).save(run / "policy.zip")
    flags = ("--episodes", 1, "--max-decisions", 3, "--record", "none", "-o", tmp_path / "eval")
    result = aquanav_eval(run, "--scenario", folder, *flags)
    assert result.returncode == 0, result.stderr
    assert f"{run} is a training run's folder. Its best.zip is taken" in result.stdout
    policy = json.loads((tmp_path / "eval" / "results.json").read_text())["policy"]
    assert (policy["name"], policy["path"]) == ("train/best.zip", str(run))
    assert policy["sha256"] == hashlib.sha256((run / "best.zip").read_bytes()).hexdigest()
    again = aquanav_eval("replay", tmp_path / "eval", "--episode", 0)
    assert "repeats to the bit" in again.stdout


def test_folder_without_a_policy_is_refused(folder: Path, tmp_path: Path) -> None:
    result = aquanav_eval(tmp_path, "--scenario", folder, "-o", tmp_path / "eval")
    assert result.returncode == 2
    assert "without best.zip or policy.zip" in result.stderr


def test_contact_ends_the_episode_on_request(run: Callable[..., Any]) -> None:
    table = run("baseline:random", episodes=2, on_collision="end", record="none")
    assert {episode["outcome"] for episode in table["episodes"]} == {"collision"}
    assert table["summary"]["means"]["collisions"]["mean"] == 1.0


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
    assert "cannot be written to: File exists. A file lies where a folder must" in result.stderr
    assert (tmp_path / "eval").read_text() == "mine"


def test_track_holds_the_environments_own_numbers(tube: Scenario) -> None:
    loaded = load_policy("baseline:reactive")
    env = CaveEnv(tube, observation=loaded.observation, action=loaded.action, max_decisions=40)
    trajectory = run_episode(env, loaded.policy, EpisodePlan(seed=2, start_index=4))
    env.close()
    assert trajectory.outcome == "timeout"
    assert trajectory.num_decisions == 40
    assert trajectory.times[-1] == pytest.approx(4.0)
    np.testing.assert_allclose(trajectory.positions[0], tube.starts[4].pose.position)
    np.testing.assert_allclose(sum(trajectory.reward_terms.values()), trajectory.rewards, rtol=1e-5)  # float32
    assert (
        np.unique(trajectory.positions, axis=0).shape == trajectory.positions.shape
    )  # states are kept, not a reused buffer


def test_a_hull_that_overlaps_a_wall_by_less_than_the_last_digit_is_shown_as_touching_it() -> None:
    assert [metres(value) for value in (-0.0004, 0.0, 0.004, -0.006, 1.236)] == [
        "0.00",
        "0.00",
        "0.00",
        "-0.01",
        "1.24",
    ]
