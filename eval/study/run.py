"""Repeat the paper's comparisons: train every variant with many seeds, score every policy, keep numbers and plots.

    python eval/study/run.py caves                         # 10 seeds of all variants: hours on two idle cores
    python eval/study/run.py original                      # the same in the original's caves, with its vehicle
    python eval/study/run.py bays --seeds 3                # the first three
    python eval/study/run.py caves --only curriculum safe  # these variants
    python eval/study/run.py caves --seeds 0               # only the page and its plots, from the runs that are kept
    python eval/study/run.py caves --again                 # one run more of each variant, held against those
    python eval/study/run.py caves --again --only safe --seeds 5    # five of this one, where one lies apart

Each run trains in a process of its own (aquanav-train), and is then scored (aquanav-eval). What does not ship is built
from the data folder first; without one, "caves" leaves out the scan of Han-sur-Lesse, and "original" cannot be run. A
finished run adds a line to eval/results/study-NAME.jsonl and is not repeated; one that was stopped goes on from its
checkpoint. With --again runs are kept in study-NAME-again.jsonl, and the page tells whether they lie where the others
do; delete that file to do them once more by newer code.
"""

from __future__ import annotations

import argparse
import csv
import dataclasses
import json
import sys
import time
from concurrent.futures import ThreadPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

sys.path.insert(0, str(Path(__file__).parents[2]))  # the study is no part of the package

from aquanav_tools.train.episodes import with_new_names
from aquanav_tools.train.pipeline import read_pipeline
from eval.study.again import section
from eval.study.commands import aquanav
from eval.study.page import write_page
from eval.study.places import built_places
from eval.study.studies import AS_GIVEN, STUDIES, Study

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "eval" / "results"
EVALUATION_SEED = 1000
MEANS = ("collisions", "mean_clearance", "min_clearance", "time", "spl")
NUM_CURVE_POINTS = 30


def parse_arguments() -> argparse.Namespace:
    """Return the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=list(STUDIES))
    parser.add_argument(
        "--seeds",
        type=int,
        help="training runs of each variant, with seeds from 0; if not given, 10, or 1 with --again",
    )
    parser.add_argument("--only", nargs="+", default=[], help="variants to run, when not all")
    parser.add_argument("--again", action="store_true", help="runs by today's code, beside those that are kept")
    parser.add_argument("--jobs", type=int, default=2, help="runs at the same time")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data", help="folder with the scans")
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "study", help="where runs and scores go")
    arguments = parser.parse_args()
    arguments.output /= arguments.study + "-again" * arguments.again  # studies have variants of the same name
    return arguments


def main() -> None:
    """Run what is not done yet, then write the page."""
    arguments = parse_arguments()
    study, kept = STUDIES[arguments.study], RESULTS / f"study-{arguments.study}.jsonl"
    repeated = RESULTS / f"study-{arguments.study}-again.jsonl"
    store, default = (repeated, 1) if arguments.again else (kept, 10)
    seeds = default if arguments.seeds is None else arguments.seeds
    done = {(run["variant"], run["seed"]) for run in read_runs(store, study)}
    names = [name for name in study.variants if name in arguments.only or not arguments.only]
    # Seed by seed, so that whatever was done when the study is stopped compares all variants.
    todo = [(name, seed) for seed in range(seeds) for name in names if (name, seed) not in done]
    print(f"{len(done)} runs are kept, {len(todo)} are to do.", flush=True)
    began = time.monotonic()
    places = built_places((*study.places, *study.caves.values()), arguments.data, arguments.output) if todo else {}
    with ThreadPoolExecutor(arguments.jobs) as threads:
        running = [threads.submit(run_variant, study, *one, places, arguments.output) for one in todo]
        for place, future in enumerate(as_completed(running), 1):
            run = future.result()
            with store.open("a", encoding="utf-8") as stream:
                stream.write(json.dumps(run) + "\n")
            left = (time.monotonic() - began) / place * (len(todo) - place)
            text = (
                f"{place}/{len(todo)} {run['variant']}, seed {run['seed']}: {scores_of(run)}; {left / 60:.0f} min left"
            )
            print(text, flush=True)
    runs, again = read_runs(kept, study), read_runs(repeated, study)
    write_page(arguments.study, study, runs, section(arguments.study, study, runs, again), RESULTS)


def read_runs(store: Path, study: Study) -> list[dict[str, Any]]:
    """Return the runs that are kept, in the order of variants and seeds."""
    lines = store.read_text(encoding="utf-8").splitlines() if store.exists() else []
    return sorted(map(json.loads, lines), key=lambda run: (list(study.variants).index(run["variant"]), run["seed"]))


def run_variant(study: Study, name: str, seed: int, places: dict[str, str], output: Path) -> dict[str, Any]:
    """Train and score one policy, in places by name and where they lie; return what the study keeps of it."""
    folder = output / f"{name}-{seed}"
    folder.mkdir(parents=True, exist_ok=True)
    pipeline = folder / "pipeline.toml"
    pipeline.write_text(tomli_w.dumps(pipeline_table(study, name, places)), encoding="utf-8")
    training = aquanav("train", "--pipeline", str(pipeline), "--seed", str(seed), "-o", str(folder / "train"))
    conditions = ["--episodes", str(study.episodes), "--seed", str(EVALUATION_SEED), "--backend", "batch"]
    shares = [str(share) for share in study.currents.values() if share is not None]
    if shares:
        conditions += ["--current", "full", "--grid.current", *shares]
    policy = str(folder / "train" / study.policy)
    scenarios = [places[place] for place in study.places if place in places]
    scoring = aquanav(
        "evaluate", policy, "--scenario", *scenarios, *conditions, "--record", "none", "-o", str(folder / "eval")
    )
    results = json.loads((folder / "eval" / "results.json").read_text(encoding="utf-8"))
    card = json.loads((folder / "train" / "train.json").read_text(encoding="utf-8"))
    return {
        "variant": name,
        "seed": seed,
        "training_cpu_s": round(training.cpu_seconds),
        "scoring_cpu_s": round(scoring.cpu_seconds),
        "versions": card["versions"],
        "policy_sha256": results["policy"]["sha256"],
        "scenarios": {scenario["name"]: scenario["content_hash"] for scenario in results["scenarios"]},
        "curve": curve(folder / "train" / "curve.csv"),
        "scores": scores(study, results["episodes"]),
    }


def pipeline_table(study: Study, name: str, places: dict[str, str]) -> dict[str, Any]:
    """Return what a variant's pipeline file says, with the study's settings and caves above it."""
    table = {**study.variants[name], **study.settings}
    if study.caves:
        overrides = {key: value for key, value in table.items() if key != "extends"}
        lessons = [dataclasses.asdict(lesson) for lesson in read_pipeline(table["extends"], overrides).lessons]
        for lesson in lessons:
            lesson["scenario"] = places[study.caves[lesson["scenario"]]]
        table["lessons"] = [{key: value for key, value in lesson.items() if value is not None} for lesson in lessons]
    return table


def curve(path: Path) -> list[list[float]]:
    """Return decisions, and fractions of success and of collision-free success of the last episodes, at some points."""
    with path.open(encoding="utf-8") as stream:
        rows = [with_new_names(row) for row in csv.DictReader(stream) if row["success_rate"] not in ("", "nan")]
    kept = rows[:: max(1, len(rows) // NUM_CURVE_POINTS)]
    return [[float(row[key]) for key in ("steps", "success_rate", "collision_free_success")] for row in kept]


def scores(study: Study, episodes: list[dict[str, Any]]) -> dict[str, dict[str, dict[str, float]]]:
    """Return rates and means by place and current."""
    found: dict[str, dict[str, dict[str, float]]] = {}
    for place in dict.fromkeys(episode["scenario"] for episode in episodes):
        for current, share in study.currents.items():
            condition = AS_GIVEN if share is None else f"current x{share:g}"
            flown = [e for e in episodes if (e["scenario"], e["condition"]) == (place, condition)]
            reached = [episode for episode in flown if episode["outcome"] == "success"]
            clean = [episode for episode in reached if episode["collisions"] == 0]
            means = {name: round(float(np.mean([e[name] for e in flown])), 4) for name in MEANS}
            found.setdefault(place, {})[current] = {
                "episodes": len(flown),
                "success": len(reached) / len(flown),
                "collision_free_success": len(clean) / len(flown),
                **means,
            }
    return found


def scores_of(run: dict[str, Any]) -> str:
    """Return a run in a few words."""
    rates = [score for place in run["scores"].values() for score in place.values()]
    success, clean = (float(np.mean([rate[name] for rate in rates])) for name in ("success", "collision_free_success"))
    return f"success {success:.0%}, collision-free {clean:.0%}, {run['training_cpu_s']} s of processor time to learn"


if __name__ == "__main__":
    main()
