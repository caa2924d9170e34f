"""Time of a new bay with its shortest way: python eval/benchmarks/sea.py [NUMBER OF SEEDS]."""

from __future__ import annotations

import sys
import time

import numpy as np

from aquanav_tools.sea.generate import MapSettings, generate_map

CASES = {
    "default": MapSettings(),
    "half as dense": MapSettings(density=0.05),
    "twice as dense": MapSettings(density=0.2, clearance=5.0),
}


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    generate_map(0)  # compiles
    print("| bay | rocks | median | 95 % | longest (CPU time, ms) | straight way blocked |")
    print("|---|---|---|---|---|---|")
    for name, settings in CASES.items():
        times, rocks, blocked = [], [], []
        for seed in range(count):
            began = time.process_time()
            sea = generate_map(seed, settings)
            times.append(1e3 * (time.process_time() - began))
            rocks.append(len(sea.rocks))
            blocked.append(len(sea.ways[0].points) > 2)
        shares = f"{np.median(times):.2f} | {np.percentile(times, 95):.2f} | {max(times):.2f}"
        print(f"| {name} | {np.mean(rocks):.1f} | {shares} | {np.mean(blocked):.0%} |", flush=True)


if __name__ == "__main__":
    main()
