"""The one-page report of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from aquanav_tools import __version__
from aquanav_tools.evaluate.reporting import MEAN_ROWS, estimate_text, percent, share
from aquanav_tools.evaluate.statistics import Estimate
from aquanav_tools.report.html import Fact, Figure, Page, Table, write_page
from aquanav_tools.report.plots import plot_outcomes

if TYPE_CHECKING:
    from aquanav_tools.evaluate.comparing import Comparison, Method

SIGNIFICANT = 0.05


def write_comparison(methods: Sequence[Method], comparisons: Sequence[Comparison], folder: Path) -> Path:
    """Write `folder`/report.html and the plot in it; return the report's path."""
    pictures = folder / "pictures"
    pictures.mkdir(exist_ok=True)
    rates = {method.name: method.summary.collision_free_success for method in methods}
    plot_outcomes(
        {name: (rate.rate, (rate.low, rate.high)) for name, rate in rates.items()},
        pictures / "rates.png",
        "Collision-free success",
    )
    figure = Figure(pictures / "rates.png", "Over all episodes and runs, with 95 % Wilson intervals.", columns=2)
    page = Page(
        title=" against ".join(method.name for method in methods),
        summary=" ".join(verdict(comparison) for comparison in comparisons) or _alone(methods[0]),
        facts=tuple(
            Fact(method.name, percent(method.summary.collision_free_success), "collision-free success")
            for method in methods
        ),
        figures=(figure,),
        tables=(_summary_table(methods), *map(_pair_table, comparisons), _task_table(methods)),
        footer=f"aquanav {__version__}. Numbers for programs: comparison.json.",
    )
    path = folder / "report.html"
    write_page(page, path)
    return path


def verdict(comparison: Comparison) -> str:
    """Return in a sentence or two which of two methods is better, and how sure that is."""
    first, second = comparison.first, comparison.second
    if comparison.rates is None:
        return f"A run of {first} scores above one of {second} with a probability of {share(comparison.improvement)}."
    rates = comparison.rates
    points = 100.0 * rates.difference.mean
    if rates.p_value >= SIGNIFICANT:
        return (
            f"{comparison.num_pairs} episodes on the same starts do not show whether {first} or {second} succeeds more "
            f"often (p = {rates.p_value:.2g}; difference {points:+.0f} points "
            f"[{100 * rates.difference.low:+.0f}, {100 * rates.difference.high:+.0f}])."
        )
    better, worse = (first, second) if points > 0 else (second, first)
    return (
        f"{better} succeeds more often than {worse} on the same {comparison.num_pairs} episodes: by {abs(points):.0f} "
        f"points (p = {rates.p_value:.2g})."
    )


def _alone(method: Method) -> str:
    if method.iqm is None:
        return f"One policy, {method.summary.episodes} episodes."
    return (
        f"{len(method.runs)} training runs: the interquartile mean of collision-free success is "
        f"{_points(method.iqm)} over runs."
    )


def _points(estimate: Estimate) -> str:
    return f"{share(estimate.mean)} [{100 * estimate.low:.0f}, {100 * estimate.high:.0f}]"


def _summary_table(methods: Sequence[Method]) -> Table:
    rows = [
        ("runs", *(str(len(method.runs)) for method in methods)),
        ("different episodes", *(str(method.summary.distinct_episodes) for method in methods)),
        ("collision-free success", *(percent(method.summary.collision_free_success) for method in methods)),
        ("interquartile mean over runs", *(_points(method.iqm) if method.iqm else "one run" for method in methods)),
        ("fails in at most, at 95 % confidence", *(share(method.summary.failure_bound) for method in methods)),
        ("success", *(percent(method.summary.success) for method in methods)),
        ("collisions per 100 m", *(estimate_text(method.summary.collisions_per_100m) for method in methods)),
    ]
    for name, (label, form, unit) in MEAN_ROWS.items():
        found = [method.summary.means.get(name) for method in methods]
        rows.append((label, *(estimate_text(item, form, unit) if item else "-" for item in found)))
    return Table("Side by side, with 95 % intervals", ("", *(method.name for method in methods)), tuple(rows))


def _pair_table(comparison: Comparison) -> Table:
    rows = [("probability that a run scores higher, ties half", share(comparison.improvement))]
    if comparison.rates is not None and comparison.won is not None:
        rates = comparison.rates
        rows += [
            ("episodes that both met", str(comparison.num_pairs)),
            ("both without a collision", str(rates.both)),
            (f"only {comparison.first}", str(rates.only_first)),
            (f"only {comparison.second}", str(rates.only_second)),
            ("neither", str(rates.neither)),
            ("difference of collision-free success, points", _difference(rates.difference, 100.0, "1f")),
            ("McNemar's exact test, p", f"{rates.p_value:.3g}"),
            ("episodes with the higher SPL, ties half", _points(comparison.won)),
        ]
        for name, estimate in comparison.differences.items():
            label, form, unit = MEAN_ROWS[name]
            rows.append((f"difference of {label}", f"{_difference(estimate, 1.0, form)} {unit}".strip()))
    return Table(f"{comparison.first} less {comparison.second}, on the same episodes", ("", ""), tuple(rows))


def _difference(estimate: Estimate, factor: float, form: str) -> str:
    mean, low, high = (factor * value for value in (estimate.mean, estimate.low, estimate.high))
    return f"{mean:+.{form}} [{low:+.{form}}, {high:+.{form}}]"


def _task_table(methods: Sequence[Method]) -> Table:
    rows = tuple(
        (task, *(share(float(method.scores[:, method.tasks.index(task)].mean())) for method in methods))
        for task in methods[0].tasks
    )
    return Table("Collision-free success by scenario and condition", ("", *(item.name for item in methods)), rows)
