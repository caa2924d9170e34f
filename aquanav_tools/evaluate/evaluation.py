"""Evaluating a policy: run the episodes, keep each as it ends, then write the results and the report."""

from __future__ import annotations

import dataclasses
import json
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

from aquanav_tools.envs.factory import AnyScenario, say_left_out
from aquanav_tools.errors import InputError, LibraryError
from aquanav_tools.evaluate.episode_pool import Runner
from aquanav_tools.evaluate.episode_runner import open_runner
from aquanav_tools.evaluate.episode_table import EpisodeTable
from aquanav_tools.evaluate.episode_worker import FILM_SUFFIX, EvaluationSpec, Plan, RecordRule, Task, make_plan
from aquanav_tools.evaluate.journal import Journal, clear_journal, held_results, worst_first
from aquanav_tools.evaluate.options import EvaluateOptions
from aquanav_tools.evaluate.policies import LoadedPolicy, policy_loader
from aquanav_tools.evaluate.protocol import write_cases
from aquanav_tools.evaluate.reporting import write_report
from aquanav_tools.evaluate.results import (
    Provenance,
    results_table,
    scenario_row,
    versions,
    write_episodes,
    write_results,
)
from aquanav_tools.evaluate.summary import Summary, group, summarise
from aquanav_tools.report.recording.stream import lack_of_recorder
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.contacts import load_bullet
from aquanav_tools.task import choices_of
from aquanav_tools.types import Progress
from aquanav_tools.workers.ray_cluster import load_ray

CASES = "cases.toml"
RESULTS, EPISODES, REPORT, RUN = "results.json", "episodes.parquet", "report.html", "run.json"
KINDS = (".rrd", FILM_SUFFIX)
"""Endings of what an episode is recorded in."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Evaluation:
    """What an evaluation found and where it lies."""

    summary: Summary
    episodes: EpisodeTable
    num_possible: int | None
    """Episodes that differ which there are; None for no end of them."""
    results: Path
    report: Path
    recordings: tuple[Path, ...]


def evaluate(
    options: EvaluateOptions,
    progress: Progress,
    policy_name: str = "",
    output: Path | None = None,
    load: Callable[[str], LoadedPolicy] | None = None,
) -> Evaluation:
    """Evaluate one policy and write everything about it into a folder.

    Args:
        options: What to evaluate and how.
        progress: Told how many episodes are done.
        policy_name: Which of the options' policies; empty for the first.
        output: The folder; None takes the options'.
        load: Loads the policy by its name; a function of a module, as other processes call it too. Without one that is
            `load_policy`.

    Raises:
        InputError: the policy cannot be used, the output folder cannot be made, another process evaluates into it, or
            its episodes are of another evaluation.
        ScenarioError: a scenario cannot be read.
        LibraryError: a library that the policy, or films, need is not installed.
        ResourceError: the processes that run do not start, or the cluster does not answer.
    """
    load = load or policy_loader(options, is_trusted=options.trust)
    name = policy_name or options.policies[0]
    options = _recordable(load(name).rules(options))
    spec = EvaluationSpec(options, name, output or options.output, load)
    plan = make_plan(spec)
    check_names(plan.scenarios)
    say_left_out(plan.scenarios)
    check_runner(plan, options)
    folder = output or options.output
    with held_results(folder):
        return _evaluate_into_folder(folder, spec, plan, progress)


def _recordable(options: EvaluateOptions) -> EvaluateOptions:
    """Return options that record nothing where nothing can be recorded, and say so; films are of what is recorded.

    Raises:
        LibraryError: films are asked for.
    """
    if options.record == "none" or not (lack := lack_of_recorder()):
        return options
    if options.film:
        raise LibraryError(lack)
    logger.warning("No episode is recorded. %s", lack)
    return dataclasses.replace(options, record="none")


def _evaluate_into_folder(output: Path, spec: EvaluationSpec, plan: Plan, progress: Progress) -> Evaluation:
    """Run the episodes and write everything about them into the folder, which this process holds."""
    options = spec.options
    journal = open_journal(output, plan, spec)
    started, clock, before = datetime.now(timezone.utc), time.perf_counter(), len(journal)
    missing = len(plan.episodes) - len(journal)
    num_worst = min(options.max_recordings, len(plan.episodes)) if options.record == "worst" else 0
    with open_runner(spec, plan, max(missing, num_worst)) as runner:
        _run_all(runner, spec, plan, journal, progress)
        recordings = _recordings(runner, output, options, journal)
    seconds = time.perf_counter() - clock
    run = {"started": started.isoformat(timespec="seconds"), "seconds": seconds, "episodes": len(journal) - before}
    (output / RUN).write_text(json.dumps(run) + "\n", encoding="utf-8")
    return write_evaluation(output, spec, plan, journal, recordings)


def write_evaluation(
    output: Path, spec: EvaluationSpec, plan: Plan, journal: Journal, recordings: Mapping[int, str]
) -> Evaluation:
    """Write the report and the results of the episodes in a journal into their folder; return what they came to."""
    options, episodes, provenance = spec.options, journal.episodes, provenance_of(plan, spec)
    summary = summarise(episodes)
    groups = group(episodes)
    if options.cases:
        write_cases(options.cases, options, options.max_decisions, options.observation, output / CASES)
    met = [scenario for scenario in plan.scenarios if scenario.name in episodes.names("scenario")]
    report = write_report(met, journal, (summary, groups), provenance, recordings, output)
    write_episodes(episodes, output / EPISODES)
    write_results(results_table(provenance, summary, groups), episodes, output / RESULTS)
    files = output / RESULTS, report, tuple(output / name for name in recordings.values())
    return Evaluation(summary, episodes, plan.num_possible, *files)


def check_names(scenarios: Sequence[AnyScenario]) -> None:
    """Refuse scenarios of one name, as results go by it."""
    names = [scenario.name for scenario in scenarios]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise InputError(f"Two scenarios are called {twice[0]}. Build one again under another --name.")


def open_journal(folder: Path, plan: Plan, spec: EvaluationSpec) -> Journal:
    """Make the folder and drop an earlier evaluation's results, so that two never mix; keep its episodes to resume.

    A recording whose episode was not written down yet goes as well: that episode is run again.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not spec.options.resume:
            clear_journal(folder)
        journal = Journal(folder, provenance_of(plan, spec).identity(versions()), spec.options.resume)
        kept = {(folder / name).with_suffix(kind) for name in journal.recordings.values() for kind in KINDS}
        for path in [path for kind in KINDS for path in folder.glob(f"episode-*{kind}*") if path not in kept]:
            path.unlink()
        for name in (RESULTS, EPISODES, REPORT, RUN, CASES):
            (folder / name).unlink(missing_ok=True)
    except OSError as cause:
        raise InputError(f"Cannot write to the output folder {folder}: {cause}. Choose another with -o.") from cause
    return journal


def check_runner(plan: Plan, options: EvaluateOptions) -> None:
    """Check that the episodes of a plan can be run as the options ask, before anything is written."""
    if options.ray is not None:
        load_ray()
    if options.backend == "pybullet" and any(isinstance(scenario, Scenario) for scenario in plan.scenarios):
        load_bullet()
    if options.backend == "batch":
        from aquanav_tools.evaluate.batch_runner import check_plan  # Warp takes a second to import

        check_plan(plan)


def _run_all(runner: Runner, spec: EvaluationSpec, plan: Plan, journal: Journal, progress: Progress) -> None:
    """Run what the journal lacks; what belongs to an episode is on disk before it counts as done."""
    count = len(plan.episodes)
    progress(len(journal), count)
    tasks = (
        Task(episode.index, _record_rule(episode.index, spec.options, journal))
        for episode in plan.episodes
        if episode.index not in journal
    )
    for row in runner(tasks):
        journal.add(row)
        progress(len(journal), count)


def _record_rule(index: int, options: EvaluateOptions, journal: Journal) -> RecordRule:
    """Return when to record an episode: never one that cannot be among the first --max-recordings."""
    if options.record == "all":
        return "always" if index < options.max_recordings else "never"
    is_possible = journal.num_recorded_before(index) < options.max_recordings
    return "failure" if options.record == "failures" and is_possible else "never"


def _recordings(runner: Runner, output: Path, options: EvaluateOptions, journal: Journal) -> dict[int, str]:
    """Return the names of the recordings by episode; run the worst episodes again where these are asked for.

    Episodes end in any order, so there may be recordings of failures beyond the first --max-recordings: they go.
    """
    if options.record != "worst":
        found = list(journal.recordings.items())
        for _, name in found[options.max_recordings :]:
            for kind in KINDS:
                (output / name).with_suffix(kind).unlink(missing_ok=True)
        return dict(found[: options.max_recordings])
    worst = sorted(worst_first(journal.episodes)[: options.max_recordings])
    rows = runner(iter([Task(index, "always") for index in worst]))
    return dict(sorted((row["metrics"]["index"], row["recording"]) for row in rows))


def provenance_of(plan: Plan, spec: EvaluationSpec) -> Provenance:
    """Return what the results of a plan rest on."""
    options, policy = spec.options, plan.policy
    return Provenance(
        possible_episodes=plan.num_possible,
        own_files=plan.own_files,
        policy={"name": policy.name, "sha256": policy.sha256, "path": spec.policy, "is_trusted": options.trust},
        scenarios=[
            scenario_row(scenario, str(folder))
            for scenario, folder in zip(plan.scenarios, options.scenario, strict=True)
        ],
        protocol={
            "backend": options.backend,
            "episodes": len(options.cases) or options.episodes,
            "seed": options.seed,
            "observation": policy.observation,
            "action": policy.action,
            **choices_of(options),
            "max_decisions": options.max_decisions,
            "grid": dataclasses.asdict(options.grid),
            **({"cases": [dataclasses.asdict(case) for case in options.cases]} if options.cases else {}),
            "conditions": [
                {"name": item.name, "changes": item.changes, "region": item.region} for item in plan.conditions
            ],
        },
    )
