"""What a benchmark prints, kept in a page of results: between two marks, the rest of the page stays as it is."""

from __future__ import annotations

import os
import platform
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
RESULTS = ROOT / "eval" / "results"
BEGIN, END = "<!-- {name}: written by {script} --keep -->", "<!-- end of {name} -->"


class Record:
    """Prints lines as they come, and keeps them in a page where that was asked for."""

    def __init__(self, script: str) -> None:
        """Begin a record of a script, such as eval/benchmarks/batch.py."""
        self._script, self._lines = script, [f"Measured on {machine()}."]

    def say(self, line: str) -> None:
        """Print a line of Markdown."""
        self._lines.append(line)
        print(line, flush=True)

    def keep(self, page: Path, name: str) -> None:
        """Put all lines between the marks of a name in a page.

        Raises:
            ValueError: the page has no such marks, or not one after the other.
        """
        keep_lines(self._lines, page, name, self._script)


def keep_lines(lines: Sequence[str], page: Path, name: str, script: str) -> None:
    """Put lines between the marks of a name in a page.

    Raises:
        ValueError: the page has no such marks, or not one after the other.
    """
    text = page.read_text(encoding="utf-8")
    begin, end = BEGIN.format(name=name, script=script), END.format(name=name)
    before, mark, rest = text.partition(begin + "\n")
    _, closing, after = rest.partition(end)
    if not (mark and closing):
        raise ValueError(f"{page.name} has no line {begin!r} with {end!r} below it. Put both where the table goes.")
    body = "\n".join(["", *lines, ""])
    page.write_text(f"{before}{mark}{body}\n{closing}{after}", encoding="utf-8")
    print(f"Kept in {page.relative_to(ROOT)}.")


def machine() -> str:
    """Return what a measurement was made on, of which code and how busy: for a sentence."""
    commit = _git("rev-parse", "--short=9", "HEAD") or "no commit"
    changed = ", changed since" if _git("status", "--porcelain", "--", ".", ":!eval/results") else ""
    return (
        f"{time.strftime('%Y-%m-%d')} at {commit}{changed}: {len(os.sched_getaffinity(0))} cores, {_processor()}; "
        f"load by others at the start {os.getloadavg()[0]:.1f}"
    )


def _git(*words: str) -> str:
    """Return what git says of this checkout; nothing where there is none."""
    found = subprocess.run(["git", "-C", str(ROOT), *words], capture_output=True, text=True, check=False)
    return found.stdout.strip() if found.returncode == 0 else ""


def _processor() -> str:
    path = Path("/proc/cpuinfo")
    lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
