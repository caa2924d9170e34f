"""The table of submissions in docs/benchmark.md, from the files in eval/leaderboard.

python eval/leaderboard_table.py --keep
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))
from aquanav_tools.benchmark.leaderboard import Entry, entries_of
from aquanav_tools.benchmark.report import points
from aquanav_tools.benchmark.submission import benchmark_of, read_submission
from aquanav_tools.evaluate.statistics import stratified_iqm
from eval.pages import ROOT, keep_lines

NAME, SCRIPT = "leaderboard", "eval/leaderboard_table.py"
PAGE, SUBMISSIONS = ROOT / "docs" / "benchmark.md", ROOT / "eval" / "leaderboard"
SETS = ("quick", "aquanav-300")


def lines_of(folder: Path = SUBMISSIONS) -> list[str]:
    """Return a table for each set, in Markdown; the best policy first."""
    paths = sorted(folder.glob("*.json"))
    found = [(read_submission(path), path) for path in paths]
    lines: list[str] = []
    for name in SETS:
        own = [(submission, path) for submission, path in found if submission.benchmark == name]
        if own:
            entries = entries_of([submission for submission, _ in own], benchmark_of(*own[0]))
            lines += [*([""] if lines else []), *_table(name, entries)]
    return lines


def _table(name: str, entries: Sequence[Entry]) -> list[str]:
    tiers = " | ".join(tier.name for tier in entries[0].score.tiers)
    return [
        f"| `{name}` | runs | mean | interquartile mean | {tiers} |",
        "|" + "---|" * (4 + len(entries[0].score.tiers)),
        *map(_row, entries),
    ]


def _row(entry: Entry) -> str:
    runs, total = len(entry.submissions), entry.score.total
    iqm = points(total.iqm) if runs == 1 else f"{points(stratified_iqm(entry.cave_rates))} over runs"
    tiers = " | ".join(f"{100 * tier.mean.mean:.1f}" for tier in entry.score.tiers)
    return f"| {entry.name} | {runs} | {points(total.mean)} | {iqm} | {tiers} |"


def main() -> None:
    """Print the tables, and keep them in the page where that is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", action="store_true", help="put them into docs/benchmark.md")
    lines = lines_of()
    print(*lines, sep="\n")
    if parser.parse_args().keep:
        keep_lines(lines, PAGE, NAME, SCRIPT)


if __name__ == "__main__":
    main()
