"""The documentation as a site: what is made for it, where links lead, and that it asks no other host for anything."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from aquanav_tools import __all__ as functions
from aquanav_tools.cave import __all__ as cave_functions
from tests.conftest import REPOSITORY
from tests.pages import PAGES, builder, whole
from tests.test_docs import SUBCOMMANDS

MAX_PICTURE_BYTES, MAX_FILM_BYTES = 100_000, 600_000
OTHER_HOST = re.compile(r"<(?:script|img|iframe)[^>]* src=[\"']?(?:https?:)?//|<link[^>]* href=[\"']?(?:https?:)?//")
"""What a browser would fetch; a link that a reader may follow is no such thing."""


def test_the_page_of_commands_has_every_command_and_subcommand() -> None:
    text = whole(REPOSITORY / "docs/reference/commands.md")
    titles = re.findall(r"^#+ (aquanav.*)$", text, re.M)
    assert {" ".join(pair) for pair in SUBCOMMANDS} <= set(titles)
    assert {"aquanav-build-cave", "aquanav-train", "aquanav-eval", "aquanav-eval compare --sequential"} <= set(titles)
    assert text.count("usage: ") == len(titles), "each says how it is used"


def test_a_command_that_fails_is_no_page() -> None:
    with pytest.raises(RuntimeError, match="--version --help ended with 1"):  # it prints the version, and no help
        builder("site_commands").help_text("aquanav_tools.cli.info:main", ["--version"])


def test_the_page_of_functions_has_the_public_interface() -> None:
    text = (REPOSITORY / "docs/reference/functions.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^::: aquanav_tools\.api\.\w+\.(\w+)$", text, re.M)) == set(functions)


def test_the_page_of_the_caves_functions_has_all_of_them() -> None:
    text = (REPOSITORY / "docs/reference/cave.md").read_text(encoding="utf-8")
    assert set(re.findall(r"^::: aquanav_tools\.cave\.api\.(\w+)$", text, re.M)) == set(cave_functions)


def test_the_page_of_results_has_every_field_of_the_schema() -> None:
    def names(schema: object) -> set[str]:
        if not isinstance(schema, dict):
            return set()
        inner = schema.get("properties", {})
        parts = [*inner.values(), *schema.get("$defs", {}).values(), schema.get("items")]
        return set(inner) | {name for part in parts for name in names(part)}

    schema = json.loads((REPOSITORY / "aquanav_tools/evaluate/results.schema.json").read_text())
    listed = re.findall(r"^\| `(\w+)` \|", whole(REPOSITORY / "docs/reference/results.md"), re.M)
    assert names(schema) == set(listed)


def test_pictures_are_small() -> None:
    sizes = {path.name: path.stat().st_size for path in (REPOSITORY / "docs/pictures").iterdir()}
    films = {"dive.webp", "touch.webp", "boat.webp"}
    assert max(sizes.pop(name) for name in films) <= MAX_FILM_BYTES
    assert {name for name, size in sizes.items() if size > MAX_PICTURE_BYTES} == set()
    shown = {name for page in PAGES for name in re.findall(r"pictures/([\w.-]+)\)", whole(REPOSITORY / page))}
    assert shown == {*sizes, *films}


def test_the_site_is_built_without_a_warning_and_asks_no_other_host(tmp_path: Path) -> None:
    pytest.importorskip("material", reason="mkdocs-material is not installed: pip install 'aquanav[docs]'")
    pytest.importorskip("mkdocstrings", reason="mkdocstrings is not installed: pip install 'aquanav[docs]'")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--site-dir", str(tmp_path)]
    built = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True)
    assert built.returncode == 0, built.stderr
    pages = {path.relative_to(tmp_path).as_posix(): path.read_text() for path in tmp_path.rglob("*.html")}
    assert {"index.html", "start.html", "reference/functions.html", "results/baselines.html"} <= set(pages)
    assert [name for name, text in pages.items() if OTHER_HOST.search(text)] == []
    assert "collision-free" in (tmp_path / "search/search_index.js").read_text()
    functions_page = pages["reference/functions.html"]
    assert all(f"aquanav_tools.api.{name}" in functions_page for name in ("caves.build_cave", "scores.evaluate"))
