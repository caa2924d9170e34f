"""aquanav-eval: score a policy in a scenario."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from aquanav_tools.cli.command import run_command
from aquanav_tools.evaluate.options import EvaluateOptions

if TYPE_CHECKING:
    from aquanav_tools.evaluate.evaluation import Evaluation

DESCRIPTION = (
    "Score a policy in a scenario on fixed seeded starts. Writes results.json, report.html and one rerun recording per "
    "episode. Policies are loaded without running any code from them.\n\n"
    "Example: aquanav-eval policy.zip --scenario out/han --episodes 50 --seed 0 -o out/eval"
)


def main() -> None:
    """Run the command."""
    run_command(EvaluateOptions, evaluate_policy, prog="aquanav-eval", description=DESCRIPTION)


def evaluate_policy(options: EvaluateOptions) -> None:
    """Evaluate with a progress bar and print what came out."""
    from tqdm import tqdm

    from aquanav_tools.evaluate.evaluation import evaluate

    # The delay keeps an error in the arguments from leaving an empty bar behind.
    with tqdm(total=options.episodes, unit="episode", file=sys.stderr, delay=0.5) as bar:

        def show(done: int, total: int) -> None:
            bar.update(done - bar.n)
            if done == total:
                bar.set_postfix_str("writing the report")

        evaluation = evaluate(options, show)
    print(_table(options, evaluation))


def _table(options: EvaluateOptions, evaluation: Evaluation) -> str:
    from aquanav_tools.evaluate.reporting import percent

    summary = evaluation.summary
    rows = {
        "success": percent(summary.success),
        "collision-free success": percent(summary.collision_free_success),
        "SPL": f"{summary.spl:.2f}",
        "collisions per episode": f"{summary.collisions_per_episode:.2f}",
        "clearance, mean / smallest": f"{summary.mean_clearance:.2f} m / {summary.min_clearance:.2f} m",
    }
    lines = [f"\n{options.policy} in {options.scenario}, {summary.episodes} episodes, 95 % intervals in brackets"]
    lines += [f"  {name:<28}{value}" for name, value in rows.items()]
    lines += ["", f"Report:      {evaluation.report}", f"Numbers:     {evaluation.results}"]
    if evaluation.recordings:
        count = f"{len(evaluation.recordings)} of {summary.episodes} episodes"
        lines.append(f"Recordings:  {count}; look at one with: rerun {evaluation.recordings[0]}")
    return "\n".join(lines)
