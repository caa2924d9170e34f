"""aquanav-eval: score policies, compare scores, replay an episode."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import tyro

from aquanav_tools.cli.benchmark import BENCHMARK, BENCHMARK_FLAG, BenchmarkCommand, run_benchmark
from aquanav_tools.cli.command import NO_TERMINAL, run_command
from aquanav_tools.cli.evaluate_options import (
    CompareCommand,
    EvaluateCommand,
    ReplayCommand,
    SequentialCommand,
    StressCommand,
    WorstCommand,
)
from aquanav_tools.errors import PolicyError
from aquanav_tools.evaluate.options import (
    EvaluateOptions,
    ReplayOptions,
    SequentialOptions,
    StressOptions,
    WorstOptions,
)

if TYPE_CHECKING:
    from aquanav_tools.evaluate.evaluation import Evaluation
    from aquanav_tools.types import Progress

Options = TypeVar("Options")
Command = TypeVar("Command", EvaluateCommand, SequentialCommand)
DESCRIPTION = (
    "Score a policy in scenarios on fixed seeded starts. Writes results.json, episodes.parquet, report.html and rerun "
    "recordings. Policy files are read without running any code from them, unless --trust is given. Ends with exit "
    "code 8 where the policy itself failed in every episode: by an error, by hanging, or by what is no action.\n\n"
    "Example: aquanav-eval policy.zip --scenario out/han --episodes 50 --seed 0 -o out/eval\n"
    "In a fixed set of caves: aquanav-eval policy.zip --benchmark quick (with --help: its options).\n"
    "Also: aquanav-eval compare out/a out/b, aquanav-eval replay out/eval --episode 17, and aquanav-eval stress "
    "policy.zip --scenario out/han (each has --help)."
)
COMPARE = "Compare evaluations: the first with each other one, on the same episodes, with intervals and tests."
SEQUENTIAL_FLAG = "--sequential"
SEQUENTIAL = (
    "Fly two policies on the same episodes, in an order drawn over all scenarios, conditions and starts, and stop as "
    "soon as one proves better, or neither by as much as --smallest-difference, or --episodes are over. Equal policies "
    "are called different with a probability of 5 % at most, ones that far apart alike with 1 % at most, whenever one "
    "stops.\n\n"
    "Example: aquanav-eval compare --sequential a.zip b.zip --scenario out/han --starts anywhere --episodes 2000"
)
STRESS = (
    "Search for the starts, currents and sensor noise that break a policy, beside as many cases drawn at random, and "
    "save the worst as a protocol for aquanav-eval."
)
CORRECT = "Correct it and run again."
REPLAY = (
    "Fly an episode of an evaluation again, check that it repeats to the bit, and record it.\n\n"
    "To see why a policy fails: aquanav-eval replay out/eval --worst 10 (with --help: its options)."
)
WORST_FLAG = "--worst"
WORST = (
    "Fly the worst episodes of each condition again, in a benchmark of each tier, and show the seconds before their "
    "first contact: a page with stills and films.\n\n"
    "Example: aquanav-eval replay out/benchmark --worst 10"
)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if arguments[:1] == ["compare"] and SEQUENTIAL_FLAG in arguments:
        rest = [word for word in arguments[1:] if word != SEQUENTIAL_FLAG]
        name = f"aquanav-eval compare {SEQUENTIAL_FLAG}"
        run_command(
            SequentialCommand,
            _compare_pair_by_pair,
            name,
            SEQUENTIAL,
            defaults=partial(_defaults, kind=SequentialCommand),
            arguments=rest,
        )
    elif arguments[:1] == ["compare"]:
        run_command(CompareCommand, _compare, "aquanav-eval compare", COMPARE, arguments=arguments[1:])
    elif arguments[:1] == ["replay"] and any(word.split("=")[0] == WORST_FLAG for word in arguments):
        run_command(WorstCommand, _show_worst, f"aquanav-eval replay {WORST_FLAG}", WORST, arguments=arguments[1:])
    elif arguments[:1] == ["replay"]:
        run_command(ReplayCommand, _replay, "aquanav-eval replay", REPLAY, arguments=arguments[1:])
    elif arguments[:1] == ["stress"]:
        run_command(StressCommand, _stress, "aquanav-eval stress", STRESS, arguments=arguments[1:])
    elif any(word.split("=")[0] == BENCHMARK_FLAG for word in arguments):
        run_command(BenchmarkCommand, run_benchmark, "aquanav-eval", BENCHMARK, arguments=arguments)
    else:
        run_command(
            EvaluateCommand,
            _evaluate_all,
            "aquanav-eval",
            DESCRIPTION,
            defaults=partial(_defaults, kind=EvaluateCommand),
            arguments=arguments,
        )


def _evaluate_all(command: EvaluateCommand) -> None:
    evaluate_policies(_plain(EvaluateOptions, command))


def _plain(kind: type[Options], command: Any) -> Options:
    """Return the options of a command line as the class that the rooms below know."""
    return kind(**{field.name: getattr(command, field.name) for field in dataclasses.fields(kind)})  # type: ignore[arg-type]


def evaluate_policies(options: EvaluateOptions) -> None:
    """Evaluate each policy with a progress bar and print what came out; compare several.

    Raises:
        PolicyError: a policy itself failed in every episode. What was found is on disk all the same.
    """
    if len(options.policies) == 1:
        failures = [_evaluate_one(options, options.policies[0], options.output)]
    else:
        from aquanav_tools.evaluate.comparing import run_folders

        folders = run_folders(options.policies, options.output)
        failures = [_evaluate_one(options, *pair) for pair in zip(options.policies, folders, strict=True)]
        _compare(CompareCommand((options.output,), options.output))
    if any(failures):
        raise PolicyError(f"{' '.join(filter(None, failures))} Nothing was measured. {CORRECT}")


def _evaluate_one(options: EvaluateOptions, policy: str, folder: Path) -> str:
    """Evaluate a policy and print what came out; return why nothing did, where the policy failed in every episode."""
    from aquanav_tools.evaluate.failures import failure_text, is_failed_throughout

    _tell_choice(policy)
    evaluation = _evaluate(options, policy, folder)
    text = failure_text(policy, evaluation.episodes)
    if is_failed_throughout(evaluation.episodes):
        print(f"\n{_places(evaluation)}")
        return text
    print(_table(options, policy, evaluation))
    if text:
        print(f"warning: {text} They count as failures.", file=sys.stderr)
    return ""


def _defaults(arguments: Sequence[str], kind: type[Command]) -> Command | None:
    """Return the options with those of the protocol named after --protocol; None without one."""
    from aquanav_tools.cli.command import file_after

    name = file_after("--protocol", arguments)
    if name is None:
        return None
    from aquanav_tools.evaluate.protocol import read_protocol

    return kind(policies=tyro.MISSING, scenario=tyro.MISSING, **read_protocol(str(name), "--trust" in arguments))


def _evaluate(options: EvaluateOptions, policy: str, folder: Path) -> Evaluation:
    from aquanav_tools.evaluate.evaluation import evaluate

    with _episode_bar() as show:
        return evaluate(options, show, policy, folder)


def _tell_choice(policy: str) -> None:
    from aquanav_tools.evaluate.policies import choice_text

    if text := choice_text(policy):
        print(text)


@contextmanager
def _episode_bar() -> Iterator[Progress]:
    from tqdm import tqdm

    # The delay keeps an error in the arguments from leaving an empty bar behind.
    with tqdm(unit="episode", file=sys.stderr, delay=0.5, disable=NO_TERMINAL) as bar:

        def show(done: int, total: int) -> None:
            if bar.total is None:
                bar.initial = bar.n = done  # those of a stopped run say nothing about the speed of this one
            bar.total = total
            bar.update(done - bar.n)
            if done == total:
                bar.set_postfix_str("writing the report")

        yield show


def _stress(command: StressCommand) -> None:
    from aquanav_tools.evaluate.failures import failure_text, is_failed_throughout
    from aquanav_tools.evaluate.stress import WORST, stress
    from aquanav_tools.evaluate.stress_report import verdict

    options = _plain(StressOptions, command)
    _tell_choice(options.policy)
    with _episode_bar() as show:
        found = stress(options, show)
    files = f"Report:      {found.report}\nWorst cases: {options.output / WORST}, for aquanav-eval --protocol"
    episodes = [trial.metrics for trial in (*found.drawn, *found.searched)]
    text = failure_text(found.policy, episodes)
    if is_failed_throughout(episodes):
        print(f"\n{files}")
        raise PolicyError(f"{text} Nothing was found out about its dives. {CORRECT}")
    print(f"\n{found.policy} in {found.scenario.name}: {verdict(found)}\n")
    print(files)
    if text:
        print(f"warning: {text} They count as failures.", file=sys.stderr)


def _compare(options: CompareCommand) -> None:
    from aquanav_tools.evaluate.comparing import compare
    from aquanav_tools.evaluate.comparison_report import summary_text

    found = compare(options.evaluations, options.output)
    text = summary_text(found.methods, found.comparisons)
    print(f"\n{text}\n\nReport:      {found.report}\nNumbers:     {found.numbers}")


def _compare_pair_by_pair(command: SequentialCommand) -> None:
    from aquanav_tools.evaluate.comparison_report import summary_text
    from aquanav_tools.evaluate.paired_run import compare_pair_by_pair

    for policy in command.policies:
        _tell_choice(policy)
    with _episode_bar() as show:
        found = compare_pair_by_pair(_plain(SequentialOptions, command), show)
    text = summary_text(found.methods, found.comparisons)
    print(f"\n{text}\n\nReport:      {found.report}\nNumbers:     {found.numbers}")


def _replay(command: ReplayCommand) -> None:
    from tqdm import tqdm

    from aquanav_tools.evaluate.replaying import replay

    options = _plain(ReplayOptions, command)
    with tqdm(unit="frame", file=sys.stderr, delay=0.5, disable=True if options.film is None else NO_TERMINAL) as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        found = replay(options, show)
    episode, filmed = found.episode, "" if found.film is None else f"\nFilm: {found.film}"
    filmed += "" if found.bag is None else f"\nBag: {found.bag}"
    filmed += "" if found.track is None else f"\nTrack: {found.track}"
    print(
        f"Episode {episode.index} repeats to the bit: {episode.outcome} after {episode.time:.1f} s with "
        f"{episode.collisions} collisions (SHA-256 {episode.digest[:12]}).\n"
        f"Look at it with: rerun {found.recording}{filmed}"
    )


def _show_worst(command: WorstCommand) -> None:
    from aquanav_tools.evaluate.worst import show_worst

    with _episode_bar() as show:
        found = show_worst(_plain(WorstOptions, command), show)
    shown = [one for rows in found.shown.values() for one in rows]
    print(f"\n{len(shown)} episodes, {sum(not one.difference for one in shown)} of them the same to the bit as before.")
    print(f"Page: {found.page}")
    for one in shown:
        if one.difference:
            print(f"warning: {one.difference}", file=sys.stderr)


def _table(options: EvaluateOptions, policy: str, evaluation: Evaluation) -> str:
    from aquanav_tools.evaluate.summary_text import bound, estimate_text, infeasible_text, metres, percent, variety_text

    summary = evaluation.summary
    bounded, limit = bound(summary)
    mean, least = metres(summary.means["mean_clearance"].mean), metres(summary.min_clearance)
    rows = {
        "success": percent(summary.success),
        "collision-free success": percent(summary.collision_free_success),
        bounded: f"{limit} of episodes, at 95 % confidence",
        "SPL": estimate_text(summary.means["spl"]),
        "collisions per 100 m": estimate_text(summary.collisions_per_100m),
        "clearance, mean / smallest": f"{mean} m / {least} m",
    }
    places = ", ".join(map(str, options.scenario))
    lines = [f"\n{policy} in {places}, {summary.episodes} episodes, 95 % intervals in brackets"]
    lines += [f"  {name:<29}{value}" for name, value in rows.items()]
    variety = variety_text(evaluation.episodes, summary, evaluation.num_possible)
    missed = ["", infeasible_text(summary)] if summary.infeasible_episodes else []
    return "\n".join([*lines, "", variety, *missed, "", _places(evaluation)])


def _places(evaluation: Evaluation) -> str:
    """Return where the files of an evaluation lie."""
    lines = [f"Report:      {evaluation.report}", f"Numbers:     {evaluation.results}"]
    if evaluation.recordings:
        recorded = f"{len(evaluation.recordings)} of {evaluation.summary.episodes} episodes"
        lines.append(f"Recordings:  {recorded}; look at one with: rerun {evaluation.recordings[0]}")
    return "\n".join(lines)
