"""The pages of README and docs/ as lists of code blocks."""

from __future__ import annotations

import functools
import importlib.util
import re
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

from tests.conftest import REPOSITORY

PAGES = sorted(
    path.relative_to(REPOSITORY).as_posix()
    for folder in (".", "docs", "docs/design", "docs/decisions", "docs/reference", "examples")
    for path in REPOSITORY.glob(f"{folder}/*.md")
)
BUILDERS_PAGES = [name for name in PAGES if name.startswith(("docs/design/", "docs/decisions/"))]
"""How the package is built, and why."""
USERS_PAGES = [
    name for name in PAGES if name.startswith(("docs/", "examples/", "README")) and name not in BUILDERS_PAGES
]
"""Those whose blocks are to be copied and run; the others are about the project."""
BLOCK = re.compile(
    r"(?:^<!-- not run: (?P<reason>[^\n]+) -->\n)?^```(?P<language>\w*)\n(?P<code>.*?)^```$", re.M | re.S
)
NAME = re.compile(r"[#;] ([\w-]+\.\w+)\b.*\n")
"""The first line of a block that is a file."""


class Block(NamedTuple):
    """Code between two fences."""

    language: str
    code: str
    reason: str
    """Why no test runs it; empty for one that is run."""

    @property
    def file_name(self) -> str:
        """Of the file that it is, empty where it is none."""
        found = NAME.match(self.code)
        return found[1] if found else ""


def text(page: str) -> str:
    """Return a page."""
    return (REPOSITORY / page).read_text(encoding="utf-8")


def blocks(page: str) -> list[Block]:
    """Return the code blocks of a page."""
    return [Block(match["language"], match["code"], match["reason"] or "") for match in BLOCK.finditer(text(page))]


def modules(page: str) -> dict[str, str]:
    """Return the blocks of a page that are files, by their names."""
    return {block.file_name: block.code for block in blocks(page) if block.file_name}


@functools.cache
def builder(name: str) -> ModuleType:
    """Return a module of docs/builder, which makes the site."""
    spec = importlib.util.spec_from_file_location(name, REPOSITORY / "docs" / "builder" / f"{name}.py")
    assert spec is not None and spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@functools.cache
def whole(page: Path) -> str:
    """Return a page with what the site's build puts into it in place of its marks."""
    made: dict[str, Callable[[], str]] = {
        "commands": builder("site_commands").commands,
        "results": builder("site_files").results,
        "shipped": builder("site_files").shipped,
        "notebooks": builder("site_files").notebooks,
        "programs": builder("site_files").programs,
    }
    return re.sub(
        r"^<!-- insert: ([a-z]+) -->$", lambda mark: made[mark[1]](), page.read_text(encoding="utf-8"), flags=re.M
    )
