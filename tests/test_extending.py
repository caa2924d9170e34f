"""What the docs say of code of one's own holds: a reward of 15 lines and a sensor of 25, trained with and evaluated."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from aquanav_tools.envs.batch_view import ARRAYS
from aquanav_tools.evaluate.results import read_results
from tests.pages import blocks, modules, text
from tests.test_docs_run import folder, materials, run

__all__ = ["folder", "materials"]
TUTORIAL, PAGE = "docs/tutorial-own.md", "docs/extending.md"


@pytest.mark.parametrize(("name", "limit"), [("smooth.py", 15), ("compass.py", 25)])
def test_the_examples_are_short(name: str, limit: int) -> None:
    assert len([line for line in modules(TUTORIAL)[name].splitlines() if line]) <= limit


def test_what_was_scored_says_whose_reward_and_sensor_it_was(folder: Path) -> None:
    for name, code in modules(TUTORIAL).items():
        (folder / name).write_text(code)
    shown = next(block for block in blocks(TUTORIAL) if "smooth:Smooth" in block.code and block.language == "bash")
    run(TUTORIAL, shown, folder)
    protocol = read_results(Path("out/score/results.json"))["protocol"]
    assert (protocol["reward"], protocol["sensors"]) == ("smooth:Smooth", ["compass:Compass"])


def test_the_page_lists_all_arrays() -> None:
    listed = dict(re.findall(r"^\| `(\w+)` \| (\(N.*) \|$", text(PAGE), re.M))
    assert listed == ARRAYS
