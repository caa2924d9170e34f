"""CPU time of the surface environment, one thread: python eval/benchmarks/surface.py [NUMBER OF DECISIONS]."""

from __future__ import annotations

import sys
import time

from aquanav_tools.envs.surface_env import SurfaceEnv

SEAS, BOATS = ("still", "calm", "rough"), ("otter", "boat")
REPEATS, NUM_RESETS = 3, 20


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
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
