"""aquanav-eval: score policies, compare scores, fly an episode again."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from aquanav_tools.cli.command import run_command
from aquanav_tools.evaluate.options import CompareOptions, EvaluateOptions, ReplayOptions, StressOptions

if TYPE_CHECKING:
    from aquanav_tools.evaluate.evaluation import Evaluation
    from aquanav_tools.types import Progress

DESCRIPTION = (
    "Score a policy in scenarios on fixed seeded starts. Writes results.json, episodes.parquet, report.html and rerun "
    "recordings. Policy files are read without running any code from them, unless --trust is given.\n\n"
    "Example: aquanav-eval policy.zip --scenario out/han --episodes 50 --seed 0 -o out/eval\n"
    "Also: aquanav-eval compare out/a out/b, aquanav-eval replay out/eval --episode 17, and aquanav-eval stress "
    "policy.zip --scenario out/han (each has --help)."
)
COMPARE = "Compare evaluations: the first with each other one, on the same episodes, with intervals and tests."
STRESS = (
    "Search for the starts, currents and sensor noise that break a policy, beside as many cases drawn at random, and "
    "save the worst as a protocol for aquanav-eval."
)
REPLAY = "Fly an episode of an evaluation again, check that it repeats to the bit, and record it."


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if arguments[:1] == ["compare"]:
        run_command(CompareOptions, _compare, "aquanav-eval compare", COMPARE, arguments=arguments[1:])
    elif arguments[:1] == ["replay"]:
        run_command(ReplayOptions, _replay, "aquanav-eval replay", REPLAY, arguments=arguments[1:])
    elif arguments[:1] == ["stress"]:
        run_command(StressOptions, _stress, "aquanav-eval stress", STRESS, arguments=arguments[1:])
    else:
        run_command(
            EvaluateOptions, evaluate_policies, "aquanav-eval", DESCRIPTION, defaults=_defaults, arguments=arguments
        )


def evaluate_policies(options: EvaluateOptions) -> None:
    """Evaluate each policy with a progress bar and print what came out; compare several."""
    if len(options.policies) == 1:
        print(_table(options, options.policies[0], _evaluate(options, options.policies[0], options.output)))
        return
    from aquanav_tools.evaluate.comparing import run_folders

    for policy, folder in zip(options.policies, run_folders(options.policies, options.output), strict=True):
        print(_table(options, policy, _evaluate(options, policy, folder)))
    _compare(CompareOptions((options.output,), options.output))


def _defaults(arguments: Sequence[str]) -> EvaluateOptions | None:
    """Return the options with those of the protocol named after --protocol; None without one."""
    from aquanav_tools.cli.command import file_after

    name = file_after("--protocol", arguments)
    if name is None:
        return None
    from aquanav_tools.evaluate.protocol import read_protocol

    return EvaluateOptions(policies=tyro.MISSING, scenario=tyro.MISSING, **read_protocol(str(name)))


def _evaluate(options: EvaluateOptions, policy: str, folder: Path) -> Evaluation:
    from aquanav_tools.evaluate.evaluation import evaluate

    with _episode_bar() as show:
        return evaluate(options, show, policy, folder)


@contextmanager
def _episode_bar() -> Iterator[Progress]:
    from tqdm import tqdm

    # The delay keeps an error in the arguments from leaving an empty bar behind.
    with tqdm(unit="episode", file=sys.stderr, delay=0.5) as bar:

        def show(done: int, total: int) -> None:
            if bar.total is None:
                bar.initial = bar.n = done  # those of a stopped run say nothing about the speed of this one
            bar.total = total
            bar.update(done - bar.n)
            if done == total:
                bar.set_postfix_str("writing the report")

        yield show


def _stress(options: StressOptions) -> None:
    from aquanav_tools.evaluate.stress import WORST, stress
    from aquanav_tools.evaluate.stress_report import verdict

    with _episode_bar() as show:
        found = stress(options, show)
    print(f"\n{found.policy} in {found.scenario.name}: {verdict(found)}\n")
    print(f"Report:      {found.report}\nWorst cases: {options.output / WORST}, for aquanav-eval --protocol")


def _compare(options: CompareOptions) -> None:
    from aquanav_tools.evaluate.comparing import compare

    print(compare(options))


def _replay(options: ReplayOptions) -> None:
    from tqdm import tqdm

    from aquanav_tools.evaluate.replaying import replay

    with tqdm(unit="frame", file=sys.stderr, delay=0.5, disable=options.film is None) as bar:

        def show(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        told = replay(options, show)
    print(told)


def _table(options: EvaluateOptions, policy: str, evaluation: Evaluation) -> str:
    from aquanav_tools.evaluate.reporting import estimate_text, metres, percent, share
    from aquanav_tools.evaluate.summary import infeasible_sentence

    summary = evaluation.summary
    mean, least = metres(summary.means["mean_clearance"].mean), metres(summary.min_clearance)
    rows = {
        "success": percent(summary.success),
        "collision-free success": percent(summary.collision_free_success),
        "fails in at most": f"{share(summary.failure_bound)} of episodes, at 95 % confidence",
        "SPL": estimate_text(summary.means["spl"]),
        "collisions per 100 m": estimate_text(summary.collisions_per_100m),
        "clearance, mean / smallest": f"{mean} m / {least} m",
    }
    count = f"{summary.episodes} episodes"
    if summary.distinct_episodes < summary.episodes:
        count += f" ({summary.distinct_episodes} different, which count)"
    places = ", ".join(map(str, options.scenario))
    lines = [f"\n{policy} in {places}, {count}, 95 % intervals in brackets"]
    lines += [f"  {name:<28}{value}" for name, value in rows.items()]
    if summary.infeasible_episodes:
        lines += ["", infeasible_sentence(summary)]
    lines += ["", f"Report:      {evaluation.report}", f"Numbers:     {evaluation.results}"]
    if evaluation.recordings:
        recorded = f"{len(evaluation.recordings)} of {summary.episodes} episodes"
        lines.append(f"Recordings:  {recorded}; look at one with: rerun {evaluation.recordings[0]}")
    return "\n".join(lines)
