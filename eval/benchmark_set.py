"""Draw the caves of a benchmark by rule, and write them as a set that aquanav-eval --benchmark takes.

Test caves generated/mixed/SEED are taken by their seeds from 0 upwards. Each goes into a tier by what makes it hard:

    narrowest place of the way    4 vehicle widths or more 0 points, 3 or more 1, 2.4 or more 2, 2 or more 3
    mean turn of the way          12 degrees per m or more 1 point
    length of the way             70 m or more 1 point

0 points are tier 1, 1 point tier 2, 2 points tier 3, 3 or more tier 4. Every cave with a place narrower than two
vehicle widths is in tier 5, the hard one. The baseline that knows the map and the water (baseline:oracle) dives in each
under the rules of its tier, from the starts that policies get; a cave in which it touches a wall or does not arrive is
left out. The first caves that are left fill the tier.

Tier 5 is hard on purpose: flood water, a vehicle hardly known, noise, and commands that are late. Of 77 such caves the
oracle was clean in all ten dives in 60, which are the tier; baseline:reference is in 11 % of its dives there. What the
oracle knows and policies do not is the body that the episode drew, which commands are under way, and the water ahead;
rays and their noise it ignores.

What was found of each cave is kept beside the output, so that a stopped run goes on. Rows that other code made, of the
generator, the oracle or the task, or whose tier has other rules now, are made anew.
"""

from __future__ import annotations

import json
import os
import sys
from argparse import ArgumentParser
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from aquanav_tools.benchmark.definition import TierRules
from aquanav_tools.benchmark.worker import mesh_hash
from aquanav_tools.build.generated import generate
from aquanav_tools.errors import MeshError
from aquanav_tools.evaluate.env_cache import EnvCache, EpisodeSpec
from aquanav_tools.evaluate.options import ProtocolOptions
from aquanav_tools.evaluate.oracle import OraclePolicy
from aquanav_tools.evaluate.policies import load_policy
from aquanav_tools.evaluate.protocol import Condition, plan_condition
from aquanav_tools.provenance import code_digest, digest
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.scenario.shipped import GENERATOR, drawn_from
from aquanav_tools.scenario.split import names_for_tests
from aquanav_tools.synthetic.styles.catalogue import VEHICLE_WIDTH
from aquanav_tools.workers.pipe import PipeTransport
from aquanav_tools.workers.pool import WorkerPool
from aquanav_tools.workers.worker import WorkerSpec

EPISODES, SEED = 10, 0
RULES = {
    "tier 1": TierRules(current="half"),
    "tier 2": TierRules(current="full"),
    "tier 3": TierRules(current="full"),
    "tier 4": TierRules(current="full", randomisation="mild"),
    "tier 5": TierRules(current="flood", randomisation="wide", sensor_noise=0.05, action_delay=1),
}
HARD = "tier 5"
WIDTHS = (4.0, 3.0, 2.4)
"""Vehicle widths below which a narrowest place counts a point more."""
SQUEEZE = 2.0
SHARP, LONG = 12.0, 70.0
"""Degrees per m and m from which a way counts a point more."""
CHUNK = 12
"""Caves that are looked at together; which are taken does not depend on it."""


@dataclass(frozen=True)
class Candidate:
    """A cave to look at."""

    name: str
    full: tuple[str, ...] = ()
    """Tiers that need no more caves: the oracle does not dive there."""
    fault: str = ""


class Looker:
    """Builds caves, measures them, and has the oracle dive."""

    def look(self, candidate: Candidate) -> dict[str, Any]:
        """Return what is known of a cave: its tier, and in how many dives the oracle came through clean."""
        found: dict[str, Any] = {"scenario": candidate.name}
        drawn = drawn_from(candidate.name)
        assert drawn is not None
        if candidate.fault:
            return found | {"fault": candidate.fault}
        try:
            cave = generate(*drawn)
        except MeshError as error:
            return found | {"fault": str(error)}
        scenario = cave.scenario
        found |= {"style": cave.drawn.style, **measures(scenario, cave.width), "sha256": mesh_hash(scenario)}
        found["tier"] = tier = tier_of(found["width"], found["turn"], found["length"])
        found["basis"] = basis_of(tier)
        if tier not in candidate.full:
            found["clean"] = clean_dives(scenario, tier)
        return found


def measures(scenario: Scenario, width: float) -> dict[str, float]:
    """Return the narrowest place (vehicle widths), the mean turn (degrees per m) and the length (m) of the way."""
    guide = scenario.guide
    steps = np.diff(guide.centres, axis=0)
    ahead = steps / np.linalg.norm(steps, axis=1, keepdims=True)
    turns = np.degrees(np.arccos(np.clip((ahead[1:] * ahead[:-1]).sum(axis=1), -1.0, 1.0)))
    values = {"width": width / VEHICLE_WIDTH, "turn": float(turns.sum()) / guide.length, "length": guide.length}
    return {name: round(float(value), 2) for name, value in values.items()}


def tier_of(width: float, turn: float, length: float) -> str:
    """Return the tier of a cave; see the rule above."""
    if width < SQUEEZE:
        return HARD
    points = sum(width < bound for bound in WIDTHS) + (turn >= SHARP) + (length >= LONG)
    return f"tier {1 + min(points, 3)}"


def basis_of(tier: str) -> str:
    """Return a hash of what dives in a tier rest on: the code of generator, oracle and task, and its rules."""
    return digest(code_digest(*GENERATOR, OraclePolicy, EnvCache), RULES[tier])


def is_valid(row: dict[str, Any], full: tuple[str, ...]) -> bool:
    """Return whether what was found of a cave would be found again, and is all that is asked, with some tiers full."""
    if "fault" in row:
        return True
    tier = tier_of(row["width"], row["turn"], row["length"])
    return row["tier"] == tier and row.get("basis") == basis_of(tier) and ("clean" in row or tier in full)


def clean_dives(scenario: Scenario, tier: str) -> int:
    """Return how many of a tier's dives the oracle brings to the goal without a touch before the first it does not."""
    rules = ProtocolOptions(episodes=EPISODES, seed=SEED)
    condition = Condition(tier, RULES[tier].changes())
    env_cache = EnvCache(load_policy("baseline:oracle"), rules)
    try:
        plans = plan_condition(scenario, rules, condition)
        for n, plan in enumerate(plans):
            if not env_cache.run(EpisodeSpec(n, scenario, condition, plan))[1].is_collision_free_success:
                return n
    finally:
        env_cache.close()
    return len(plans)


def make_looker(_clock: Any) -> Looker:
    """Return what looks at caves in a process of its own."""
    return Looker()


def main() -> None:
    """Draw the set."""
    parser = ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--per-tier", type=int, default=60, help="caves in each tier")
    parser.add_argument("--most", type=int, default=3000, help="caves to look at before giving up")
    parser.add_argument("--output", type=Path, default=Path("eval/sets/aquanav-300.toml"), help="file to write")
    parser.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)), help="processes")
    options = parser.parse_args()
    known = options.output.with_suffix(".jsonl")
    taken: dict[str, list[dict[str, Any]]] = {tier: [] for tier in RULES}
    counts = {"built": 0, "not built": 0, "oracle not clean": dict.fromkeys(RULES, 0), "looked at": 0}
    with tqdm(total=len(RULES) * options.per_tier, unit="cave", disable=None) as bar:
        for row in looked_at(names_for_tests("mixed", options.most), known, taken, options):
            count(row, counts)
            if row.get("clean") == EPISODES and len(taken[row["tier"]]) < options.per_tier:
                taken[row["tier"]].append(row)
                bar.update()
    missing = {tier: options.per_tier - len(rows) for tier, rows in taken.items() if len(rows) < options.per_tier}
    if missing:
        sys.exit(f"After {options.most} caves {missing} are missing. Give a larger --most.")
    write(taken, counts, options.output)
    print(json.dumps(counts, indent=2))


def looked_at(names: list[str], known: Path, taken: dict[str, list[Any]], options: Any) -> Iterator[dict[str, Any]]:
    """Yield what is found of caves, in their order, until all tiers are full; each is kept in a file."""
    kept = {row["scenario"]: row for row in map(json.loads, known.read_text().splitlines())} if known.is_file() else {}
    spec = WorkerSpec(make_looker, "cave looker", "caves were looked at", "Run it again: it goes on.")
    with WorkerPool(PipeTransport(), spec, options.workers) as pool, known.open("a", encoding="utf-8") as stream:
        for first in range(0, len(names), CHUNK):
            full = tuple(tier for tier, rows in taken.items() if len(rows) >= options.per_tier)
            if len(full) == len(taken):
                return
            chunk = names[first : first + CHUNK]
            tasks = (Candidate(name, full) for name in chunk if not (name in kept and is_valid(kept[name], full)))
            for _, row in pool.results(tasks, "look", lambda task, why: replace(task, fault=why)):
                kept[row["scenario"]] = row
                stream.write(json.dumps(row) + "\n")
                stream.flush()
            yield from (kept[name] for name in chunk)


def count(row: dict[str, Any], counts: dict[str, Any]) -> None:
    """Count what became of a cave."""
    counts["looked at"] += 1
    counts["not built" if "fault" in row else "built"] += 1
    if row.get("clean", EPISODES) < EPISODES:
        counts["oracle not clean"][row["tier"]] += 1


def write(taken: dict[str, list[dict[str, Any]]], counts: dict[str, Any], path: Path) -> None:
    """Write the set."""
    left_out = ", ".join(f"{number} of {tier}" for tier, number in counts["oracle not clean"].items())
    lines = [
        f"# Drawn by eval/benchmark_set.py, which has the rule: {counts['looked at']} caves were looked at, "
        f"{counts['not built']} could",
        f"# not be built, and in these the oracle was not clean: {left_out}.",
        "# Widths are vehicle widths, turns degrees per m, lengths m.",
        "",
        f"episodes = {EPISODES}",
        f"seed = {SEED}",
    ]
    for tier, rows in taken.items():
        rules = ", ".join(f"{name} = {json.dumps(value)}" for name, value in RULES[tier].changes().items())
        lines += ["", "[[tiers]]", f'name = "{tier}"', f"rules = {{ {rules} }}", "caves = ["]
        for row in rows:
            values = {name: row[name] for name in ("scenario", "width", "turn", "length", "sha256")}
            lines.append(
                "    { " + ", ".join(f"{name} = {json.dumps(value)}" for name, value in values.items()) + " },"
            )
        lines.append("]")
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
