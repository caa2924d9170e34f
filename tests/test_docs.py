"""README and docs keep their word: links lead somewhere, commands, options and make targets exist."""

from __future__ import annotations

import functools
import importlib
import re

import pytest

from tests.commands import run_here
from tests.conftest import REPOSITORY
from tests.pages import PAGES, USERS_PAGES, text, whole
from tests.project import commands

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
            "report",
        )
    ),
}
"""Words that choose what a command does."""


@pytest.mark.parametrize("page", PAGES)
def test_every_path_a_page_links_to_exists(page: str) -> None:
    links = re.findall(r"\]\(([^)#:]+)(?:#[^)]*)?\)", text(page))
    assert [link for link in links if not (REPOSITORY / page).parent.joinpath(link).exists()] == []


@pytest.mark.parametrize("page", PAGES)
def test_every_heading_a_page_links_to_exists(page: str) -> None:
    for target, heading in re.findall(r"\]\(([^)#:]*)#([^)]+)\)", text(page)):
        linked = (REPOSITORY / page).parent / target if target else REPOSITORY / page
        titles = re.findall(r"^#+ (.+)$", whole(linked), re.M)
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


@pytest.mark.parametrize("page", USERS_PAGES)
def test_no_page_sends_a_reader_to_source_files(page: str) -> None:
    """Docstrings and files that ship have pages of their own in the site; example programs are there whole."""
    assert re.findall(r"aquanav_tools/[\w/.]*", text(page)) == []


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
