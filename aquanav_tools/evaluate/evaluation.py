"""Evaluating a policy: fly the episodes, keep each as it ends, then write the results and the report."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.flight import Flight, Hangar, numbered, open_hangar
from aquanav_tools.evaluate.journal import Journal, clear_journal, worst_first
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.options import EvaluateOptions, ProtocolOptions
from aquanav_tools.evaluate.policies import LoadedPolicy, load_policy
from aquanav_tools.evaluate.protocol import Condition, conditions_of, plan_condition
from aquanav_tools.evaluate.reporting import write_report
from aquanav_tools.evaluate.results import Provenance, results_table, versions, write_episodes, write_results
from aquanav_tools.evaluate.summary import Summary, group, summarise
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.task import choices_of
from aquanav_tools.types import Progress

RESULTS, EPISODES, REPORT, RUN = "results.json", "episodes.parquet", "report.html", "run.json"
RECORDING = "episode-{index:05d}.rrd"


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What an evaluation found and where it lies."""

    summary: Summary
    episodes: tuple[EpisodeMetrics, ...]
    results: Path
    report: Path
    recordings: tuple[Path, ...]


def evaluate(
    options: EvaluateOptions, progress: Progress, policy_name: str = "", output: Path | None = None
) -> Evaluation:
    """Evaluate one policy and write everything about it into a folder.

    Args:
        options: What to evaluate and how.
        progress: Told how many episodes are done.
        policy_name: Which of the options' policies; empty for the first.
        output: The folder; None takes the options'.

    Raises:
        InputError: the policy cannot be used, the output folder cannot be made, or its episodes are of another
            evaluation.
        ScenarioError: a scenario cannot be read.
    """
    output = output or options.output
    policy = load_policy(policy_name or options.policies[0], options.trust)
    scenarios = [read_scenario(path) for path in options.scenario]
    _check_names(scenarios)
    conditions = conditions_of(options.grid)
    flights = plan_flights(scenarios, conditions, options)
    provenance = _provenance(policy, policy_name or options.policies[0], scenarios, conditions, options)
    journal = _open_journal(output, provenance, options.resume)
    started, clock, before = datetime.now(timezone.utc), time.perf_counter(), len(journal.entries)
    with open_hangar(policy, options) as hangar:
        _fly_all(hangar, flights, journal, options, output, progress)
        recordings = _recordings(hangar, flights, journal, options, output)
    seconds = time.perf_counter() - clock
    episodes = tuple(entry.metrics for entry in journal.entries)
    summary = summarise(episodes)
    groups = group(episodes)
    report = write_report(scenarios, journal, (summary, groups), provenance, recordings, output)
    write_episodes(episodes, output / EPISODES)
    write_results(results_table(provenance, summary, groups, episodes), output / RESULTS)
    run = {"started": started.isoformat(timespec="seconds"), "seconds": seconds, "episodes": len(flights) - before}
    (output / RUN).write_text(json.dumps(run) + "\n", encoding="utf-8")
    return Evaluation(summary, episodes, output / RESULTS, report, tuple(output / name for name in recordings.values()))


def plan_flights(
    scenarios: Sequence[Scenario], conditions: Sequence[Condition], options: ProtocolOptions
) -> tuple[Flight, ...]:
    """Return all episodes of an evaluation in their order: by scenario, then by condition."""
    return numbered(
        [
            Flight(0, scenario, condition, plan)
            for scenario in scenarios
            for condition in conditions
            for plan in plan_condition(scenario, options, condition)
        ]
    )


def _check_names(scenarios: Sequence[Scenario]) -> None:
    names = [scenario.name for scenario in scenarios]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"Two scenarios are called {twice[0]}. Build one again under another --name.")


def _open_journal(folder: Path, provenance: Provenance, is_resumed: bool) -> Journal:
    """Make the folder and drop an earlier evaluation's results, so that two never mix; keep its episodes to resume."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not is_resumed:
            clear_journal(folder)
            for path in folder.glob("episode-*.rrd"):
                path.unlink()
        journal = Journal(folder, provenance.identity(versions()), is_resumed)
        for name in (RESULTS, EPISODES, REPORT, RUN):
            (folder / name).unlink(missing_ok=True)
    except OSError as cause:
        raise InputError(f"Cannot write to the output folder {folder}: {cause}. Choose another with -o.") from cause
    return journal


def _fly_all(
    hangar: Hangar,
    flights: Sequence[Flight],
    journal: Journal,
    options: EvaluateOptions,
    output: Path,
    progress: Progress,
) -> None:
    """Fly what the journal lacks; write each recording before its episode counts as done."""
    num_recorded = sum(entry.recording is not None for entry in journal.entries)
    progress(len(journal.entries), len(flights))
    for flight in flights[len(journal.entries) :]:
        track, metrics = hangar.fly(flight)
        name = None
        if num_recorded < options.max_recordings and _is_recorded(metrics, options.record):
            name = RECORDING.format(index=flight.index)
            hangar.record(flight, track, output / name)
            num_recorded += 1
        journal.add(metrics, track, name)
        progress(len(journal.entries), len(flights))


def _is_recorded(metrics: EpisodeMetrics, record: str) -> bool:
    return record == "all" or (record == "failures" and not metrics.is_collision_free_success)


def _recordings(
    hangar: Hangar, flights: Sequence[Flight], journal: Journal, options: EvaluateOptions, output: Path
) -> dict[int, str]:
    """Return the names of the recordings by episode; fly the worst episodes again where these are asked for."""
    if options.record != "worst":
        return {entry.metrics.index: entry.recording for entry in journal.entries if entry.recording is not None}
    names = {}
    worst = worst_first([entry.metrics for entry in journal.entries])[: options.max_recordings]
    for flight in (flights[index] for index in sorted(worst)):
        names[flight.index] = RECORDING.format(index=flight.index)
        track, _ = hangar.fly(flight)
        hangar.record(flight, track, output / names[flight.index])
    return names


def _provenance(
    policy: LoadedPolicy,
    path: str,
    scenarios: Sequence[Scenario],
    conditions: Sequence[Condition],
    options: EvaluateOptions,
) -> Provenance:
    return Provenance(
        policy={"name": policy.name, "sha256": policy.sha256, "path": path, "is_trusted": options.trust},
        scenarios=[
            {"name": scenario.name, "content_hash": scenario.content_hash, "path": str(folder)}
            for scenario, folder in zip(scenarios, options.scenario, strict=True)
        ],
        protocol={
            "episodes": options.episodes,
            "seed": options.seed,
            "observation": policy.observation,
            "action": policy.action,
            **choices_of(options),
            "max_decisions": options.max_decisions,
            "grid": dataclasses.asdict(options.grid),
            "conditions": [{"name": item.name, "changes": item.changes, "region": item.region} for item in conditions],
        },
    )
