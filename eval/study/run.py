"""Repeat the paper's comparisons: train every variant with many seeds, score every policy, keep numbers and plots.

    python eval/study/run.py                         # 10 seeds of all variants: about 4 hours on two idle cores
    python eval/study/run.py --seeds 3               # the first three
    python eval/study/run.py --only curriculum safe  # these variants
    python eval/study/run.py --seeds 0               # only the page and its plots, from the runs that are kept

Each run trains in a process of its own (aquanav-train on the batch), and is then scored (aquanav-eval, the batch) in
the test caves and in the scan of Han-sur-Lesse, which is left out where the data folder is absent. A finished run adds
a line to eval/results/study.jsonl and is not repeated; one that was stopped goes on from its checkpoint.
"""

from __future__ import annotations

import argparse
import csv
import json
import sys
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # the study is no part of the package

from eval.child import Ended, run_child
from eval.study.page import write_page
from eval.study.variants import CAVES, CURRENTS, VARIANTS

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "eval" / "results"
PIPELINE = 'extends = "{}"\nbackend = "batch"\nnum_envs = {}\nvalidation = []\n'
NUM_VEHICLES = 512
"""At once; 40 decisions of each make the original's buffer of 20,480."""
NUM_EPISODES = 40
"""Per cave and current: each start of a shipped cave once."""
EVALUATION_SEED = 1000
MEANS = ("collisions", "mean_clearance", "min_clearance", "time", "spl")
NUM_CURVE_POINTS = 30
TIMEOUT = 4 * 3600.0


def parse_arguments() -> argparse.Namespace:
    """Return the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10, help="training runs of each variant, with seeds from 0")
    parser.add_argument("--only", nargs="+", choices=list(VARIANTS), default=list(VARIANTS), help="variants to run")
    parser.add_argument("--jobs", type=int, default=2, help="runs at the same time")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data", help="folder with the scans")
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "study", help="where runs and scores go")
    return parser.parse_args()


def main() -> None:
    """Run what is not done yet, then write the page."""
    arguments = parse_arguments()
    store = RESULTS / "study.jsonl"
    done = {(run["variant"], run["seed"]) for run in read_runs(store)}
    # Seed by seed, so that whatever was done when the study is stopped compares all variants.
    todo = [(name, seed) for seed in range(arguments.seeds) for name in arguments.only if (name, seed) not in done]
    print(f"{len(done)} runs are kept, {len(todo)} are to do.", flush=True)
    began = time.monotonic()
    caves = scenarios(arguments) if todo else ()
    with ThreadPoolExecutor(arguments.jobs) as threads:
        running = [threads.submit(run_variant, name, seed, caves, arguments.output) for name, seed in todo]
        for place, future in enumerate(as_completed(running), 1):
            run = future.result()
            with store.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(run) + "\n")
            left = (time.monotonic() - began) / place * (len(todo) - place)
            print(f"{place}/{len(todo)} {run['variant']}, seed {run['seed']}: {told(run)}; {left / 60:.0f} min left")
            sys.stdout.flush()
    write_page(read_runs(store), RESULTS)


def read_runs(store: Path) -> list[dict[str, Any]]:
    """Return the runs that are kept, in the order of variants and seeds."""
    lines = store.read_text(encoding="utf-8").splitlines() if store.exists() else []
    return sorted(map(json.loads, lines), key=lambda run: (list(VARIANTS).index(run["variant"]), run["seed"]))


def scenarios(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Return the caves to score in; Han-sur-Lesse is built first."""
    scan = arguments.data / "scan_han_sur_lesse" / "cave.stl"
    if not scan.is_file():
        print(f"There is no {scan}: Han-sur-Lesse is left out. Name its folder with --data.", flush=True)
        return CAVES[:-1]
    folder = arguments.output / CAVES[-1]
    if not (folder / "scenario.toml").is_file():
        aquanav("build_cave", str(scan), "-o", str(folder), "--overwrite")
    return (*CAVES[:-1], str(folder))


def run_variant(name: str, seed: int, caves: tuple[str, ...], output: Path) -> dict[str, Any]:
    """Train and score one policy; return what the study keeps of it."""
    folder = output / f"{name}-{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    pipeline = folder / "pipeline.toml"
    pipeline.write_text(PIPELINE.format(VARIANTS[name], NUM_VEHICLES), encoding="utf-8")
    training = aquanav("train", "--pipeline", str(pipeline), "--seed", str(seed), "-o", str(folder / "train"))
    conditions = ["--current", "full", "--grid.current", *map(str, CURRENTS.values()), "--seed", str(EVALUATION_SEED)]
    conditions += ["--episodes", str(NUM_EPISODES), "--backend", "batch", "--record", "none"]
    policy = str(folder / "train" / "policy.zip")
    scoring = aquanav("evaluate", policy, "--scenario", *caves, *conditions, "-o", str(folder / "eval"))
    results = json.loads((folder / "eval" / "results.json").read_text(encoding="utf-8"))
    card = json.loads((folder / "train" / "train.json").read_text(encoding="utf-8"))
    return {
        "variant": name,
        "seed": seed,
        "training_cpu_s": round(training.cpu_seconds),
        "scoring_cpu_s": round(scoring.cpu_seconds),
        "versions": card["versions"],
        "scenarios": {scenario["name"]: scenario["content_hash"] for scenario in results["scenarios"]},
        "curve": curve(folder / "train" / "curve.csv"),
        "scores": scores(results["episodes"]),
    }


def aquanav(command: str, *arguments: str) -> Ended:
    """Return how one of our commands ended.

    Raises:
        RuntimeError: it did not end well; the message has the end of what it said.
    """
    program = f"from aquanav_tools.cli.{command} import main; main()"
    ended = run_child([sys.executable, "-c", program, *arguments], TIMEOUT)
    if ended.exit_code != 0:
        raise RuntimeError(f"{command} {' '.join(arguments)} ended with {ended.exit_code}: {ended.errors[-2000:]}")
    return ended


def curve(path: Path) -> list[list[float]]:
    """Return decisions, and shares of success and of collision-free success of the last episodes, at some points."""
    with path.open(encoding="utf-8") as stream:
        rows = [row for row in csv.DictReader(stream) if row["success_rate"] not in ("", "nan")]
    kept = rows[:: max(1, len(rows) // NUM_CURVE_POINTS)]
    return [[float(row[key]) for key in ("steps", "success_rate", "clean_success_rate")] for row in kept]


def scores(episodes: list[dict[str, Any]]) -> dict[str, dict[str, dict[str, float]]]:
    """Return rates and means by cave and current."""
    found: dict[str, dict[str, dict[str, float]]] = {}
    for cave in dict.fromkeys(episode["scenario"] for episode in episodes):
        for current, share in CURRENTS.items():
            flown = [e for e in episodes if (e["scenario"], e["condition"]) == (cave, f"current x{share:g}")]
            reached = [episode for episode in flown if episode["outcome"] == "success"]
            clean = [episode for episode in reached if episode["collisions"] == 0]
            means = {name: round(float(np.mean([e[name] for e in flown])), 4) for name in MEANS}
            found.setdefault(cave, {})[current] = {
                "episodes": len(flown),
                "success": len(reached) / len(flown),
                "collision_free": len(clean) / len(flown),
                **means,
            }
    return found


def told(run: dict[str, Any]) -> str:
    """Return a run in a few words."""
    rates = [score for cave in run["scores"].values() for score in cave.values()]
    success, clean = (float(np.mean([rate[name] for rate in rates])) for name in ("success", "collision_free"))
    return f"success {success:.0%}, collision-free {clean:.0%}, {run['training_cpu_s']} s of processor time to learn"


if __name__ == "__main__":
    main()
