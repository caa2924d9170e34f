"""Time of a new bay with its shortest way: python eval/benchmarks/sea.py [NUMBER OF SEEDS] [--smoke]."""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # eval is no part of the package

from aquanav_tools.sea.generate import MapSettings, generate_map
from eval.smoke import parser_of

CASES = {
    "default": MapSettings(),
    "half as dense": MapSettings(density=0.05),
    "twice as dense": MapSettings(density=0.2, clearance=5.0),
}


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("seeds", type=int, nargs="?", default=300)
    options = parser.parse_args()
    count = 3 if options.smoke else options.seeds
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
            blocked.append(len(sea.paths[0].points) > 2)
        shares = f"{np.median(times):.2f} | {np.percentile(times, 95):.2f} | {max(times):.2f}"
        print(f"| {name} | {np.mean(rocks):.1f} | {shares} | {np.mean(blocked):.0%} |", flush=True)


if __name__ == "__main__":
    main()
