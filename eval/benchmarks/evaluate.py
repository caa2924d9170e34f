"""Measure evaluations: how much memory they take by the number of episodes, and how much recording slows them.

    python eval/benchmarks/evaluate.py memory [--sizes 50 500 2000]
    python eval/benchmarks/evaluate.py recording --policy policy.zip --scenario cave-test-1 [--episodes 60] [--rounds 2]
    python eval/benchmarks/evaluate.py --smoke

Each measurement is a run of aquanav-eval from its start to its report. Memory: the largest resident size of the process
that leads and of the largest that flies, looked at ten times a second, in a straight tube. Recording: of every episode
and of none, in turns, so that a busy machine is as busy for both; CPU time is that of all processes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

sys.path.insert(0, str(Path(__file__).parents[2]))  # the tiny caves live with the tests

from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.shipped import scenario_folder
from eval.smoke import parser_of
from tests.caves import tube_scenario

COMMAND = (sys.executable, "-c", "from aquanav_tools.cli.evaluate import main; main()")
BACKENDS = {"pybullet": ("--workers", "2"), "batch": ("--backend", "batch")}
LOOK_EVERY = 0.1
"""s"""
SHORT = 20
"""Decisions of an episode whose memory counts: what is kept of an episode does not grow with them."""


def start(policy: str, scenario: Path, episodes: int, output: Path, *words: str) -> subprocess.Popen[bytes]:
    """Start an evaluation."""
    given = [policy, "--scenario", scenario, "--episodes", episodes, "-o", output, *words]
    log = (output.parent / "log.txt").open("wb")
    root = Path(__file__).parents[2]
    paths = os.pathsep.join([str(root), os.environ.get("PYTHONPATH", "")])
    return subprocess.Popen(
        [*COMMAND, *map(str, given)], stdout=log, stderr=log, env={**os.environ, "PYTHONPATH": paths}
    )


def check(code: int, output: Path) -> None:
    """End where an evaluation failed, with what it said."""
    if code:
        sys.exit((output.parent / "log.txt").read_text(errors="replace")[-3000:])


def peaks(process: subprocess.Popen[bytes]) -> tuple[float, float]:
    """Return the largest resident size of a running process and of the largest of its children, MB, at its end."""
    lead = psutil.Process(process.pid)
    most = [0.0, 0.0]
    while process.poll() is None:
        try:
            sizes = [child.memory_info().rss for child in lead.children(recursive=True)]
            most = [max(most[0], lead.memory_info().rss), max(most[1], *sizes, 0)]
        except psutil.NoSuchProcess:
            pass  # it ended meanwhile
        time.sleep(LOOK_EVERY)
    return most[0] / 1e6, most[1] / 1e6


def measure_memory(backends: list[str], sizes: list[int]) -> None:
    """Print the table of memory."""
    print("| backend | episodes | leads, MB | flies, MB | episodes.jsonl, kB each |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        scenario, output = Path(folder) / "tube", Path(folder) / "eval"
        write_scenario(tube_scenario(), scenario)
        for backend in backends:
            for size in sizes:
                process = start(
                    "baseline:random", scenario, size, output, "--record", "none", "--max-decisions", str(SHORT),
                    *BACKENDS[backend],
                )  # fmt: skip
                lead, flies = peaks(process)
                check(process.returncode, output)
                journal = (output / "episodes.jsonl").stat().st_size / 1e3 / size
                print(f"| {backend} | {size:,} | {lead:.0f} | {flies:.0f} | {journal:.2f} |", flush=True)


def measure_recording(
    backends: list[str], policy: str, scenario: Path, episodes: int, rounds: int, *words: str
) -> None:
    """Print the table of recording."""
    print("| backend | recorded | CPU, s | wall, s | flying, s | beside none, CPU and wall |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        output = Path(folder) / "eval"
        for backend in backends:
            sums = {"none": [0.0] * 3, "all": [0.0] * 3}
            for _ in range(rounds):
                for record, times in sums.items():
                    before, clock = os.times(), time.perf_counter()
                    recorded = ("--record", record, "--max-recordings", str(episodes))
                    process = start(policy, scenario, episodes, output, *recorded, *BACKENDS[backend], *words)
                    check(process.wait(), output)
                    after = os.times()
                    cpu = sum(after[2:4]) - sum(before[2:4])  # of children that have ended
                    flying = json.loads((output / "run.json").read_text())["seconds"]
                    for number, value in enumerate((cpu, time.perf_counter() - clock, flying)):
                        times[number] += value / rounds
            for record, (cpu, wall, flying) in sums.items():
                beside = f"{cpu / sums['none'][0]:.2f}, {wall / sums['none'][1]:.2f}"
                print(f"| {backend} | {record} | {cpu:.1f} | {wall:.1f} | {flying:.1f} | {beside} |", flush=True)


def main() -> None:
    """Measure what is asked for."""
    parser = parser_of(__doc__)
    parser.add_argument("what", choices=("memory", "recording"), nargs="?", default="memory")
    parser.add_argument("--only", choices=BACKENDS, nargs="+", default=list(BACKENDS))
    parser.add_argument("--sizes", type=int, nargs="+", default=[50, 500, 2000])
    parser.add_argument("--policy", default="baseline:reactive")
    parser.add_argument("--scenario", default="cave-test-1")
    parser.add_argument("--episodes", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=2)
    given = parser.parse_args()
    if given.smoke:
        measure_memory(given.only, [2])
        with tempfile.TemporaryDirectory() as folder:
            write_scenario(tube_scenario(), Path(folder) / "tube")
            measure_recording(["pybullet"], "baseline:random", Path(folder) / "tube", 1, 1, "--max-decisions", "5")
    elif given.what == "memory":
        measure_memory(given.only, given.sizes)
    else:
        measure_recording(given.only, given.policy, scenario_folder(given.scenario), given.episodes, given.rounds)


if __name__ == "__main__":
    main()
