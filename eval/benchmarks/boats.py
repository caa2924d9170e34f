"""Measure boats in a batch beside the environment with one: decisions per second of processor time.

    python eval/benchmarks/boats.py [--num 256] [--decisions 200] [--keep]

The same habit everywhere: ahead, steering at random for a second at a time; episodes end at the first contact, so that
new bays are drawn as in training. Rounds take turns, and the best of each counts, since others use the machine too.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # eval is no part of the package

from aquanav_tools.envs.boat_batch import BoatBatch
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.sim.sea_state import SEA_STATES
from eval.pages import RESULTS, Record
from eval.smoke import parser_of

HELD = 10
"""Decisions for which a choice is held."""
OPTIONS: dict[str, Any] = {"on_collision": "end", "reward": "safe"}


def choices(rng: np.random.Generator, num: int) -> Any:
    """Return actions of `num` boats: any steer, mostly ahead."""
    return np.stack([rng.integers(0, 3, num), np.minimum(rng.integers(1, 6, num), 2)], axis=1)


def batched(sea: str, num: int, decisions: int) -> float:
    """Return the decisions per second of processor time of a batch on one thread, its resets included."""
    rng = np.random.default_rng(0)
    batch = BoatBatch(None, num, next_step=False, sea=sea, num_threads=1, **OPTIONS)
    batch.reset(range(num))
    began = time.process_time()
    for n in range(decisions):
        if n % HELD == 0:
            actions = choices(rng, num)
        batch.command(actions)
        batch.step()
    return num * decisions / (time.process_time() - began)


def alone(sea: str, decisions: int) -> float:
    """Return the same of one environment."""
    rng = np.random.default_rng(0)
    env = SurfaceEnv(sea=sea, **OPTIONS)
    env.reset(seed=0)
    began = time.process_time()
    for n in range(decisions):
        if n % HELD == 0:
            (action,) = choices(rng, 1)
        _, _, terminated, truncated, _ = env.step(action)
        if terminated or truncated:
            env.reset()
    return decisions / (time.process_time() - began)


def main() -> None:
    """Print a line for each sea."""
    parser = parser_of(__doc__)
    parser.add_argument("--num", type=int, default=256, help="boats in the batch")
    parser.add_argument("--decisions", type=int, default=200, help="of each boat")
    parser.add_argument("--keep", action="store_true", help="put the table into eval/results/boats.md")
    options = parser.parse_args()
    record = Record("eval/benchmarks/boats.py")
    num, decisions, num_alone, num_rounds = (4, 5, 5, 1) if options.smoke else (options.num, options.decisions, 1000, 3)
    batched("still", 2, 2), alone("still", 2)  # compiles
    record.say(f"{num} boats on one thread, resets included, best of {num_rounds} rounds that take turns.\n")
    record.say("| sea | alone, decisions per CPU second | batch | ratio |\n|---|---|---|---|")
    for sea in SEA_STATES:
        rounds = [(alone(sea, num_alone), batched(sea, num, decisions)) for _ in range(num_rounds)]
        one, many = (max(column) for column in zip(*rounds, strict=True))
        record.say(f"| {sea} | {one:,.0f} | {many:,.0f} | {many / one:.1f} |")
    if options.keep:
        record.keep(RESULTS / "boats.md", "boats")


if __name__ == "__main__":
    main()
