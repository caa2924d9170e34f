"""How the package is built, and why: short pages that name what exists, and decisions as dated records."""

from __future__ import annotations

import re
import subprocess
from datetime import date
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from tests.pages import BUILDERS_PAGES, text

DESIGN = [page for page in BUILDERS_PAGES if page.startswith("docs/design/")]
RECORDS = [page for page in BUILDERS_PAGES if page.startswith("docs/decisions/") and not page.endswith("/index.md")]
MAX_LINES = 120
"""What is read in one sitting."""
PARTS = ["Context", "Decision", "Figures", "Consequences"]
MADE = {"build.json", "cameras.json", "guide.json", "report.json", "scenario.toml", "starts.json", "vehicle.toml"}
"""Files of a scenario folder, which the pages tell of."""


@pytest.mark.parametrize("page", DESIGN)
def test_a_page_of_the_design_is_short(page: str) -> None:
    assert len(text(page).splitlines()) <= MAX_LINES


@pytest.mark.parametrize("page", BUILDERS_PAGES)
def test_every_file_that_a_page_names_exists(page: str) -> None:
    listed = subprocess.run(["git", "ls-files"], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    files = ["/" + line for line in listed.stdout.splitlines()]
    named = set(re.findall(r"`([\w/]+\.(?:py|js|toml|json|md))`", text(page))) - MADE - {"eval.py"}
    assert [name for name in sorted(named) if not any(file.endswith("/" + name) for file in files)] == []


def test_every_room_has_its_place_in_the_house() -> None:
    """The picture of the rooms names each of them."""
    rooms = {path.parent.name for path in (REPOSITORY / "aquanav_tools").glob("*/__init__.py")}
    words = set(re.findall(r"[a-z]+", text("docs/design/rooms.md")))
    assert sorted(rooms - words) == []


@pytest.mark.parametrize("page", RECORDS)
def test_a_decision_has_a_date_and_says_why(page: str) -> None:
    lines = text(page).splitlines()
    day = date.fromisoformat(lines[2])
    assert lines[0].startswith("# ") and day.year >= 2026
    assert re.findall(r"^## (.+)$", text(page), re.M) == PARTS
    assert all(part.strip() for part in re.split(r"^#+ .+$", text(page), flags=re.M)[1:])


def test_decisions_are_numbered_by_date_and_listed() -> None:
    numbers = [Path(page).name[:4] for page in RECORDS]
    assert numbers == [f"{number:04d}" for number in range(1, len(RECORDS) + 1)]
    dates = [text(page).splitlines()[2] for page in RECORDS]
    assert dates == sorted(dates)
    rows = re.findall(r"^\| (\d{4}) \| \[(.+)\]\((.+)\) \| (\S+) \|$", text("docs/decisions/index.md"), re.M)
    titles = [text(page).splitlines()[0].removeprefix("# ") for page in RECORDS]
    names = [Path(page).name for page in RECORDS]
    assert rows == list(zip(numbers, titles, names, dates, strict=True))
