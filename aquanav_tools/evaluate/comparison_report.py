"""The one-page report of a comparison."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb
from pathlib import Path

from aquanav_tools import __version__
from aquanav_tools.evaluate.comparison import SIGNIFICANT, Comparison, Method
from aquanav_tools.evaluate.options import MAX_EPISODES
from aquanav_tools.evaluate.paired import PairedRates
from aquanav_tools.evaluate.reporting import MEAN_ROWS, mean_row
from aquanav_tools.evaluate.sequential import LEVEL, MISSED, Sequential
from aquanav_tools.evaluate.statistics import Estimate
from aquanav_tools.evaluate.summary_text import bound, estimate_text, fraction_text, percent
from aquanav_tools.report.html import Fact, Figure, Notice, Page, Table, write_page
from aquanav_tools.report.plots import plot_outcomes


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
        warnings=tuple(Notice("compared", note) for comparison in comparisons for note in comparison.notes),
        figures=(figure,),
        tables=(_summary_table(methods), *map(_pair_table, comparisons), _task_table(methods)),
        footer=f"aquanav {__version__}. Numbers for programs: comparison.json.",
    )
    path = folder / "report.html"
    write_page(page, path)
    return path


def summary_text(methods: Sequence[Method], comparisons: Sequence[Comparison]) -> str:
    """Return what a comparison came to, for the terminal: a paragraph for each pair."""
    paragraphs = []
    for comparison in comparisons:
        lines = [verdict(comparison), *_figures(comparison), *(f"Note: {note}" for note in comparison.notes)]
        paragraphs.append("\n".join(lines))
    return "\n\n".join(paragraphs) or _alone(methods[0])


def verdict(comparison: Comparison) -> str:
    """Return in a few sentences which of two methods is better, and how sure that is."""
    if comparison.sequential is not None:
        return _sequential_verdict(comparison, comparison.sequential)
    if comparison.rates is not None:
        return _paired_verdict(comparison, comparison.rates)
    first, second, runs = comparison.first, comparison.second, comparison.runs
    chance = (
        f"A run of {first} scores above one of {second} with a probability of {fraction_text(comparison.improvement)}."
    )
    if runs is None:
        return (
            f"Whether {first} or {second} is better cannot be tested: single runs need episodes in common (the same "
            "--seed, --episodes and --starts in both evaluations), methods two training runs or more each. "
            f"{chance}"
        )
    test = f"{_difference(runs.difference, 100.0, '0f')} points, permutation test over {runs.first} and {runs.second} "
    test += f"runs, p = {runs.p_value:.2g}"
    if runs.p_value >= SIGNIFICANT:
        more = "; with 4 of each the test can tell" if comb(runs.first + runs.second, runs.first) < 40 else ""
        return f"{first} and {second} cannot be told apart by collision-free success ({test}{more}). {chance}"
    better, worse = _ordered(comparison, runs.difference)
    return f"{better} is better than {worse} by collision-free success ({first} less {second}: {test}). {chance}"


def _paired_verdict(comparison: Comparison, rates: PairedRates) -> str:
    first, second = comparison.first, comparison.second
    one, two = rates.both + rates.only_first, rates.both + rates.only_second
    seen = (
        f"of the same {comparison.num_pairs} different episodes {first} ended {one} at the goal without a collision, "
        f"{second} {two}: {_difference(rates.difference, 100.0, '0f')} points (McNemar's exact test, "
        f"p = {rates.p_value:.2g})."
    )
    if rates.p_value < SIGNIFICANT:
        better, worse = _ordered(comparison, rates.difference)
        return f"{better} is better than {worse}: {seen}"
    return f"{first} and {second} cannot be told apart: {seen} {_outlook(comparison, rates)}"


def _sequential_verdict(comparison: Comparison, found: Sequential) -> str:
    first, second = comparison.first, comparison.second
    smallest = f"{100 * found.smallest:g} points"
    said = {
        "first": f"{first} is better than {second}",
        "second": f"{second} is better than {first}",
        "alike": f"Neither {first} nor {second} is better by {smallest}",
        "open": f"{first} and {second} cannot be told apart yet",
    }[found.verdict]
    seen = (
        f"{found.num_pairs} of at most {found.max_pairs} pairs of episodes were flown; in {found.only_first} only "
        f"{first} ended at the goal without a collision, in {found.only_second} only {second}: "
        f"{_difference(found.difference, 100.0, '1f')} points (e-value {found.e_value:.3g}, p at any time "
        f"{found.p_value:.2g})."
    )
    errors = (
        f"Whenever one stops: equal policies are called different with a probability of {100 * LEVEL:g} % at most, and "
        f"ones {smallest} or more apart alike with {100 * MISSED:g} % at most."
    )
    fixed = found.fixed_pairs
    needed = "" if fixed is None else f" A number fixed beforehand would be {fixed} pairs for the same errors."
    return f"{said}: {seen} {errors}{needed}"


def _outlook(comparison: Comparison, rates: PairedRates) -> str:
    """Return what more episodes would tell."""
    if comparison.are_all:
        return "There are no other episodes that differ under these rules."
    if comparison.num_to_tell is None:
        alike = "In each of them both came out alike" if not rates.only_first else "As many went one way as the other"
        return f"{alike}, so that nothing says how many more would tell."
    needed = max(comparison.num_to_tell, comparison.num_pairs + 1)
    if needed > MAX_EPISODES:
        return f"Were the difference as seen, more than {MAX_EPISODES} episodes would be needed to show it."
    return (
        f"Were the difference as seen, {needed} such episodes would show it with a probability of 80 %: "
        f"{needed - comparison.num_pairs} more."
    )


def _ordered(comparison: Comparison, difference: Estimate) -> tuple[str, str]:
    """Return the better and the worse."""
    pair = comparison.first, comparison.second
    return pair if difference.mean > 0.0 else pair[::-1]


def _figures(comparison: Comparison) -> list[str]:
    """Return lines with the differences of other metrics over the same episodes."""
    if not comparison.differences:
        return []
    lines = [f"  {comparison.first} less {comparison.second}, means over the same episodes, 95 % intervals in brackets"]
    for name, estimate in comparison.differences.items():
        label, form, unit = MEAN_ROWS[name]
        lines.append(f"  {label:<52}{_difference(estimate, 1.0, form)} {unit}".rstrip())
    return lines


def _alone(method: Method) -> str:
    if method.iqm is None:
        return f"One policy, {method.summary.episodes} episodes."
    return (
        f"{len(method.runs)} training runs: the interquartile mean of collision-free success is "
        f"{_points(method.iqm)} over runs."
    )


def _points(estimate: Estimate) -> str:
    return f"{fraction_text(estimate.mean)} [{100 * estimate.low:.0f}, {100 * estimate.high:.0f}]"


def _summary_table(methods: Sequence[Method]) -> Table:
    rows = [
        ("runs", *(str(len(method.runs)) for method in methods)),
        ("different episodes", *(str(method.summary.distinct_episodes) for method in methods)),
        ("collision-free success", *(percent(method.summary.collision_free_success) for method in methods)),
        ("interquartile mean over runs", *(_points(method.iqm) if method.iqm else "one run" for method in methods)),
        ("at 95 % confidence it", *(" ".join(bound(method.summary)) for method in methods)),
        ("success", *(percent(method.summary.success) for method in methods)),
        ("collisions per 100 m", *(estimate_text(method.summary.collisions_per_100m) for method in methods)),
    ]
    rewards = {method.reward for method in methods}
    for name in MEAN_ROWS:
        if name == "reward" and (len(rewards) > 1 or None in rewards):
            continue  # returns of different rewards have nothing to do with each other
        label, form, unit = mean_row(name, str(methods[0].reward))
        found = [method.summary.means.get(name) for method in methods]
        rows.append((label, *(estimate_text(item, form, unit) if item else "-" for item in found)))
    return Table("Side by side, with 95 % intervals", ("", *(method.name for method in methods)), tuple(rows))


def _pair_table(comparison: Comparison) -> Table:
    rows = [("probability that a run scores higher, ties half", fraction_text(comparison.improvement))]
    if comparison.rates is not None and comparison.won is not None:
        rates, found = comparison.rates, comparison.sequential
        difference = rates.difference if found is None else found.difference
        rows += [
            ("episodes that both met", str(comparison.num_pairs)),
            ("both without a collision", str(rates.both)),
            (f"only {comparison.first}", str(rates.only_first)),
            (f"only {comparison.second}", str(rates.only_second)),
            ("neither", str(rates.neither)),
            ("difference of collision-free success, points", _difference(difference, 100.0, "1f")),
            _test_row(comparison, rates),
            ("episodes with the higher SPL, ties half", _points(comparison.won)),
        ]
        for name, estimate in comparison.differences.items():
            label, form, unit = MEAN_ROWS[name]
            rows.append((f"difference of {label}", f"{_difference(estimate, 1.0, form)} {unit}".strip()))
    return Table(f"{comparison.first} less {comparison.second}, on the same episodes", ("", ""), tuple(rows))


def _test_row(comparison: Comparison, rates: PairedRates) -> tuple[str, str]:
    """Return the test that holds: McNemar's is for a number of episodes that was fixed beforehand."""
    if comparison.sequential is None:
        return "McNemar's exact test, p", f"{rates.p_value:.3g}"
    return "betting test that holds at any time, p", f"{comparison.sequential.p_value:.3g}"


def _difference(estimate: Estimate, factor: float, form: str) -> str:
    mean, low, high = (factor * value for value in (estimate.mean, estimate.low, estimate.high))
    return f"{mean:+.{form}} [{low:+.{form}}, {high:+.{form}}]"


def _task_table(methods: Sequence[Method]) -> Table:
    rows = tuple(
        (task, *(fraction_text(float(method.scores[:, method.tasks.index(task)].mean())) for method in methods))
        for task in methods[0].tasks
    )
    return Table("Collision-free success by scenario and condition", ("", *(item.name for item in methods)), rows)
