"""Evaluations in several processes: the same results, trouble that costs one episode, and kills that cost none."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.evaluation import evaluate
from aquanav_tools.evaluate.options import EvaluateOptions
from aquanav_tools.types import ignore_progress
from tests.evaluate.policies import ONCE, TROUBLE, drifting_options, line_of, load_drifting
from tests.lighter import lighten_reports

NUM_EPISODES = 8
BAD = {1: "raises", 3: "gives no number", 4: "dies", 6: "hangs"}
REASONS = {
    1: f"ValueError: no idea, says <object object> (policies.py, line {line_of('no idea')})",
    3: "InputError: An action must be 3 choices from 0 to 2, got array([nan, nan, nan]).",
    4: "its process was ended by SIGKILL, twice",
    6: "gave no action within 1 s",
}
NUM_KILLS = 10

Run = Callable[..., list[tuple[int, int]]]


@pytest.fixture(scope="module")
def run() -> Run:
    """Return a function that evaluates a policy with trouble and returns what the progress bar heard."""

    def evaluate_here(options: EvaluateOptions, trouble: str = "") -> list[tuple[int, int]]:
        told: list[tuple[int, int]] = []
        with pytest.MonkeyPatch.context() as patch:
            lighten_reports(patch)
            patch.setenv(TROUBLE, trouble)
            patch.setenv(ONCE, str(options.output / "once"))
            evaluate(options, lambda done, total: told.append((done, total)), load=load_drifting)
        return told

    return evaluate_here


@pytest.fixture(scope="module")
def calm(run: Run, folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """An evaluation in this process."""
    output = tmp_path_factory.mktemp("calm")
    run(drifting_options(folder, output, episodes=NUM_EPISODES, workers=1))
    return output


def test_policy_that_raises_gives_nonsense_dies_or_hangs_costs_these_episodes_only(
    run: Run, folder: Path, tmp_path: Path, calm: Path
) -> None:
    trouble = ["5 dies once", *(f"{seed} {kind}" for seed, kind in BAD.items())]
    told = run(drifting_options(folder, tmp_path, episodes=NUM_EPISODES, workers=2), ",".join(trouble))
    assert (tmp_path / "once").exists()  # a process was killed over episode 5, which is as it was all the same
    assert told == [(done, NUM_EPISODES) for done in range(NUM_EPISODES + 1)]
    found, wanted = (_episodes(output) for output in (tmp_path, calm))
    assert {row["seed"]: row["reason"] for row in found if row["outcome"] == "failed"} == REASONS
    assert [row for row in found if row["seed"] not in BAD] == [row for row in wanted if row["seed"] not in BAD]
    report = (tmp_path / "report.html").read_text()
    assert all(reason.split("<")[0] in report for reason in REASONS.values())


def test_evaluation_killed_and_gone_on_with_in_two_processes_gives_the_files_of_one_that_ran_alone(
    run: Run, folder: Path, tmp_path: Path, calm: Path
) -> None:
    options = drifting_options(folder, tmp_path, episodes=NUM_EPISODES, workers=2)
    process = begin(options)
    wait_until(lambda: process.poll() is not None or len(_lines(tmp_path)) > 2)
    assert process.poll() is None
    kill(process)
    # As if killed when an episode was recorded and not written down yet.
    (tmp_path / f"episode-{NUM_EPISODES - 1:05d}.rrd").touch()
    assert run(dataclasses.replace(options, resume=True))[-1] == (NUM_EPISODES, NUM_EPISODES)
    assert_same_files(tmp_path, calm)


@pytest.mark.slow
@pytest.mark.nightly  # one kill of an evaluation, at a set moment, is in the default tests
def test_ten_kills_at_random_moments_change_nothing(
    run: Run, folder: Path, tmp_path: Path, rng: np.random.Generator
) -> None:
    whole, output = tmp_path / "whole", tmp_path / "killed"
    many: dict[str, Any] = {"episodes": 60, "workers": 2}
    clock = time.monotonic()
    assert begin(drifting_options(folder, whole, **many)).wait() == 0
    duration = time.monotonic() - clock
    for _ in range(NUM_KILLS):
        process = begin(drifting_options(folder, output, resume=True, **many))
        time.sleep(rng.uniform(0.1, 0.7) * duration)
        kill(process)
    assert begin(drifting_options(folder, output, resume=True, **many)).wait() == 0
    assert_same_files(output, whole)


def test_second_evaluation_into_the_same_folder_is_refused_with_who_holds_it(folder: Path, tmp_path: Path) -> None:
    process = begin(drifting_options(folder, tmp_path, episodes=1000, workers=1))
    try:
        wait_until(lambda: (tmp_path / "episodes.jsonl").exists())
        before = sorted(path.name for path in tmp_path.glob("episode*"))
        for is_resumed in (False, True):
            options = drifting_options(folder, tmp_path, episodes=1000, workers=1, resume=is_resumed)
            with pytest.raises(
                InputError, match=f"Another process is at work in .*: process {process.pid} on .* since"
            ):
                evaluate(options, ignore_progress, load=load_drifting)
        assert process.poll() is None
        assert set(before) <= {path.name for path in tmp_path.glob("episode*")}
    finally:
        kill(process)
    options = drifting_options(folder, tmp_path, episodes=2, workers=1)
    assert len(evaluate(options, ignore_progress, load=load_drifting).episodes) == 2
    assert not (tmp_path / "lock").exists()


def begin(options: EvaluateOptions) -> subprocess.Popen[bytes]:
    """Start an evaluation in a process of its own."""
    choices = {"episodes": options.episodes, "workers": options.workers, "resume": options.resume}
    command = [sys.executable, "-m", "tests.evaluate.policies", options.scenario[0], options.output]
    return subprocess.Popen([*map(str, command), json.dumps(choices)], start_new_session=True)


def kill(process: subprocess.Popen[bytes]) -> None:
    """Kill an evaluation, not its workers: these end by themselves."""
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    wait_until(lambda: not _group_lives(process.pid))


def wait_until(is_so: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 300.0  # a busy machine may give a process a twentieth of a core
    while not is_so():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def assert_same_files(one: Path, other: Path) -> None:
    for name in ("results.json", "episodes.parquet"):
        assert (one / name).read_bytes() == (other / name).read_bytes()
    first = [f"episode-{index:05d}.rrd" for index in range(3)]  # all fail, for want of time; three are recorded
    assert [sorted(path.name for path in output.glob("*.rrd*")) for output in (one, other)] == [first, first]
    assert not list(one.rglob("*.partial"))


def _group_lives(group: int) -> bool:
    try:
        os.killpg(group, 0)
    except ProcessLookupError:
        return False
    return True


def _lines(output: Path) -> list[bytes]:
    path = output / "episodes.jsonl"
    return path.read_bytes().splitlines() if path.exists() else []


def _episodes(output: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads((output / "results.json").read_text())["episodes"]
    return found
