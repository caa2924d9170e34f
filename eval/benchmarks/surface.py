"""CPU time of the surface environment, one thread: python eval/benchmarks/surface.py [DECISIONS] [--smoke]."""

from __future__ import annotations

import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))  # eval is no part of the package

from aquanav_tools.envs.surface_env import SurfaceEnv
from eval.smoke import parser_of

SEAS, BOATS = ("still", "calm", "rough"), ("otter", "boat")
REPEATS, NUM_RESETS = 3, 20


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("decisions", type=int, nargs="?", default=300)
    options = parser.parse_args()
    count = 3 if options.smoke else options.decisions
    print("| sea | boat | decision, ms | decisions/s | new bay and sea, ms |")
    print("|---|---|---|---|---|")
    for sea in SEAS:
        for boat in BOATS:
            env = SurfaceEnv(sea=sea, vehicle=boat)
            env.reset(seed=0)
            env.action_space.seed(0)
            actions = [env.action_space.sample() for _ in range(count)]
            env.step(actions[0])  # compiles
            step, reset = best_times(env, actions)
            print(f"| {sea} | {boat} | {1e3 * step:.3f} | {1.0 / step:.0f} | {1e3 * reset:.2f} |", flush=True)


def best_times(env: SurfaceEnv, actions: list[object]) -> tuple[float, float]:
    """Return the CPU time of a random decision and of a reset, the best of several runs, s."""
    steps, resets = [], []
    for _ in range(REPEATS):
        began = time.process_time()
        for _ in range(NUM_RESETS):
            env.reset()
        between = time.process_time()
        for action in actions:
            env.step(action)
        steps.append((time.process_time() - between) / len(actions))
        resets.append((between - began) / NUM_RESETS)
    return min(steps), min(resets)


if __name__ == "__main__":
    main()
