"""The leaderboard: all submissions of a folder in one table, with what tells them apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from aquanav_tools import __version__
from aquanav_tools.benchmark.definition import Benchmark
from aquanav_tools.benchmark.report import plot_tiers, points
from aquanav_tools.benchmark.score import Score, score_of
from aquanav_tools.benchmark.submission import Submission, benchmark_of, read_submission
from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.statistics import BOOTSTRAP_SEED, stratified_iqm
from aquanav_tools.evaluate.summary_text import estimate_text, fraction_text
from aquanav_tools.report.html import Figure, Page, Section, Table, write_page
from aquanav_tools.types import Array

PAGE, PLOT = "leaderboard.html", "leaderboard-{benchmark}.png"
PERMUTATIONS = 9999


@dataclass(frozen=True, eq=False)
class Entry:
    """One row: a method, from all its submissions, which are its training runs."""

    name: str
    submissions: tuple[Submission, ...]
    score: Score
    """Of all its episodes together."""
    cave_rates: Array
    """(runs, caves) collision-free success."""


def make_leaderboard(folder: Path, output: Path) -> Path:
    """Write the page of all submissions in a folder; return its path.

    Raises:
        InputError: there is none, or one contradicts itself.
    """
    paths = sorted(folder.glob("*.json"))
    if not paths:
        raise InputError(f"There is no submission in {folder}. aquanav-eval --benchmark ... --submit NAME writes one.")
    found = [(read_submission(path), path) for path in paths]
    output.mkdir(parents=True, exist_ok=True)
    sections = []
    for name in dict.fromkeys(submission.benchmark for submission, _ in found):
        own = [(submission, path) for submission, path in found if submission.benchmark == name]
        benchmark = benchmark_of(*own[0])
        sections.append(_section(benchmark, entries_of([one for one, _ in own], benchmark), output))
    page = Page(
        title="aquanav leaderboard",
        summary=(
            f"{len(found)} submissions. Scores are means over caves of the fraction of dives that end at the goal "
            "without a collision; intervals, of 95 %, are over caves. Every submission can be dived again: "
            "aquanav leaderboard verify FILE."
        ),
        sections=tuple(sections),
        footer=f"aquanav {__version__}",
    )
    path = output / PAGE
    write_page(page, path)
    return path


def entries_of(submissions: Sequence[Submission], benchmark: Benchmark) -> list[Entry]:
    """Return the rows of a leaderboard, the best first."""
    entries = []
    for name in dict.fromkeys(submission.name for submission in submissions):
        own = tuple(submission for submission in submissions if submission.name == name)
        tiers = {cave.name: tier.name for cave, (tier, _) in zip(own[0].caves, benchmark.caves, strict=True)}
        rates = np.array([[_rate(cave.episodes) for cave in submission.caves] for submission in own])
        score = score_of([episode for submission in own for episode in submission.episodes], tiers)
        entries.append(Entry(name, own, score, rates))
    return sorted(entries, key=lambda entry: (-entry.score.total.iqm.mean, -entry.score.total.mean.mean, entry.name))


def paired_p_value(first: Array, second: Array) -> float:
    """Return how probable as large a mean difference over (caves,) is, were the signs of the differences chance.

    A two-sided permutation test over caves; 1 where all are alike.
    """
    from scipy.stats import permutation_test

    if np.array_equal(first, second):
        return 1.0

    def mean_difference(one: Array, other: Array, axis: int) -> Array:
        difference: Array = (one - other).mean(axis=axis)
        return difference

    rng = np.random.default_rng(BOOTSTRAP_SEED)
    found = permutation_test(
        (first, second), mean_difference, permutation_type="samples", n_resamples=PERMUTATIONS, rng=rng
    )
    return float(found.pvalue)


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p-values of several tests such that one wrongly below a level comes with its probability at most.

    Source: Holm, Scandinavian Journal of Statistics 6 (1979) 65.
    """
    order = np.argsort(p_values, kind="stable")
    scaled = np.array(p_values)[order] * np.arange(len(p_values), 0, -1)
    corrected = np.empty(len(p_values))
    corrected[order] = np.minimum(np.maximum.accumulate(scaled), 1.0)
    return [float(value) for value in corrected]


def _rate(episodes: Sequence[EpisodeMetrics]) -> float:
    return sum(episode.is_collision_free_success for episode in episodes) / len(episodes)


def _section(benchmark: Benchmark, entries: Sequence[Entry], output: Path) -> Section:
    plot = output / PLOT.format(benchmark=benchmark.name)
    plot_tiers({entry.name: entry.score for entry in entries}, plot)
    tiers = [tier.name for tier in benchmark.tiers]
    columns = (
        "policy", "runs", "interquartile mean", "mean", "over the next", *tiers, "worst cave", "success", "SPL",
        "collisions per 100 m", "policy, SHA-256",
    )  # fmt: skip
    rows = [_row(entry, over) for entry, over in zip(entries, [*_over_next(entries), ""], strict=True)]
    return Section(
        benchmark.name,
        f"{len(benchmark.caves)} caves, {benchmark.episodes} dives in each. Over the next: the difference of means, "
        "with the p-value of a permutation test over the same caves, by Holm's correction for all rows together.",
        figures=(Figure(plot, "Dots are caves, bars means with 95 % intervals over caves."),),
        tables=(Table("", columns, tuple(rows)),),
    )


def _over_next(entries: Sequence[Entry]) -> list[str]:
    """Return of each row but the last how it stands over the next."""
    rates = [entry.cave_rates.mean(axis=0) for entry in entries]
    pairs = list(pairwise(rates))
    p_values = holm([paired_p_value(*pair) for pair in pairs])
    return [
        f"{100 * (first - second).mean():+.1f} points, p = {p_value:.2g}"
        for (first, second), p_value in zip(pairs, p_values, strict=True)
    ]


def _row(entry: Entry, over: str) -> tuple[str, ...]:
    total = entry.score.total
    iqm = points(total.iqm)
    if len(entry.submissions) > 1:
        iqm = f"{points(stratified_iqm(entry.cave_rates))} over runs"
    hashes = {one.policy.sha256[:12] if one.policy.sha256 else "none: a program" for one in entry.submissions}
    return (
        entry.name, str(len(entry.submissions)), iqm, points(total.mean), over,
        *(f"{100 * tier.mean.mean:.1f} %" for tier in entry.score.tiers), fraction_text(total.worst),
        fraction_text(total.means["success"]), f"{total.means['spl']:.2f}", estimate_text(total.collisions_per_100m),
        ", ".join(sorted(hashes)),
    )  # fmt: skip
