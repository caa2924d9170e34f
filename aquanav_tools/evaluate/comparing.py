"""Comparing evaluations: one report of several runs, with paired tests where they met the same episodes."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.comparison import SIGNIFICANT, Comparison, Method
from aquanav_tools.evaluate.comparison_report import write_comparison
from aquanav_tools.evaluate.metrics import INFEASIBLE, EpisodeMetrics
from aquanav_tools.evaluate.paired import (
    compare_means,
    compare_rates,
    compare_runs,
    episodes_to_tell,
    fraction_won,
    probability_of_improvement,
)
from aquanav_tools.evaluate.results import episodes_of, read_results
from aquanav_tools.evaluate.sequential import Sequential
from aquanav_tools.evaluate.statistics import stratified_iqm
from aquanav_tools.evaluate.summary import summarise
from aquanav_tools.report.trajectory import FAILED
from aquanav_tools.task import TaskOptions, choices_of
from aquanav_tools.types import Array

RESULTS = "results.json"
PAIRED_MEANS = ("spl", "collisions", "clearance_p5", "time", "energy")
Key = tuple[str, str, int, int]
FREE_RULES = {"episodes", "seed", "observation", "sensors", "history", "action", "grid", "cases", "conditions"}
"""Of a protocol: what may differ between evaluations that are compared. Conditions are compared by their names."""


@dataclass(frozen=True, eq=False)
class Compared:
    """What comparing evaluations found and where it lies."""

    methods: tuple[Method, ...]
    """In the order of the evaluations."""
    comparisons: tuple[Comparison, ...]
    """The first method against each other one; none where there is one method."""
    numbers: Path
    """comparison.json."""
    report: Path


def compare(evaluations: Sequence[Path], output: Path, sequential: Sequential | None = None) -> Compared:
    """Compare the evaluations in some folders, the first with each other one; write comparison.json and report.html.

    Args:
        evaluations: Folders of evaluations, or of several each.
        output: Folder to write into.
        sequential: What pairs said that were flown until a verdict; the verdict is theirs then.

    Raises:
        InputError: a folder holds no finished evaluation, or the evaluations have no scenario and condition in common.
    """
    methods = tuple(_read_method(folder) for folder in evaluations)
    _check_vehicles(methods)
    methods = _same_tasks(methods)
    comparisons = tuple(_compare(methods[0], other) for other in methods[1:])
    if sequential is not None:
        comparisons = tuple(dataclasses.replace(item, sequential=sequential) for item in comparisons)
    output.mkdir(parents=True, exist_ok=True)
    path = output / "comparison.json"
    path.write_text(json.dumps(_table(methods, comparisons), indent=2, allow_nan=False) + "\n", encoding="utf-8")
    return Compared(methods, comparisons, path, write_comparison(methods, comparisons, output))


def run_folders(policies: Sequence[str], output: Path) -> list[Path]:
    """Return a folder for each policy's evaluation; policies of one name in several folders are numbered."""
    stems = [Path(policy).stem.replace(":", "-") for policy in policies]
    if len(set(stems)) < len(stems):
        stems = [f"{number:03d}-{stem}" for number, stem in enumerate(stems)]
    return [output / stem for stem in stems]


def _read_method(folder: Path) -> Method:
    paths = [folder / RESULTS] if (folder / RESULTS).is_file() else sorted(folder.glob(f"*/{RESULTS}"))
    if not paths:
        raise InputError(f"{folder} holds no {RESULTS}, nor do folders in it. Name the output of aquanav-eval.")
    tables = [read_results(path) for path in paths]
    name = tables[0]["policy"]["name"] if len(tables) == 1 else f"{folder.name} ({len(tables)} runs)"
    runs = tuple(tuple(_feasible(episodes_of(table))) for table in tables)
    without = tuple({key: value for key, value in table.items() if key != "episodes"} for table in tables)
    return _method(name, runs, without)


def _feasible(episodes: list[EpisodeMetrics]) -> list[EpisodeMetrics]:
    """Return the episodes whose limit left time to arrive, as the others tell nothing of a policy; all without any."""
    return [episode for episode in episodes if episode.outcome != INFEASIBLE] or episodes


def _check_vehicles(methods: Sequence[Method]) -> None:
    finished: dict[tuple[str, str], tuple[str, str]] = {}
    rows = [(method.name, row) for method in methods for table in method.tables for row in table["scenarios"]]
    for method, row in rows:
        vehicle = (
            f"{row['vehicle']['name']} ({row['vehicle']['sha256'][:12]})" if "vehicle" in row else "its own vehicle"
        )
        known, other = finished.setdefault((row["name"], row["content_hash"]), (vehicle, method))
        if vehicle != known:
            raise InputError(
                f"Different vehicles dived {row['name']}: {known} with {other}, {vehicle} with {method}. Their starts "
                "and ways are not the same. Evaluate both with the same --vehicle."
            )


def _method(name: str, runs: tuple[tuple[EpisodeMetrics, ...], ...], tables: tuple[dict[str, Any], ...]) -> Method:
    tasks = tuple(dict.fromkeys(_task(episode) for run in runs for episode in run))
    common = tuple(task for task in tasks if all(any(_task(episode) == task for episode in run) for run in runs))
    if not common:
        raise InputError(
            f"The runs of {name} have no scenario and condition in common. Evaluate them with one protocol."
        )
    scores = np.array([[_rate(run, task) for task in common] for run in runs])
    everything = [episode for run in runs for episode in run if _task(episode) in common]
    iqm = stratified_iqm(scores) if len(runs) > 1 else None
    return Method(name, runs, common, scores, iqm, summarise(everything), tables)


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
        renamed.append(_method(name, runs, method.tables))
    return tuple(renamed)


def _compare(first: Method, second: Method) -> Comparison:
    improvement = float(
        np.mean(
            [
                probability_of_improvement(one, two)
                for one, two in zip(first.scores.T, _in_order(second, first.tasks).T, strict=True)
            ]
        )
    )
    pairs = _pairs(first, second) if len(first.runs) == len(second.runs) == 1 else []
    several = min(len(first.runs), len(second.runs)) > 1
    runs = compare_runs(first.scores.mean(axis=1), _in_order(second, first.tasks).mean(axis=1)) if several else None
    found = Comparison(
        first.name, second.name, improvement, 0, False, None, None, None, {}, runs, tuple(_notes(first, second))
    )
    if not pairs:
        return found

    def column(name: str, side: int) -> Array:
        return np.array([getattr(pair[side], name) for pair in pairs], dtype=float)

    rates = compare_rates(*(column("is_collision_free_success", side).astype(bool) for side in (0, 1)))
    possible = [_num_possible(method) for method in (first, second)]
    return dataclasses.replace(
        found,
        num_pairs=len(pairs),
        are_all=all(count is not None and count <= len(pairs) for count in possible),
        rates=rates,
        num_to_tell=episodes_to_tell(rates) if rates.p_value >= SIGNIFICANT else None,
        won=fraction_won(column("spl", 0), column("spl", 1)),
        differences={name: compare_means(column(name, 0), column(name, 1)) for name in PAIRED_MEANS},
    )


def _pairs(first: Method, second: Method) -> list[tuple[EpisodeMetrics, EpisodeMetrics]]:
    """Return the episodes that both met, each pair of results once. Where nothing is random, seeds do not matter."""
    are_fixed = None not in (_num_possible(first), _num_possible(second))

    def key(episode: EpisodeMetrics) -> Key:
        return episode.scenario, episode.condition, 0 if are_fixed else episode.seed, episode.start

    others = {key(episode): episode for episode in second.runs[0]}
    pairs = [(episode, others[key(episode)]) for episode in first.runs[0] if key(episode) in others]
    return list({(one.scenario, one.digest, two.digest): (one, two) for one, two in pairs}.values())


def _in_order(method: Method, tasks: Sequence[str]) -> Array:
    """Return the (runs, tasks) scores of a method with the tasks in another order."""
    return method.scores[:, [method.tasks.index(task) for task in tasks]]


def _notes(first: Method, second: Method) -> Iterator[str]:
    """Yield what the reader of a comparison must know."""
    rules = [method.tables[0]["protocol"] for method in (first, second)]
    usual = json.loads(json.dumps(choices_of(TaskOptions())))  # of an option that was added since
    for name in sorted({*rules[0], *rules[1]} - FREE_RULES):
        one, two = (table.get(name, usual.get(name)) for table in rules)
        if one != two:
            yield f"They were run under different rules: {name} {one} for {first.name}, {two} for {second.name}."
    files = [method.tables[0].get("own_files", {}) for method in (first, second)]
    for name in sorted(files[0].keys() & files[1].keys()):
        if files[0][name] != files[1][name]:
            yield f"{name} was changed between the evaluations."
    hashes = [
        {item["name"]: item["content_hash"] for item in method.tables[0]["scenarios"]} for method in (first, second)
    ]
    for name in hashes[0].keys() & hashes[1].keys():
        if hashes[0][name] != hashes[1][name]:
            yield f"The scenario {name} was built anew between the evaluations."
    for method in (first, second):
        failed = method.summary.outcomes[FAILED]
        if failed:
            yield (
                f"{method.name} itself failed in {failed} of {method.summary.episodes} episodes, by an error or by "
                "what is no action; they count as failures."
            )


def _num_possible(method: Method) -> int | None:
    """Return how many episodes that differ a method's first run could have met."""
    count: int | None = method.tables[0]["possible_episodes"]
    return count


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
