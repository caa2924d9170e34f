"""Comparing evaluations: one report of several runs, with paired tests where they met the same episodes."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.comparison_report import write_comparison
from aquanav_tools.evaluate.metrics import INFEASIBLE, EpisodeMetrics
from aquanav_tools.evaluate.options import CompareOptions
from aquanav_tools.evaluate.paired import (
    PairedRates,
    compare_means,
    compare_rates,
    probability_of_improvement,
    share_won,
)
from aquanav_tools.evaluate.results import episodes_of, read_results
from aquanav_tools.evaluate.statistics import Estimate, stratified_iqm
from aquanav_tools.evaluate.summary import Summary, summarise
from aquanav_tools.types import Array

RESULTS = "results.json"
PAIRED_MEANS = ("spl", "collisions", "clearance_p5", "time", "energy")
Key = tuple[str, str, int, int]


@dataclass(frozen=True, eq=False)
class Method:
    """One side of a comparison: a policy, or the training runs of one method."""

    name: str
    runs: tuple[tuple[EpisodeMetrics, ...], ...]
    tasks: tuple[str, ...]
    """Scenario and condition of each column of the scores."""
    scores: Array
    """(runs, tasks) rates of collision-free success."""
    iqm: Estimate | None
    """Interquartile mean of the scores over training runs; None for a single run."""
    summary: Summary
    """Of the episodes of all runs."""


@dataclass(frozen=True)
class Comparison:
    """The first method against another."""

    first: str
    second: str
    improvement: float
    """Probability that a training run of the first scores higher than one of the second, ties half, mean over tasks."""
    num_pairs: int
    """Episodes that both met; the rest of this needs some, and a single run of each."""
    rates: PairedRates | None
    """Of collision-free success."""
    won: Estimate | None
    """Share of the episodes in which the first had the higher SPL, ties half."""
    differences: dict[str, Estimate]
    """Mean of the first less the second, for some metrics."""


def compare(options: CompareOptions) -> str:
    """Write comparison.json and report.html and return what to tell.

    Raises:
        InputError: a folder holds no finished evaluation, or the evaluations have no scenario and condition in common.
    """
    vehicles: dict[tuple[str, str], str] = {}
    methods = tuple(_read_method(folder, vehicles) for folder in options.evaluations)
    methods = _same_tasks(methods)
    comparisons = tuple(_compare(methods[0], other) for other in methods[1:])
    options.output.mkdir(parents=True, exist_ok=True)
    path = options.output / "comparison.json"
    path.write_text(json.dumps(_table(methods, comparisons), indent=2, allow_nan=False) + "\n", encoding="utf-8")
    report = write_comparison(methods, comparisons, options.output)
    return f"Report:      {report}\nNumbers:     {path}"


def run_folders(policies: Sequence[str], output: Path) -> list[Path]:
    """Return a folder for each policy's evaluation; policies of one name in several folders are numbered."""
    stems = [Path(policy).stem.replace(":", "-") for policy in policies]
    if len(set(stems)) < len(stems):
        stems = [f"{number:03d}-{stem}" for number, stem in enumerate(stems)]
    return [output / stem for stem in stems]


def _read_method(folder: Path, vehicles: dict[tuple[str, str], str]) -> Method:
    """Return the evaluations in a folder; `vehicles` keeps who dived each scenario, by its name and hash."""
    paths = [folder / RESULTS] if (folder / RESULTS).is_file() else sorted(folder.glob(f"*/{RESULTS}"))
    if not paths:
        raise InputError(f"{folder} holds no {RESULTS}, nor do folders in it. Name the output of aquanav-eval.")
    tables = [read_results(path) for path in paths]
    for table in tables:
        _check_vehicles(table["scenarios"], vehicles, folder)
    names = list(dict.fromkeys(table["policy"]["name"] for table in tables))
    name = names[0] if len(names) == 1 else f"{folder.name} ({len(paths)} runs)"
    return _method(name, tuple(tuple(_feasible(episodes_of(table))) for table in tables))


def _check_vehicles(scenarios: Sequence[dict[str, Any]], vehicles: dict[tuple[str, str], str], folder: Path) -> None:
    for scenario in scenarios:
        other = scenario.get("vehicle")
        flown = f"{other['name']} (SHA-256 {other['sha256'][:12]})" if other else "the scenario's own"
        known = vehicles.setdefault((scenario["name"], scenario["content_hash"]), flown)
        if flown != known:
            raise InputError(
                f"The evaluations have different vehicles in {scenario['name']}: {flown} in {folder}, {known} before. "
                "Their starts and ways are not the same. Evaluate both with the same --vehicle."
            )


def _feasible(episodes: Sequence[EpisodeMetrics]) -> list[EpisodeMetrics]:
    """Return the episodes whose limit left a policy time to arrive: the others tell nothing of it."""
    return [episode for episode in episodes if episode.outcome != INFEASIBLE]


def _method(name: str, runs: tuple[tuple[EpisodeMetrics, ...], ...]) -> Method:
    tasks = tuple(dict.fromkeys(_task(episode) for run in runs for episode in run))
    common = tuple(task for task in tasks if all(any(_task(episode) == task for episode in run) for run in runs))
    if not common:
        raise InputError(
            f"The runs of {name} have no scenario and condition in common. Evaluate them with one protocol."
        )
    scores = np.array([[_rate(run, task) for task in common] for run in runs])
    everything = [episode for run in runs for episode in run if _task(episode) in common]
    iqm = stratified_iqm(scores) if len(runs) > 1 else None
    return Method(name, runs, common, scores, iqm, summarise(everything))


def _same_tasks(methods: tuple[Method, ...]) -> tuple[Method, ...]:
    """Return the methods with the tasks that all have, under names that differ."""
    common = [task for task in methods[0].tasks if all(task in method.tasks for method in methods)]
    if not common:
        raise InputError("The evaluations have no scenario and condition in common. Evaluate all with one protocol.")
    names = [method.name for method in methods]
    renamed = []
    for number, method in enumerate(methods):
        runs = tuple(tuple(episode for episode in run if _task(episode) in common) for run in method.runs)
        name = method.name if names.count(method.name) == 1 else f"{method.name}, {number + 1}"
        renamed.append(_method(name, runs))
    return tuple(renamed)


def _compare(first: Method, second: Method) -> Comparison:
    improvement = float(
        np.mean(
            [
                probability_of_improvement(first.scores[:, column], second.scores[:, second.tasks.index(task)])
                for column, task in enumerate(first.tasks)
            ]
        )
    )
    pairs = _pairs(first, second) if len(first.runs) == len(second.runs) == 1 else []
    if not pairs:
        return Comparison(first.name, second.name, improvement, 0, None, None, {})

    def column(name: str, side: int) -> Array:
        return np.array([getattr(pair[side], name) for pair in pairs], dtype=float)

    return Comparison(
        first=first.name,
        second=second.name,
        improvement=improvement,
        num_pairs=len(pairs),
        rates=compare_rates(*(column("is_collision_free_success", side).astype(bool) for side in (0, 1))),
        won=share_won(column("spl", 0), column("spl", 1)),
        differences={name: compare_means(column(name, 0), column(name, 1)) for name in PAIRED_MEANS},
    )


def _pairs(first: Method, second: Method) -> list[tuple[EpisodeMetrics, EpisodeMetrics]]:
    """Return the episodes that both met, each pair of results once."""
    others = {_key(episode): episode for episode in second.runs[0]}
    pairs = [(episode, others[_key(episode)]) for episode in first.runs[0] if _key(episode) in others]
    return list({(one.scenario, one.digest, two.digest): (one, two) for one, two in pairs}.values())


def _key(episode: EpisodeMetrics) -> Key:
    return episode.scenario, episode.condition, episode.seed, episode.start


def _task(episode: EpisodeMetrics) -> str:
    return f"{episode.scenario}, {episode.condition}"


def _rate(run: Sequence[EpisodeMetrics], task: str) -> float:
    return float(np.mean([episode.is_collision_free_success for episode in run if _task(episode) == task]))


def _table(methods: Sequence[Method], comparisons: Sequence[Comparison]) -> dict[str, Any]:
    return {
        "format": 1,
        "methods": [
            {
                "name": method.name,
                "tasks": method.tasks,
                "scores": method.scores.tolist(),
                "iqm": dataclasses.asdict(method.iqm) if method.iqm else None,
                "summary": method.summary.as_table(),
            }
            for method in methods
        ],
        "comparisons": [dataclasses.asdict(comparison) for comparison in comparisons],
    }
