"""Evaluations in several processes: the same results, and trouble that costs one episode."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from aquanav_tools.evaluate.evaluation import evaluate
from aquanav_tools.evaluate.options import EvaluateOptions
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import Scenario
from tests.evaluate.policies import ONCE, Drifting, load_bad

NUM_EPISODES = 7


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, tube: Scenario) -> Path:
    path = tmp_path_factory.mktemp("scenario") / "tube"
    write_scenario(tube, path)
    return path


@pytest.fixture
def run(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Return a function that evaluates a policy by the kind of its trouble and returns the output folder."""
    monkeypatch.setattr("aquanav_tools.report.picture.DPI", 20)
    monkeypatch.setenv(ONCE, str(tmp_path / "once"))

    def evaluate_here(kind: str, workers: int, **options: Any) -> Path:
        output = tmp_path / f"{kind}-{workers}"
        rules: dict[str, Any] = {"max_decisions": 30, "record": "failures", "max_recordings": 3, **options}
        choices = EvaluateOptions((kind,), (folder,), output, episodes=NUM_EPISODES, workers=workers, **rules)
        evaluate(choices, lambda done, total: None, load=load_bad)
        return output

    return evaluate_here


def episodes(folder: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads((folder / "results.json").read_text())["episodes"]
    return found


def test_any_number_of_processes_gives_the_same_files(run: Callable[..., Path]) -> None:
    one, three = run("none", 1), run("none", 3)
    for name in ("results.json", "episodes.parquet"):
        assert (one / name).read_bytes() == (three / name).read_bytes()
    recordings = [sorted(path.name for path in output.glob("*.rrd")) for output in (one, three)]
    assert recordings == [[f"episode-{index:05d}.rrd" for index in range(3)]] * 2


def test_killed_process_costs_no_episode(run: Callable[..., Path]) -> None:
    assert episodes(run("dies once", 2)) == episodes(run("none", 1))


@pytest.mark.parametrize(
    ("kind", "reason"),
    [
        ("raises", "ValueError: no idea, says <object object>"),
        ("gives no number", "not finite"),
        ("dies", "its process was ended by SIGKILL, twice"),
        ("hangs", "gave no action within 1 s"),
    ],
)
def test_trouble_costs_its_episodes_only(run: Callable[..., Path], kind: str, reason: str) -> None:
    output = run(kind, 2, action_time_limit=1.0, record="none")
    failed = [episode for episode in episodes(output) if episode["outcome"] == "failed"]
    assert [episode["seed"] for episode in failed] == list(Drifting.TROUBLE)
    assert all(reason in episode["reason"] for episode in failed)
    assert reason.split("<")[0] in (output / "report.html").read_text()


def test_progress_counts_every_episode_once(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("aquanav_tools.report.picture.DPI", 20)
    told: list[tuple[int, int]] = []
    choices = EvaluateOptions(("none",), (folder,), tmp_path, episodes=4, workers=2, max_decisions=5, record="none")
    evaluate(choices, lambda done, total: told.append((done, total)), load=load_bad)
    assert told == [(done, 4) for done in range(5)]
    evaluate(dataclasses.replace(choices, resume=True), lambda done, total: told.append((done, total)), load=load_bad)
    assert told[5:] == [(4, 4)]
