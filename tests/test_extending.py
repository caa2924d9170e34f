"""docs/extending.md keeps its word: a reward of 15 lines and a sensor of 25, trained with and evaluated."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import pytest

from aquanav_tools.cli.evaluate import main as evaluate
from aquanav_tools.cli.train import main as train
from aquanav_tools.envs.batch_view import ARRAYS
from aquanav_tools.evaluate.results import read_results
from tests.commands import run_here
from tests.test_docs import modules, text, working_directory

__all__ = ["working_directory"]
PAGE = "docs/extending.md"
TINY = {
    "aquanav-train": "--steps 256 --n-steps 16 --num-envs 8 --hidden 8 --final-episodes 0",
    "aquanav-eval": "--episodes 3 --max-decisions 30 --record none",
}
MAINS = {"aquanav-train": train, "aquanav-eval": evaluate}


@pytest.mark.parametrize(("name", "limit"), [("smooth.py", 15), ("compass.py", 25)])
def test_the_examples_are_short(name: str, limit: int) -> None:
    assert len([line for line in modules(PAGE)[name].splitlines() if line]) <= limit


def test_every_command_of_the_page_does_what_it_says(working_directory: Path) -> None:
    for name, code in modules(PAGE).items():
        (working_directory / name).write_text(code)
    shown = re.findall(r"^    (aquanav-(?:train|eval) .*)$", text(PAGE), re.M)
    for line in shown:
        command, *words = shlex.split(line)
        done = run_here(MAINS[command], *words, *TINY[command].split())
        assert done.returncode == 0, done.stderr
    assert len(shown) == 6
    protocol = read_results(Path("out/score/results.json"))["protocol"]
    assert (protocol["reward"], protocol["sensors"]) == ("smooth:Smooth", ["compass:Compass"])
    assert read_results(Path("out/eval/results.json"))["protocol"]["observation"] == "others:Nearest"


def test_the_page_lists_all_arrays() -> None:
    listed = dict(re.findall(r"^\| `(\w+)` \| (\(N.*) \|$", text(PAGE), re.M))
    assert listed == ARRAYS
