"""Cards of policies say what the file and its own evaluations hold, and refuse those of another file."""

from __future__ import annotations

import functools
import hashlib
import json
import zipfile
from pathlib import Path

import pytest

from aquanav_tools.cli.evaluate import main as evaluate
from aquanav_tools.cli.info import main
from tests.commands import run_here
from tests.conftest import REPOSITORY

aquanav = functools.partial(run_here, main)
ZIP = REPOSITORY / "eval" / "policies" / "reference.zip"


@pytest.fixture(scope="module")
def evaluation(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("evaluated")
    flags = ("--episodes", 4, "--workers", 1, "--record", "none", "-o", output)
    assert run_here(evaluate, "baseline:reference", "--scenario", folder, *flags).returncode == 0
    return output


def failing(evaluation: Path, output: Path, starts: tuple[int, ...]) -> Path:
    """Write results in which the episodes from some of the starts touched the wall."""
    table = json.loads((evaluation / "results.json").read_text())
    for number, episode in enumerate(table["episodes"]):
        episode["start"], episode["collisions"] = number, int(number in starts)
    output.mkdir()
    (output / "results.json").write_text(json.dumps(table))
    return output


def test_the_card_says_what_file_and_evaluation_hold(evaluation: Path, tmp_path: Path) -> None:
    card = tmp_path / "cards" / "reference.md"
    folder = failing(evaluation, tmp_path / "results", (1, 3))
    result = aquanav("card", "baseline:reference", "--evaluations", folder, "-o", card)
    assert result.returncode == 0, result.stderr
    text = card.read_text()
    with zipfile.ZipFile(ZIP) as archive:
        steps = json.loads(archive.read("data"))["num_timesteps"]
    assert f"| learned from, in its last lesson | {steps:,} decisions |" in text
    assert "| observes | full" in text and "| acts | multidiscrete |" in text
    assert "hidden layers of 128, 128, 128" in text
    for path in (ZIP, ZIP.with_suffix(".onnx")):
        assert f"| SHA-256 of {path.name} | {hashlib.sha256(path.read_bytes()).hexdigest()} |" in text
    assert "50 % [15, 85]" in text  # Wilson's interval of 2 of 4 by hand
    assert "In 2 of 4 episodes, 50 %: touched 2." in text
    assert "start 1: 1 of them" in text and "start 2" not in text


def test_without_evaluations_the_card_says_so() -> None:
    printed = aquanav("card", ZIP).stdout
    assert "No evaluation was given." in printed and "Where it fails" not in printed


def test_evaluations_of_another_file_and_programs_are_refused(evaluation: Path, tmp_path: Path) -> None:
    other = aquanav("card", "baseline:boat-safe", "--evaluations", evaluation)
    assert other.returncode == 2 and "another file. Evaluate this one." in other.stderr
    assert "no Stable-Baselines3 zip" in aquanav("card", "baseline:reactive").stderr
    missing = aquanav("card", ZIP, "--evaluations", tmp_path / "nowhere")
    assert missing.returncode == 2 and "nowhere" in missing.stderr
    (tmp_path / "file").write_text("")
    blocked = aquanav("card", ZIP, "-o", tmp_path / "file" / "card.md")
    assert blocked.returncode == 2 and "Choose another with -o" in blocked.stderr


@pytest.mark.parametrize(
    "name", ["boat-safe", "boat-standard", "reference", "reference-echosounders", "reference-waypoint"]
)
def test_shipped_cards_are_of_the_shipped_files(name: str) -> None:
    """The table of what a policy is, made anew, is in its card to the letter."""
    facts = aquanav("card", ZIP.with_name(f"{name}.zip")).stdout.split("\n## ")[0].split("\n\n", 1)[1]
    card = (ZIP.parent / f"{name}.md").read_text()
    assert facts in card
    assert ("start drawn anew" in card) == name.startswith("boat")
    assert "start -1" not in card
