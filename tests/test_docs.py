"""README and docs keep their word: snippets run, links lead somewhere, commands and make targets exist."""

from __future__ import annotations

import functools
import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from aquanav_tools.scenario.folder import write_scenario
from tests.caves import tube_scenario
from tests.commands import run_here
from tests.conftest import REPOSITORY
from tests.project import commands

PAGES = sorted(
    path.relative_to(REPOSITORY).as_posix()
    for folder in (".", "docs", "examples")
    for path in REPOSITORY.glob(f"{folder}/*.md")
)
MAX_README_LINES = 110
"""The README is for the first five minutes; everything else has a page by task."""

SUBCOMMANDS = {
    *(("aquanav-eval", name) for name in ("compare", "replay", "stress")),
    *(
        ("aquanav", name)
        for name in (
            "info",
            "doctor",
            "list",
            "render",
            "import-original",
            "water-impact",
            "scenarios",
            "generate",
            "leaderboard",
            "card",
            "export",
        )
    ),
}
"""Words that choose what a command does."""


def text(page: str) -> str:
    """Return a page."""
    return (REPOSITORY / page).read_text(encoding="utf-8")


def snippets() -> list[tuple[str, str]]:
    """Return (page, code) of every Python block."""
    return [(page, code) for page in PAGES for code in re.findall(r"^```python\n(.*?)^```", text(page), re.M | re.S)]


def modules(page: str) -> dict[str, str]:
    """Return the Python blocks of a page that begin with the name of a file, by that name."""
    found = [re.match(r"# (\w+\.py)\n", code) for name, code in snippets() if name == page]
    return {match[1]: match.string for match in found if match}


@pytest.fixture
def working_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty one with a cave, from which modules are imported and forgotten again."""
    write_scenario(tube_scenario(), tmp_path / "caves" / "mine")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [path for path in sys.path if path])
    yield tmp_path
    for path in tmp_path.glob("*.py"):
        sys.modules.pop(path.stem, None)


@pytest.mark.parametrize(("page", "code"), snippets())
def test_every_python_snippet_runs(page: str, code: str, working_directory: Path) -> None:
    for name, text in modules(page).items():
        (working_directory / name).write_text(text)
    exec(compile(code, page, "exec"), {"__name__": "__main__"})


@pytest.mark.parametrize("page", PAGES)
def test_every_path_a_page_links_to_exists(page: str) -> None:
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text(page))
    assert [link for link in links if not (REPOSITORY / page).parent.joinpath(link).exists()] == []


@pytest.mark.parametrize("page", PAGES)
def test_every_heading_a_page_links_to_exists(page: str) -> None:
    for target, heading in re.findall(r"\]\(([^)#:]*)#([^)]+)\)", text(page)):
        linked = (REPOSITORY / page).parent / target if target else REPOSITORY / page
        titles = re.findall(r"^#+ (.+)$", linked.read_text(encoding="utf-8"), re.M)
        assert heading in [re.sub(r"[^\w\- ]", "", title).strip().lower().replace(" ", "-") for title in titles]


@pytest.mark.parametrize("page", PAGES)
def test_every_command_a_page_shows_exists(page: str) -> None:
    shown = set(re.findall(r"^\s*(?:\.venv/bin/)?(aquanav[a-z-]*)\b", text(page), re.M))
    assert shown <= set(commands())


@pytest.mark.parametrize("page", PAGES)
def test_every_option_a_page_shows_exists(page: str) -> None:
    wrong = set()
    for command, rest in re.findall(r"\b(aquanav(?:-[a-z]+)*)((?: [^\n`#]*)?)", text(page)):
        words = rest.split()
        has_subcommand = bool(words) and (command, words[0]) in SUBCOMMANDS
        mode = "--benchmark=quick" if "--benchmark" in words else ""
        known = help_text(command, words[0] if has_subcommand else mode)
        if words[:2] == ["compare", "--sequential"]:
            known += help_text(command, "compare", "--sequential")
        wrong |= {(command, word) for word in words if re.fullmatch("--[a-z][a-z.-]*", word) and word not in known}
    assert wrong == set()


@functools.cache
def help_text(command: str, *modes: str) -> str:
    """Return what a command says of itself: with its subcommand, or the option of a mode of its own."""
    module, function = commands()[command].split(":")
    words = [*filter(None, modes), "--help"]
    return run_here(getattr(importlib.import_module(module), function), *words).stdout


@pytest.mark.parametrize("page", PAGES)
def test_every_make_target_a_page_shows_exists(page: str) -> None:
    targets = re.findall(r"^([a-z]+):", text("Makefile"), re.M)
    shown = re.findall(r"(?:^ *|`)make ([a-z]+)", text(page), re.M)
    assert set(shown) <= set(targets)


def test_the_readme_is_short() -> None:
    assert len(text("README.md").splitlines()) <= MAX_README_LINES


def test_the_readmes_table_has_the_figures_that_the_study_wrote() -> None:
    """Shares and their extremes of each baseline, in the order of both pages."""

    def shares(page: str) -> dict[str, list[str]]:
        rows = re.findall(r"^\| (random|reactive|reference|oracle)\b[^|]*\|(.*)\|$", text(page), re.M)
        return {name: re.findall(r"\d+", cells) for name, cells in rows}

    assert shares("README.md") == shares("eval/results/baselines.md") != {}
