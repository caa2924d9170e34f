"""Score the shipped baselines in the test caves and in fresh caves of the same generator, still and at full current.

    python eval/study/baselines.py                     # about an hour of processor time
    python eval/study/baselines.py --fresh 2 --episodes 4 --baselines reactive   # a first look, in some minutes

The fresh caves are drawn, by a rule from fixed seeds, from the ranges that the training caves span. Nothing was tuned
on them. Built caves and finished evaluations in the output folder are kept. Writes eval/results/baselines.md.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import textwrap
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

sys.path.insert(0, str(Path(__file__).parents[2]))  # the study is no part of the package

from aquanav_tools.build.journal import Journal
from aquanav_tools.build.shipped_scenarios import ShippedScenario, build_gallery, read_shipped
from aquanav_tools.errors import AquanavError
from aquanav_tools.evaluate.statistics import wilson
from aquanav_tools.shipped import shipped_names
from aquanav_tools.synthetic.galleries import GalleryOptions
from aquanav_tools.types import silent
from eval.study.commands import aquanav

ROOT = Path(__file__).parents[2]
BASELINES = ("random", "reactive", "reference", "oracle")
CURRENTS = {"still": 0, "full": 1}
"""Shares of the full current (0.5 m/s at the narrowest section)."""
FRESH_SEED = 20_261_125
"""Of the fresh caves: the day they were drawn. No cave was drawn and left aside for how a policy fares in it."""
MAX_DRAWS = 20
WIDTH = 130
"""Of the page's text, characters."""
WHOLE = {"seed", "chambers", "narrows", "loops", "dead_ends"}
"""Options that are whole numbers."""


def main() -> None:
    """Build, score, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fresh", type=int, default=12, help="number of fresh caves")
    parser.add_argument("--episodes", type=int, default=40, help="per cave and current: 40 take every start once")
    parser.add_argument("--baselines", nargs="+", choices=BASELINES, default=list(BASELINES))
    parser.add_argument("--output", type=Path, default=ROOT / "out" / "baselines", help="where caves and scores go")
    parser.add_argument("--page", type=Path, default=ROOT / "eval" / "results" / "baselines.md")
    arguments = parser.parse_args()
    tests = [name for name in shipped_names("scenarios") if read_shipped(name).split == "test"]
    fresh = [fresh_cave(n, arguments.output / "caves") for n in range(arguments.fresh)]
    scores = {
        baseline: score(baseline, [*tests, *map(str, fresh)], arguments.episodes, arguments.output)
        for baseline in arguments.baselines
    }
    arguments.page.write_text(page(scores, tests, [folder.name for folder in fresh], arguments.episodes), "utf-8")
    print(f"Wrote {arguments.page}.")


def fresh_cave(number: int, folder: Path) -> Path:
    """Return the folder of a fresh cave, built first where that was not done yet.

    A draw whose galleries leave the cave's space, or are too tight for the vehicle, is drawn again.
    """
    target = folder / f"fresh-{number + 1}"
    if (target / "scenario.toml").is_file():
        return target
    rng = np.random.default_rng((FRESH_SEED, number))
    for _ in range(MAX_DRAWS):
        recipe = ShippedScenario(title="drawn from the ranges of the training caves", split="test", cave=draw(rng))
        path = folder / f"{target.name}.toml"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(tomli_w.dumps({"cave": dataclasses.asdict(recipe.cave)}), encoding="utf-8")
        try:
            build_gallery(recipe, path, target, Journal(silent))
        except AquanavError as error:
            print(f"{target.name} is drawn again: {error}", flush=True)
            continue
        print(f"Built {target.name}: {recipe.cave}", flush=True)
        return target
    raise SystemExit(f"{target.name}: none of {MAX_DRAWS} draws made a cave.")


def draw(rng: np.random.Generator) -> GalleryOptions:
    """Return options of a cave, each uniform over what the training caves span."""
    known = [read_shipped(name).cave for name in shipped_names("scenarios") if read_shipped(name).split == "train"]
    drawn: dict[str, Any] = {"seed": int(rng.integers(1_000, 1_000_000)), "voxel": 0.1}
    for field in dataclasses.fields(GalleryOptions):
        if field.name in drawn:
            continue
        values = [getattr(cave, field.name) for cave in known]
        low, high = min(values), max(values)
        whole = field.name in WHOLE
        drawn[field.name] = int(rng.integers(low, high + 1)) if whole else round(float(rng.uniform(low, high)), 2)
    return GalleryOptions(**drawn)


def score(baseline: str, scenarios: list[str], episodes: int, output: Path) -> list[dict[str, Any]]:
    """Return the episodes of a baseline in all caves; kept from an earlier run where that is finished."""
    found = []
    for scenario in scenarios:
        folder = output / baseline / Path(scenario).name
        results = folder / "results.json"
        if not results.is_file():
            conditions = ["--current", "full", "--grid.current", *map(str, CURRENTS.values())]
            numbers = ["--episodes", str(episodes), "--seed", "0", "--record", "none"]
            backend = ["--backend", "pybullet" if baseline == "oracle" else "batch"]  # the batch takes no map
            aquanav(
                "evaluate",
                f"baseline:{baseline}",
                "--scenario",
                scenario,
                *conditions,
                *numbers,
                *backend,
                "-o",
                str(folder),
            )
        flown = json.loads(results.read_text(encoding="utf-8"))["episodes"]
        print(f"{baseline} in {Path(scenario).name}: {', '.join(rates(flown).values())} collision-free", flush=True)
        found += [{**episode, "cave": Path(scenario).name} for episode in flown]
    return found


def is_clean(episode: dict[str, Any]) -> bool:
    """Return whether the goal was reached without a touch."""
    return bool(episode["outcome"] == "success" and episode["collisions"] == 0)


def rates(episodes: list[dict[str, Any]]) -> dict[str, str]:
    """Return the collision-free success by current, in percent."""
    return {
        current: f"{np.mean([is_clean(e) for e in episodes if e['condition'] == f'current x{share}']):.0%}"
        for current, share in CURRENTS.items()
    }


def page(scores: dict[str, list[dict[str, Any]]], tests: list[str], fresh: list[str], episodes: int) -> str:
    """Return the page: means over caves with their extremes, then every cave."""
    lines = [
        "# Baselines",
        "",
        *textwrap.wrap(
            "`python eval/study/baselines.py`. Collision-free success (the goal reached without one touch) in percent; "
            f"{episodes} episodes per cave and current, with seeds from 0. The {len(fresh)} fresh caves are drawn by a "
            f"rule (seed {FRESH_SEED}) from the ranges that the training caves span; nothing was tuned on them. "
            "random, reactive and reference fly on the batch, the oracle, which knows the map, in PyBullet.",
            WIDTH,
        ),
        "",
        f"| baseline | {len(tests)} test caves, still | full current | {len(fresh)} fresh, still | full current |",
        "|---|---|---|---|---|",
    ]
    for baseline, flown in scores.items():
        cells = [summary(flown, caves, share) for caves in (tests, fresh) for share in CURRENTS.values()]
        lines.append(f"| {baseline} | {' | '.join(cells)} |")
    lines += ["", "Mean over caves, in brackets the worst and the best cave.", "", "## Cave by cave", ""]
    columns = [f"{baseline}, {current}" for baseline in scores for current in CURRENTS]
    lines += [f"| cave | {' | '.join(columns)} |", "|---" * (len(columns) + 1) + "|"]
    for cave in [*tests, *fresh]:
        cells = [interval(flown, cave, share) for flown in scores.values() for share in CURRENTS.values()]
        lines.append(f"| {cave} | {' | '.join(cells)} |")
    lines += ["", 'In brackets 95 % Wilson intervals. "full": 0.5 m/s at the narrowest section.']
    return "\n".join(lines) + "\n"


def of(flown: list[dict[str, Any]], cave: str, share: int) -> list[bool]:
    """Return which episodes in a cave, at a share of the current, were collision-free."""
    return [is_clean(e) for e in flown if e["cave"] == cave and e["condition"] == f"current x{share}"]


def summary(flown: list[dict[str, Any]], caves: list[str], share: int) -> str:
    """Return the mean over caves with the worst and the best."""
    shares = [float(np.mean(of(flown, cave, share))) for cave in caves]
    return f"{np.mean(shares):.0%} [{min(shares):.0%}, {max(shares):.0%}]" if shares else "-"


def interval(flown: list[dict[str, Any]], cave: str, share: int) -> str:
    """Return a cave's rate with its interval."""
    clean = of(flown, cave, share)
    rate = wilson(sum(clean), len(clean))
    return f"{rate.rate:.0%} [{rate.low:.0%}, {rate.high:.0%}]"


if __name__ == "__main__":
    main()
