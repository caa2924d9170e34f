"""Running a benchmark: all caves shared out to worker processes, then the score, the results and the report."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from aquanav_tools.benchmark.definition import REAL_TIER, Benchmark, read_benchmark
from aquanav_tools.benchmark.journal import CaveJournal
from aquanav_tools.benchmark.options import BenchmarkOptions
from aquanav_tools.benchmark.report import write_report
from aquanav_tools.benchmark.score import Score, score_of
from aquanav_tools.benchmark.worker import BenchmarkSpec, CaveTask, CaveWorker, failed, make_worker, policy_of, rules_of
from aquanav_tools.errors import InputError, PolicyError
from aquanav_tools.evaluate.episode_table import EpisodeTable
from aquanav_tools.evaluate.failures import failure_text, is_failed_throughout
from aquanav_tools.evaluate.journal import held_results
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.options import Grid
from aquanav_tools.evaluate.own_files import own_files
from aquanav_tools.evaluate.policies import LoadedPolicy, code_of
from aquanav_tools.evaluate.results import Provenance, results_table, versions, write_episodes, write_results
from aquanav_tools.evaluate.rollout import CallTimeout
from aquanav_tools.evaluate.summary import group, summarise
from aquanav_tools.machine import num_cores
from aquanav_tools.task import choices_of
from aquanav_tools.types import Progress
from aquanav_tools.workers.pipe import PipeTransport
from aquanav_tools.workers.pool import WorkerPool
from aquanav_tools.workers.worker import WorkerSpec

RESULTS, EPISODES, SCORE, REPORT = "results.json", "episodes.parquet", "score.json", "report.html"


@dataclass(frozen=True, eq=False)
class BenchmarkRun:
    """What a run found and where it lies."""

    benchmark: Benchmark
    policy: LoadedPolicy
    score: Score
    episodes: EpisodeTable
    caves: tuple[dict[str, Any], ...]
    """What a worker returned of each cave, in the benchmark's order."""
    changed_caves: tuple[str, ...]
    """Names of caves that are not those of the published set: other versions of libraries built them."""
    report: Path
    numbers: Path


def run_benchmark(options: BenchmarkOptions, progress: Progress) -> BenchmarkRun:
    """Score a policy in a benchmark, and write everything about it into the output folder.

    Args:
        options: What to run and how.
        progress: Told how many caves are done.

    Raises:
        InputError: no such benchmark, the policy cannot be used, the folder cannot be written to, or what lies in it is
            of another run.
        MeshError, ScenarioError: a cave cannot be built or read.
        PolicyError: the policy failed in every episode. What was found is on disk all the same.
        ResourceError: processes end again and again.
    """
    benchmark = read_benchmark(options.benchmark, options.real)
    policy = policy_of(options, benchmark)
    with held_results(options.output):
        return _run_into_folder(options, benchmark, policy, progress)


def _run_into_folder(
    options: BenchmarkOptions, benchmark: Benchmark, policy: LoadedPolicy, progress: Progress
) -> BenchmarkRun:
    folder = options.output
    journal = _open_journal(folder, _identity(options, benchmark, policy), is_resumed=options.resume)
    tasks = [CaveTask(number) for number in range(len(benchmark.caves)) if number not in journal]
    progress(len(journal), len(benchmark.caves))
    for row in _rows(BenchmarkSpec(options, benchmark), tasks):
        journal.add(row)
        progress(len(journal), len(benchmark.caves))
    rows = journal.rows
    episodes = EpisodeTable(EpisodeMetrics(**metrics) for row in rows for metrics in row["metrics"])
    provenance = _provenance(options, benchmark, policy, [row["scenario"] for row in rows])
    table = results_table(provenance, summarise(episodes), group(episodes))
    write_episodes(episodes, folder / EPISODES)
    write_results(table, episodes, folder / RESULTS)
    if is_failed_throughout(episodes):
        raise PolicyError(f"{failure_text(policy.name, episodes)} Nothing was measured. Correct it and run again.")
    score = score_of(episodes, tiers_of(benchmark, rows), REAL_TIER)
    changed = changed_caves(benchmark, rows)
    (folder / SCORE).write_text(json.dumps(dataclasses.asdict(score), indent=2) + "\n", encoding="utf-8")
    report = write_report(benchmark, policy.name, score, episodes, changed, folder / REPORT)
    return BenchmarkRun(benchmark, policy, score, episodes, tuple(rows), changed, report, folder / SCORE)


def run_caves(
    options: BenchmarkOptions, benchmark: Benchmark, numbers: Sequence[int], progress: Progress
) -> list[dict[str, Any]]:
    """Return what workers return of some caves, by their places in a benchmark; nothing is written."""
    policy_of(options, benchmark)
    rows = []
    progress(0, len(numbers))
    for row in _rows(BenchmarkSpec(options, benchmark), [CaveTask(number) for number in numbers]):
        rows.append(row)
        progress(len(rows), len(numbers))
    return sorted(rows, key=lambda row: row["number"])


def tiers_of(benchmark: Benchmark, rows: Sequence[dict[str, Any]]) -> dict[str, str]:
    """Return the tier of each scenario, by the name that its episodes have."""
    return {row["scenario"]["name"]: benchmark.caves[row["number"]][0].name for row in rows}


def changed_caves(benchmark: Benchmark, rows: Sequence[dict[str, Any]]) -> tuple[str, ...]:
    """Return the names of caves whose mesh is not that of the published set."""
    pairs = [(benchmark.caves[row["number"]][1], row["mesh"]) for row in rows]
    return tuple(cave.scenario for cave, mesh in pairs if cave.sha256 not in (None, mesh))


def _rows(spec: BenchmarkSpec, tasks: Sequence[CaveTask]) -> Iterator[dict[str, Any]]:
    num = min(spec.options.workers or num_cores(), len(tasks))
    if num < 2:
        yield from map(CaveWorker(spec).run, tasks)
        return
    timeout = CallTimeout(spec.options.action_time_limit)
    worker_spec = WorkerSpec(
        make=partial(make_worker, spec),
        name="benchmark worker",
        activity="a cave was dived",
        advice="What was run is kept: go on with --resume.",
        clock_limit=timeout.limit,
        late=timeout.reason,
    )
    with WorkerPool(PipeTransport(), worker_spec, num) as pool:
        yield from (row for _, row in pool.results(iter(tasks), "run", failed))


def _identity(options: BenchmarkOptions, benchmark: Benchmark, policy: LoadedPolicy) -> dict[str, Any]:
    """Return what must be the same for two runs to give the same episodes."""
    return {
        "benchmark": benchmark.name,
        "caves": [cave.scenario for _, cave in benchmark.caves],
        "set": benchmark.sha256,
        "policy": {"name": policy.name, "sha256": policy.sha256},
        "backend": options.backend,
        "observation": policy.observation,
        "own_files": _own_files(options, benchmark),
        "versions": versions(),
    }


def _own_files(options: BenchmarkOptions, benchmark: Benchmark) -> Any:
    return own_files(rules_of(options, benchmark), options.observation, (), code_of(options.policy))


def _provenance(
    options: BenchmarkOptions, benchmark: Benchmark, policy: LoadedPolicy, scenarios: list[dict[str, Any]]
) -> Provenance:
    rules = policy.rules(rules_of(options, benchmark))
    conditions = [tier.condition for tier in benchmark.tiers]
    return Provenance(
        possible_episodes=None,
        own_files=_own_files(options, benchmark),
        policy={
            "name": policy.name,
            "sha256": policy.sha256,
            "path": options.policy,
            "is_trusted": options.trust,
        },
        scenarios=scenarios,
        protocol={
            "backend": options.backend,
            "episodes": benchmark.episodes,
            "seed": benchmark.seed,
            "observation": policy.observation,
            "action": policy.action,
            **choices_of(rules),
            "max_decisions": None,
            "grid": dataclasses.asdict(Grid()),
            "benchmark": {"name": benchmark.name, "sha256": benchmark.sha256},
            "conditions": [{"name": item.name, "changes": item.changes, "region": None} for item in conditions],
        },
    )


def _open_journal(folder: Path, identity: dict[str, Any], *, is_resumed: bool) -> CaveJournal:
    try:
        journal = CaveJournal(folder, identity, is_resumed=is_resumed)
        for name in (RESULTS, EPISODES, SCORE, REPORT):
            (folder / name).unlink(missing_ok=True)
    except OSError as cause:
        raise InputError(f"Cannot write to the output folder {folder}: {cause}. Choose another with -o.") from cause
    return journal
