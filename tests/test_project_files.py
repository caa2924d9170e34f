"""What a project's visitors look at says the same as the project."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

import aquanav_tools
from aquanav_tools.synthetic.styles.names import STYLE_NAMES
from tests.conftest import REPOSITORY
from tests.project import pyproject

NUMBERS = {10: "ten", 11: "eleven", 12: "twelve"}


def text_of(name: str) -> str:
    return (REPOSITORY / name).read_text(encoding="utf-8")


def test_the_citation_has_the_version_and_the_licence() -> None:
    citation = text_of("CITATION.cff")
    assert re.findall(r"^version: (.+)$", citation, re.M) == [aquanav_tools.__version__]
    assert re.findall(r"^license: (.+)$", citation, re.M) == [pyproject()["project"]["license"]]


def test_the_changes_name_the_version_and_count_what_there_is() -> None:
    changes = text_of("CHANGELOG.md")
    assert aquanav_tools.__version__ in changes
    assert f"in {NUMBERS[len(STYLE_NAMES)]} styles" in changes


def test_hosted_runs_call_scripts_that_are_there() -> None:
    called = re.findall(r"run: (\.ci/[a-z-]+)", text_of(".github/workflows/ci.yml"))
    assert set(called) == {".ci/run", ".ci/extras", ".ci/newest", ".ci/lowest"}
    assert all((REPOSITORY / script).stat().st_mode & 0o100 for script in called)
    versions = re.findall(r'"(3\.\d+)"', text_of(".github/workflows/ci.yml"))
    assert {"3.10", "3.11", "3.12", "3.13", "3.14"} <= set(versions)


@pytest.mark.parametrize("given", ["9.9.9", ""])
def test_a_release_that_is_not_ready_is_refused_before_anything_is_built(given: str) -> None:
    dist = REPOSITORY / "dist"
    before = dist.exists()
    done = subprocess.run([REPOSITORY / ".ci/release", *given.split()], capture_output=True, text=True)
    assert done.returncode != 0
    said = "There are changes that are not committed|has another version than 9.9.9" if given else "Which version"
    assert re.search(said, done.stderr), done.stderr
    assert dist.exists() == before


def test_users_see_our_types() -> None:
    """PEP 561: without this file checkers take all of the package for Any."""
    code = "import importlib.resources as r; print(r.files('aquanav_tools').joinpath('py.typed').is_file())"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "True\n"


def test_the_paper_cites_what_its_bibliography_has_and_nothing_else() -> None:
    cited = set(re.findall(r"\[-?@([a-z0-9]+)\]", text_of("paper/paper.md")))
    assert cited == set(re.findall(r"^@\w+\{([a-z0-9]+),", text_of("paper/paper.bib"), re.M))
