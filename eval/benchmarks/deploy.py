"""Time of a decision on a vehicle: python eval/benchmarks/deploy.py [DECISIONS] [--smoke].

From readings to command, of each policy for vehicles that ships, in one thread: on the clock, which other work on the
machine lengthens, and in processor time, which it hardly does. The first decision, which loads, is left out.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # eval is no part of the package

from aquanav_tools.deploy import DeployedPolicy, Readings
from aquanav_tools.shipped import shipped_path
from eval.smoke import parser_of

SENSORS: dict[str, dict[str, np.ndarray]] = {
    "reference": {},
    "reference-echosounders": {"echosounders": np.full(16, 5.0)},
    "reference-waypoint": {"echosounders": np.full(16, 5.0), "waypoint": np.array([0.5, 0.1, 0.0, 0.3])},
}


def main() -> None:
    """Print a table."""
    parser = parser_of(__doc__)
    parser.add_argument("count", nargs="?", type=int, default=10_000)
    options = parser.parse_args()
    count = 20 if options.smoke else options.count
    print("| policy | median, ms | 99 of 100, ms | 99 of 100, ms of processor time |\n|---|---|---|---|")
    for name, sensors in SENSORS.items():
        policy = DeployedPolicy(shipped_path("eval/policies", name, ".onnx"), vehicle="bluerov2")
        policy.reset()
        readings = Readings(
            policy.ray_lengths, [12.0, 0.3, -0.1], [0.4, 0.0, 0.0], [0.0, 0.0, 0.1], 2.0, [0.0, 0.0], sensors
        )
        policy.act(readings)
        times = np.empty((count, 2))
        for row in times:
            began = time.perf_counter(), time.thread_time()
            policy.act(readings)
            row[:] = time.perf_counter() - began[0], time.thread_time() - began[1]
        wall, own = 1e3 * times.T
        print(
            f"| {name} | {np.median(wall):.2f} | {np.quantile(wall, 0.99):.2f} | {np.quantile(own, 0.99):.2f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
