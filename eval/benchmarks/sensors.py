"""CPU time of sensors: python eval/benchmarks/sensors.py [scenario folder] [--vehicles 4096] [--rays 28 100] [--smoke].

Fans of different numbers of rays take turns, so that a busy machine is as busy for each of them; all have the same
spread of directions over the frontal half sphere and the same length. The sonar of 256 x 256 pings for one vehicle.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # the tiny caves live with the tests

from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.sensors.base import SensorBatch
from aquanav_tools.sim.batch.sensors.fan import RangeFan
from aquanav_tools.sim.batch.sensors.fan_spec import FanSpec
from aquanav_tools.sim.batch.sensors.sonar import ImagingSonar
from aquanav_tools.sim.batch.sensors.suite import make_sensor
from eval.benchmarks.env import fine_tube
from eval.smoke import parser_of

RAY_LENGTH = 4.0
"""m, as the longest of the benchmark's."""
GOLDEN_ANGLE = np.pi * (3.0 - np.sqrt(5.0))


def spread_fan(num: int) -> RangeFan:
    """Return rays spread evenly over the frontal half sphere."""
    n = np.arange(num)
    ahead, turn = (n + 0.5) / num, GOLDEN_ANGLE * n
    beside = np.sqrt(1.0 - ahead**2)
    ways = np.stack([ahead, beside * np.cos(turn), beside * np.sin(turn)], axis=1)
    return RangeFan(FanSpec((RAY_LENGTH,), tuple(map(tuple, ways.tolist()))))


def batch_of(scenario: Scenario, num: int, rays: str) -> SensorBatch:
    """Return vehicles around the scenario's starts, in motion, turned at random about the vertical."""
    rng = np.random.default_rng(0)
    cave = CaveBatch(scenario, num, next_step=True, rays=rays)
    cave.reset(list(range(num)))
    arrays, yaws = cave.world.arrays, 0.5 * rng.uniform(-np.pi, np.pi, num)
    arrays.positions.assign(cave.view_of("positions") + rng.uniform(-0.2, 0.2, (num, 3)))
    arrays.orientations.assign(np.stack([np.cos(yaws), 0.0 * yaws, 0.0 * yaws, np.sin(yaws)], axis=1))
    arrays.velocities.assign(rng.uniform(-0.5, 0.5, (num, 6)))
    return SensorBatch(arrays, cave.world.caves, cave.decision_seconds, cave.world.device)


def times(sensors: list[Any], batch: SensorBatch, repeats: int) -> tuple[Any, Any]:
    """Return the CPU time and the time by the clock of a measurement by each sensor, medians of interleaved runs, s."""
    spent = np.zeros((2, repeats, len(sensors)))
    for sensor in sensors:
        sensor.measure(batch)  # compiles and records
    for n in range(repeats):
        for k, sensor in enumerate(sensors):
            cpu, clock = time.process_time(), time.perf_counter()
            sensor.measure(batch)
            spent[:, n, k] = time.process_time() - cpu, time.perf_counter() - clock
    cpu_seconds, seconds = np.median(spent, axis=1)
    return cpu_seconds, seconds


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("scenario", type=Path, nargs="?")
    parser.add_argument("--vehicles", type=int, default=4096)
    parser.add_argument("--rays", type=int, nargs="+", default=[28, 100])
    parser.add_argument("--repeats", type=int, default=40)
    options = parser.parse_args()
    tube = (144, 174)
    if options.smoke:
        options.vehicles, options.repeats, tube = 64, 2, (24, 30)
    scenario = fine_tube(*tube) if options.scenario is None else read_scenario(options.scenario)
    print(f"{scenario.name}: {len(scenario.cavity.mesh.faces)} triangles, field every {scenario.field.spacing:g} m")
    for rays in ("field", "mesh"):
        batch = batch_of(scenario, options.vehicles, rays)
        report_fans(batch, rays, options.rays, options.repeats)
        report_others(batch, rays, options.repeats)
        report_sonar(batch_of(scenario, 1, rays), rays, options.repeats)


def report_fans(batch: SensorBatch, rays: str, counts: list[int], repeats: int) -> None:
    cpu, _ = times([spread_fan(count) for count in counts], batch, repeats)
    for count, seconds in zip(counts, cpu, strict=True):
        each = 1e6 * seconds / batch.num
        growth = f"{seconds / cpu[0]:.2f} times the time of {counts[0]} for {count / counts[0]:.2f} times the rays"
        print(f"  {rays}: fan of {count:>4} rays, {batch.num} vehicles: {each:.2f} us of CPU time each; {growth}")


def report_others(batch: SensorBatch, rays: str, repeats: int) -> None:
    names = ("depth", "imu", "dvl")
    cpu, _ = times([make_sensor(name) for name in names], batch, repeats)
    for name, seconds in zip(names, cpu, strict=True):
        print(f"  {rays}: {name}, {batch.num} vehicles: {1e6 * seconds / batch.num:.3f} us of CPU time each")


def report_sonar(batch: SensorBatch, rays: str, repeats: int) -> None:
    sonar = ImagingSonar()
    (cpu,), (clock,) = times([sonar], batch, repeats)
    size = f"{sonar.data.num_beams} x {sonar.data.num_bins}, {sonar.data.num_sub_rays} sub-rays"
    print(
        f"  {rays}: sonar of {size}, one vehicle, {batch.num_threads} threads: {1e3 * clock:.1f} ms a ping by the "
        f"clock ({1.0 / clock:.0f} pings/s), {1e3 * cpu:.1f} ms of CPU time ({1.0 / cpu:.0f} per CPU second)"
    )


if __name__ == "__main__":
    main()
