"""What README and docs/ show runs: each page's blocks from top to bottom in one folder, with less to do in each."""

from __future__ import annotations

import importlib
import re
import shlex
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import aquanav
from aquanav_tools.benchmark.definition import read_benchmark
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.sim.batch.sensors.fan import RangeFan
from aquanav_tools.sim.batch.sensors.inertial import InertialUnit
from aquanav_tools.sim.randomisation import read_randomisation
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.synthetic.caves import tube
from tests.build.test_survey_build import survey_of_a_tube
from tests.commands import run_here
from tests.conftest import REPOSITORY
from tests.lighter import lighten_builds, lighten_reports
from tests.pages import BUILDERS_PAGES, PAGES, USERS_PAGES, Block, blocks, modules, text
from tests.project import commands
from tests.sim.test_water import flowing

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

LANGUAGES = {"bash", "python", "toml", "text"}
LESS = {
    "aquanav-build-cave": "--starts.count 4 --overwrite",
    "aquanav-train": "--steps 256 --n-steps 16 --num-envs 8 --hidden 8 --final-episodes 0",
    "aquanav-eval": "--episodes 3 --workers 1 --max-decisions 30 --record none",
    "aquanav-eval compare --sequential": "--episodes 6 --block 3 --workers 1 --max-decisions 30",
    "aquanav-eval compare": "",
    "aquanav-eval replay": "",
    "aquanav-eval stress": "--budget 4 --workers 1 --max-decisions 30",
    "aquanav-eval --benchmark": "--workers 1",
    "aquanav": "",
}
"""Options behind those that are shown, so that a command does the same, but less of it."""
IN_PLACE_OF = {
    "cave-test-1": "caves/mine",
    "cave-test-3": "caves/mine",
    "--episode 17": "--episode 1",
    "--benchmark SET": "--benchmark set.toml",
}
"""What is built in a minute, or is the reader's own, and what stands for it here."""
READERS: dict[str, Callable[[Any], Any]] = {
    "own.toml": read_randomisation,
    "fan.toml": RangeFan,
    "imu.toml": InertialUnit,
    "mine.toml": load_vehicle,
    "set.toml": lambda path: read_benchmark(str(path)),
}
"""By the names of the files that pages show. A block without a name is part of a file, and is read as TOML alone."""
SLOW = {"docs/own-cave.md", "docs/tutorial-scan.md", "docs/tutorial-survey.md"}
"""Pages that build several caves, or large ones."""
OTHERS = {"docs/tutorial-export.md": ["mujoco"]}
"""Libraries that pages show and aquanav does not need; with Python 3.11 or newer they come with what tests need."""
RUN = [
    pytest.param(page, marks=pytest.mark.slow if page in SLOW else ())
    for page in USERS_PAGES
    if any(not block.reason for block in blocks(page))
]


@pytest.fixture(scope="module")
def materials(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what readers have: a cave, a scan, a survey, a trained policy and its evaluation."""
    folder = tmp_path_factory.mktemp("materials")
    for name in ("mine", "other"):
        write_scenario(flowing(), folder / "caves" / name)
    tube(1.2, 6.0, sections=32, rings=31).mesh.to_trimesh().apply_scale(100.0).export(folder / "scan.stl")
    survey_of_a_tube(folder / "survey.svx")
    cave, run = folder / "caves" / "mine", folder / "out" / "train"
    with pytest.MonkeyPatch.context() as patch:
        lighten_reports(patch)
        aquanav.train(cave, steps=256, n_steps=16, num_envs=8, hidden=(8,), final_episodes=0, output=run)
        less: dict[str, Any] = {"episodes": 3, "max_decisions": 30, "record": "none", "workers": 1}
        aquanav.evaluate(run, cave, output=folder / "out" / "eval", **less)
    for name in ("policy.zip", "a.zip", "b.zip"):
        shutil.copy(run / "policy.zip", folder / name)
    shutil.copy(run / "policy.onnx", folder)
    return folder


@pytest.fixture
def folder(materials: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of it to work in, from which modules are imported and forgotten again."""
    shutil.copytree(materials, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    lighten_builds(monkeypatch)
    yield tmp_path
    for path in tmp_path.glob("*.py"):
        sys.modules.pop(path.stem, None)


@pytest.mark.parametrize("page", RUN)
def test_what_a_page_shows_runs_from_top_to_bottom(page: str, folder: Path) -> None:
    for name, code in {**modules("docs/tutorial-own.md"), **modules(page)}.items():
        (folder / name).write_text(code, encoding="utf-8")
    if re.search(r"(-o |output=\")out/train\b", text(page)):
        shutil.rmtree(folder / "out" / "train")  # which the page makes
    for library in OTHERS.get(page, ()):
        pytest.importorskip(library, reason=f"{page} shows it: pip install {library}.")
    for block in blocks(page):
        if not block.reason:
            run(page, block, folder)


def run(page: str, block: Block, folder: Path) -> None:
    """Run a block of a page; files are read as what they are."""
    if block.language == "python":
        exec(compile(block.code, page, "exec"), {"__name__": "__main__"})
    elif block.language == "toml":
        tomllib.loads(block.code)
        if block.file_name:
            READERS[block.file_name](folder / block.file_name)
    elif block.language == "bash":
        for line in block.code.splitlines():
            run_line(line)


def run_line(line: str) -> None:
    """Run a command as it is shown, but with less to do."""
    for shown, small in IN_PLACE_OF.items():
        line = line.replace(shown, small)
    words = shlex.split(line, comments=True)
    assert words and words[0] in commands(), f"no command of aquanav's, so say why it is not run: {line}"
    module, function = commands()[words[0]].split(":")
    done = run_here(getattr(importlib.import_module(module), function), *words[1:], *LESS[kind(words)].split())
    assert done.returncode == 0, f"{line}\n{done.stderr}"


def kind(words: list[str]) -> str:
    """Return the longest key of LESS whose words a command line has: the first in its place, the others anywhere."""
    fitting = [key for key in LESS if key.split()[0] == words[0] and set(key.split()) <= set(words)]
    return max(fitting, key=len)


@pytest.mark.parametrize("page", USERS_PAGES)
def test_every_block_says_what_it_is_and_why_it_is_not_run(page: str) -> None:
    assert {block.language for block in blocks(page)} <= LANGUAGES
    assert [block for block in blocks(page) if block.reason and len(block.reason.split()) < 3] == []
    assert text(page).count("<!-- not run:") == sum(bool(block.reason) for block in blocks(page))
    assert not re.search(r"(?:\A|\n)\n    \S", re.sub(r"^```.*?^```", "", text(page), flags=re.M | re.S))
    assert {block.file_name for block in blocks(page) if block.language == "toml"} - {""} <= set(READERS)


def test_nothing_of_a_page_is_left_out_by_its_place() -> None:
    """Pages about the project alone are not run: contributing, changes, conduct, security."""
    left_out = {*PAGES} - {*USERS_PAGES} - {*BUILDERS_PAGES}
    expected = {"CHANGELOG.md", "CODE_OF_CONDUCT.md", "CONTRIBUTING.md", "SECURITY.md"}
    assert left_out == expected
    assert (REPOSITORY / "docs" / "start.md").is_file()
