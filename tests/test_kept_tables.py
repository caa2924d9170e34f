"""Tables in pages of results are written by the scripts that measure them."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from eval import leaderboard_table, pages
from eval.pages import BEGIN, END, Record
from tests.conftest import REPOSITORY

KEEPING = {"batch": "batch.md", "boats": "boats.md", "films": "films.md", "train": "train.md"}


@pytest.mark.parametrize(("script", "page"), KEEPING.items())
def test_a_page_has_a_table_that_its_script_wrote(script: str, page: str) -> None:
    source = f"eval/benchmarks/{script}.py"
    assert "--keep" in (REPOSITORY / source).read_text(encoding="utf-8")
    text = (REPOSITORY / "eval" / "results" / page).read_text(encoding="utf-8")
    begin, end = BEGIN.format(name=script, script=source), END.format(name=script)
    kept = text.partition(begin)[2].partition(end)[0]
    assert re.match(r"\n\nMeasured on \d{4}-\d\d-\d\d at [0-9a-f]{7,}", kept)
    assert "\n|---|" in kept


def test_the_table_of_submissions_is_what_they_say() -> None:
    text = leaderboard_table.PAGE.read_text(encoding="utf-8")
    begin = BEGIN.format(name=leaderboard_table.NAME, script=leaderboard_table.SCRIPT)
    kept = text.partition(begin)[2].partition(END.format(name=leaderboard_table.NAME))[0]
    assert kept.strip().splitlines() == leaderboard_table.lines_of()


def test_only_what_lies_between_the_marks_is_replaced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pages, "ROOT", tmp_path)
    page = tmp_path / "page.md"
    begin, end = BEGIN.format(name="speed", script="fast.py"), END.format(name="speed")
    page.write_text(f"# Page\n\n{begin}\nold\n{end}\n\nBelow.\n", encoding="utf-8")
    for figure in ("1", "2"):
        record = Record("fast.py")
        record.say(f"| {figure} |")
        record.keep(page, "speed")
    text = page.read_text(encoding="utf-8")
    assert text.startswith(f"# Page\n\n{begin}\n\nMeasured on ") and text.endswith(f"| 2 |\n\n{end}\n\nBelow.\n")
    assert "old" not in text and "| 1 |" not in text
    with pytest.raises(ValueError, match=r"page.md has no line '<!-- other: .*Put both where the table goes"):
        Record("fast.py").keep(page, "other")
