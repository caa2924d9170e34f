"""Evaluations in several processes: the same results, and trouble that costs one episode."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from aquanav_tools.evaluate.evaluation import evaluate
from aquanav_tools.evaluate.options import EvaluateOptions
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import Scenario
from tests.evaluate.policies import ONCE, TROUBLE, load_drifting

NUM_EPISODES = 8
BAD = {1: "raises", 3: "gives no number", 4: "dies", 6: "hangs"}
REASONS = {
    1: "ValueError: no idea, says <object object>",
    3: "ValueError: it gave array([nan, nan, nan]), which is not finite",
    4: "its process was ended by SIGKILL, twice",
    6: "gave no action within 1 s",
}

Run = Callable[..., tuple[Path, list[tuple[int, int]]]]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory, tube: Scenario) -> Run:
    """Return a function that evaluates a policy with trouble; it returns the folder and what the progress bar heard."""
    folder = tmp_path_factory.mktemp("scenario") / "tube"
    write_scenario(tube, folder)

    def evaluate_here(workers: int, trouble: str) -> tuple[Path, list[tuple[int, int]]]:
        output, told = tmp_path_factory.mktemp("eval"), []
        choices = EvaluateOptions(
            ("drifting",), (folder,), output, episodes=NUM_EPISODES, workers=workers, max_decisions=30,
            record="failures", max_recordings=3, action_time_limit=1.0,
        )  # fmt: skip
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("aquanav_tools.report.picture.DPI", 20)
            patch.setenv(TROUBLE, trouble)
            patch.setenv(ONCE, str(output / "once"))
            evaluate(choices, lambda done, total: told.append((done, total)), load=load_drifting)
        return output, told

    return evaluate_here


@pytest.fixture(scope="module")
def calm(run: Run) -> Path:
    """An evaluation in this process."""
    return run(1, "")[0]


def test_three_processes_of_which_one_is_killed_give_the_files_of_one(run: Run, calm: Path) -> None:
    output, told = run(3, "5 dies once")
    assert (output / "once").exists()
    assert told == [(done, NUM_EPISODES) for done in range(NUM_EPISODES + 1)]
    for name in ("results.json", "episodes.parquet"):
        assert (output / name).read_bytes() == (calm / name).read_bytes()
    first = [f"episode-{index:05d}.rrd" for index in range(3)]  # all fail, for want of time; three are recorded
    assert [sorted(path.name for path in folder.glob("*.rrd")) for folder in (output, calm)] == [first, first]


def test_policy_that_raises_gives_nonsense_dies_or_hangs_costs_these_episodes_only(run: Run, calm: Path) -> None:
    output, _ = run(2, ",".join(f"{seed} {kind}" for seed, kind in BAD.items()))
    found, wanted = (_episodes(folder) for folder in (output, calm))
    assert {row["seed"]: row["reason"] for row in found if row["outcome"] == "failed"} == REASONS
    assert [row for row in found if row["seed"] not in BAD] == [row for row in wanted if row["seed"] not in BAD]
    report = (output / "report.html").read_text()
    assert all(reason.split("<")[0] in report for reason in REASONS.values())


def _episodes(folder: Path) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads((folder / "results.json").read_text())["episodes"]
    return found
