"""How often the sensor `waypoint` shows where the way leads: along the oracle's dives, beside the goal's own bearing.

python eval/waypoint_agreement.py SCENARIO... [--dives 8] [--current half]
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from aquanav_tools.envs.action import choices_of
from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.envs.factory import read_any_scenario
from aquanav_tools.envs.vector_env import CaveVectorEnv
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Array

AHEAD = 2.0
"""Where along the passage's middle the way is taken to lead, m."""
MOST_DECISIONS = 3000
WITHIN, AWAY = 0.5, 0.0
"""Cosines of 60 and 90 degrees."""


def middle_of(scenario: Scenario) -> tuple[Array, Array]:
    """Return the passage's middle as (P, 3) places that end at the goal, m, and how far along each lies, (P,)."""
    line, goal = np.asarray(scenario.guide.centreline), np.asarray(scenario.settings.goal.position)
    if np.linalg.norm(line[-1] - goal) > np.linalg.norm(line[0] - goal):
        line = line[::-1]
    line = np.concatenate([line, goal[None]])
    return line, np.concatenate([[0.0], np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum()])


def ways_at(places: Array, line: Array, along: Array) -> Array:
    """Return (N, 3) unit vectors from (N, 3) places to where the passage's middle is AHEAD of them."""
    nearest = along[np.linalg.norm(places[:, None] - line, axis=2).argmin(axis=1)]
    ahead = np.stack([np.interp(nearest + AHEAD, along, line[:, axis]) for axis in range(3)], axis=1)
    return _units(ahead - places)


def cosines(name: str, num: int, current: str) -> Array:
    """Return (K, 2) cosines between where the way leads and what the sensor shows, and the goal, at all decisions."""
    scenario = read_any_scenario(name)
    if not isinstance(scenario, Scenario):
        raise SystemExit(f"{name} is no cave.")
    line, along = middle_of(scenario)
    env = CaveVectorEnv(num, name, sensors=("waypoint",), current=current)
    observed = env.reset(seed=0)[0]
    batch = env.batch
    assert isinstance(batch, CaveBatch)
    state, is_diving, found = batch.world.arrays, np.ones(num, dtype=bool), []
    for _ in range(MOST_DECISIONS):
        places, (w, x, y, z) = state.positions.numpy().copy(), state.orientations.numpy().T
        yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
        turn, tilt = yaw + np.pi * observed[:, -3], 0.5 * np.pi * observed[:, -2]
        shown = np.stack([np.cos(turn) * np.cos(tilt), np.sin(turn) * np.cos(tilt), np.sin(tilt)], axis=1)
        ways = ways_at(places, line, along)
        both = np.stack([(shown * ways).sum(axis=1), (_units(line[-1] - places) * ways).sum(axis=1)], axis=1)
        found.append(both[is_diving])
        observed, _, is_over, is_out, _ = env.step(choices_of(batch.advice()))
        is_diving &= ~(is_over | is_out)
        if not is_diving.any():
            break
    env.close()
    if is_diving.all():
        raise SystemExit(f"None of {num} dives of the oracle in {name} ended within {MOST_DECISIONS} decisions.")
    return np.concatenate(found)


def row(name: str, both: Array) -> str:
    """Return a line of the table."""
    shares = [100.0 * (both[:, which] > WITHIN).mean() for which in (1, 0)]
    away = 100.0 * (both[:, 0] < AWAY).mean()
    return f"| {Path(name).name if Path(name).is_dir() else name} | {shares[0]:.0f} | {shares[1]:.0f} | {away:.0f} |"


def _units(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenarios", nargs="+", help="folders, files or generated/STYLE/SEED")
    parser.add_argument("--dives", type=int, default=8, help="in each cave")
    parser.add_argument("--current", default="half", help="still, half or full")
    options = parser.parse_args()
    print("| cave | goal, within 60 degrees, % | waypoint, within 60 degrees, % | more than 90 degrees off, % |")
    print("|---|---|---|---|", flush=True)
    for name in options.scenarios:
        print(row(name, cosines(name, options.dives, options.current)), flush=True)


if __name__ == "__main__":
    main()
