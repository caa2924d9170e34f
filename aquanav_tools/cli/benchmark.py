"""aquanav-eval --benchmark: the score of a policy in a fixed set of caves."""

from __future__ import annotations

import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated

import tyro

from aquanav_tools.benchmark.options import BenchmarkOptions

BENCHMARK_FLAG = "--benchmark"
BENCHMARK = (
    "Score a policy in a benchmark: a fixed set of caves in tiers, each dived from as many starts under its tier's "
    "rules. Caves that are missing are built first. Prints the mean and the interquartile mean over caves of "
    "collision-free success with intervals, and each tier; writes score.json, results.json, episodes.parquet and "
    "report.html.\n\n"
    "Example: aquanav-eval policy.zip --benchmark quick -o out/benchmark"
)


@dataclass(frozen=True, kw_only=True)
class BenchmarkCommand(BenchmarkOptions):
    """How a policy is scored in a benchmark."""

    policy: Annotated[str, tyro.conf.Positional]
    """As aquanav-eval takes it without a benchmark: a zip, an ONNX file, a training run's folder, a baseline."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("out/benchmark")
    """Folder for score.json, results.json, episodes.parquet and report.html; an earlier run in it is replaced."""


def run_benchmark(command: BenchmarkCommand) -> None:
    """Score the policy with a progress bar and print the score."""
    from aquanav_tools.api.bars import bar
    from aquanav_tools.benchmark.report import changed_text, score_text
    from aquanav_tools.benchmark.run import run_benchmark as run
    from aquanav_tools.benchmark.submission import check_can_submit, submission_of, write_submission

    options = BenchmarkOptions(**{field.name: getattr(command, field.name) for field in fields(BenchmarkOptions)})
    if options.submit is not None:
        check_can_submit(options)
    with bar("", "cave") as show:
        found = run(options, show)
    print(f"\n{score_text(found.benchmark, found.policy.name, found.score)}\n")
    print(f"Report:      {found.report}\nNumbers:     {found.numbers}")
    if options.submit is not None:
        path = options.output / f"{options.submit}.json"
        write_submission(submission_of(options, found), path)
        print(f"Submission:  {path}")
    if text := changed_text(found.changed_caves):
        print(f"warning: {text}", file=sys.stderr)
