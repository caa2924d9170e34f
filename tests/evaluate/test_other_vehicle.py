"""An evaluation with another vehicle than the scenario's: what it writes down, and who goes by that."""

from __future__ import annotations

import functools
import json
from pathlib import Path

import pytest

from aquanav_tools.cli.evaluate import main
from aquanav_tools.evaluate.results import check_results
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import LimitSettings
from tests.caves import tube_scenario
from tests.commands import run_here
from tests.vehicles import write_vehicle

aquanav_eval = functools.partial(run_here, main)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the tube, a long vehicle, and an evaluation of it in out."""
    folder = tmp_path_factory.mktemp("vehicles")
    write_scenario(tube_scenario(limits=LimitSettings(decisions=300)), folder / "tube")
    write_vehicle(folder / "long.toml", 0.2, 5.0)
    done = aquanav_eval(*words(folder, "out"), "--vehicle", folder / "long.toml")
    assert done.returncode == 0, done.stderr
    return folder


def words(folder: Path, output: str) -> list[object]:
    short = ["--episodes", 3, "--record", "none", "--workers", 1]
    return ["baseline:reactive", "--scenario", folder / "tube", *short, "-o", folder / output]


def test_results_name_the_vehicle_and_the_starts_that_are_left_out(finished: Path) -> None:
    table = json.loads((finished / "out" / "results.json").read_text())
    check_results(table)
    vehicle = table["scenarios"][0]["vehicle"]
    assert (vehicle["name"], vehicle["path"]) == ("long", str(finished / "long.toml"))
    assert vehicle["left_out"] == [0, 1, 2, 3]
    assert max(episode["start"] for episode in table["episodes"]) < 16
    page = (finished / "out" / "report.html").read_text()
    assert "--vehicle" in page and "does not fit at the starts 0, 1, 2, 3" in page


def test_the_vehicle_flies_again_in_a_replay(finished: Path) -> None:
    done = aquanav_eval("replay", finished / "out", "--episode", 1)
    assert done.returncode == 0, done.stderr
    assert "repeats to the bit" in done.stdout


def test_a_replay_refuses_another_vehicle(finished: Path) -> None:
    done = aquanav_eval("replay", finished / "out", "--episode", 1, "--vehicle", "bluerov2")
    assert done.returncode == 2
    assert "The vehicle of the scenario is another one than was evaluated" in done.stderr


def test_going_on_with_another_vehicle_is_refused(finished: Path) -> None:
    done = aquanav_eval(*words(finished, "out"), "--resume")
    assert done.returncode == 2
    assert "are of another evaluation: scenarios differ" in done.stderr


def test_evaluations_of_different_vehicles_are_not_compared(finished: Path) -> None:
    assert aquanav_eval(*words(finished, "own")).returncode == 0
    done = aquanav_eval("compare", finished / "out", finished / "own", "-o", finished / "compare")
    assert done.returncode == 2
    assert "Different vehicles dived tube: long (" in done.stderr and "its own vehicle with" in done.stderr


def test_a_hull_that_does_not_fit_is_refused_before_anything_flies(finished: Path) -> None:
    done = aquanav_eval(*words(finished, "none"), "--vehicle", "boat")
    assert done.returncode == 2
    assert "9.40 m long, 3.09 m wide" in done.stderr
    assert not (finished / "none").exists()
