"""Measure the batched environment beside PyBullet's: decisions per second, and what a million of them cost.

    python eval/benchmarks/batch.py [scenario folder] [--only pybullet mesh field ...] [--sizes 1 64 1024 16384]

All in one run: PyBullet one after the other (dummy) and in processes (subproc), Warp with exact rays (mesh) and with
rays traced through the distance field (field). Every vehicle flies the same habit of steering to the goal and away
from the nearer side; "+ policy" adds a network of 3 x 128 that looks at every observation and is not obeyed, so that
the flights stay the same. On a machine that others use too, CPU time says more than the clock.

"scraping" presses every vehicle along the walls, and counts when they are there; "dynamics" lets each episode draw its
vehicle's dynamics, from ranges without width, so that all flights stay the same, in turns with a batch that does not;
"caves" has as many vehicles in one cave as in 256 copies of it, each of which lies in memory of its own as another cave
would.

With --keep what is printed goes into eval/results/batch.md.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")

import argparse
import dataclasses
import functools
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).parents[2]))  # the tiny caves live with the tests

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.sb3_env import BatchedVecEnv
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Mesh
from eval.benchmarks.env import fine_tube
from eval.pages import RESULTS, Record
from eval.smoke import parser_of

Act = Callable[[np.ndarray], np.ndarray]
Say = Callable[[str], None]
OPTIONS: dict[str, Any] = {"observation": "paper", "action": "continuous", "reward": "safe"}
PYBULLET_SIZES = {"dummy": (1, 16), "subproc": (2, 8)}
MAX_STEPS = 2_000_000
UNTIL_SCRAPING = 200
"""Decisions after which every vehicle touches a wall in all its physics steps, in the tube and in cave-train-1."""
TURNS = 7
"""Of two batches beside each other, after one that is not counted; the median holds."""


def steer(obs: np.ndarray) -> np.ndarray:
    """Return (N, 3) actions towards the goal and away from the nearer side."""
    steering = 3.0 * obs[:, 29] + 1.5 * (obs[:, 8] - obs[:, 7])
    ballast = 2.0 * obs[:, 30] + 0.5 * (obs[:, 23] - obs[:, 18])
    return np.clip(np.stack([ballast, steering, np.full(len(obs), 0.9)], axis=1), -1.0, 1.0).astype(np.float32)


def with_network() -> Act:
    """Return `steer` that also asks a network of random weights."""
    import torch

    torch.set_num_threads(1)
    widths = (31, 128, 128, 128, 3)
    layers: list[Any] = []
    for a, b in pairwise(widths):
        layers += [torch.nn.Linear(a, b), torch.nn.SiLU()]
    network = torch.nn.Sequential(*layers)

    def act(obs: np.ndarray) -> np.ndarray:
        with torch.no_grad():
            network(torch.from_numpy(obs))
        return steer(obs)

    return act


def cpu_seconds(pids: list[int]) -> float:
    """Return the CPU time of this process with its threads, and of the child processes named, s."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    total = usage.ru_utime + usage.ru_stime
    for pid in pids:
        fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        total += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return total


def measure(name: str, env: Any, act: Act, seconds: float, say: Say, before: int = 3) -> float:
    """Print a row on one environment after some decisions `before`, and return its decisions per CPU second."""
    pids = [process.pid for process in getattr(env, "processes", [])]
    obs = env.reset()
    for _ in range(before):
        obs = env.step(act(obs))[0]
    start, cpu, steps = time.perf_counter(), cpu_seconds(pids), 0
    touched = ended = 0
    while time.perf_counter() - start < seconds and steps < MAX_STEPS:
        obs, _, dones, infos = env.step(act(obs))
        steps += env.num_envs
        ended += int(dones.sum())
        touched += sum(infos[n]["num_collisions"] > 0 for n in np.flatnonzero(dones))
    wall, cpu = time.perf_counter() - start, cpu_seconds(pids) - cpu
    say(
        f"| {name} | {env.num_envs:,} | {steps / wall:,.0f} | {steps / cpu:,.0f} | {1e6 * cpu / steps:.2f} | {ended:,} "
        f"| {touched:,} |"
    )
    return steps / cpu


def pybullet_env(kind: str, num: int, scenario: Scenario) -> Any:
    """Return N environments of PyBullet, one after the other or in processes."""
    from stable_baselines3.common.vec_env import DummyVecEnv, SubprocVecEnv

    make = functools.partial(CaveEnv, scenario, **OPTIONS)
    return DummyVecEnv([make] * num) if kind == "dummy" else SubprocVecEnv([make] * num, start_method="fork")


def scrape(obs: np.ndarray) -> np.ndarray:
    """Return (N, 3) actions that press every vehicle along the nearer wall."""
    sides = np.where(obs[:, 7] < obs[:, 8], -0.15, 0.15)
    return np.stack([np.zeros(len(obs)), sides, np.ones(len(obs))], axis=1).astype(np.float32)


def copy_of(scenario: Scenario) -> Scenario:
    """Return a scenario whose walls, field and flow are copies."""

    def copied(mesh: Mesh) -> Mesh:
        return Mesh(mesh.vertices.copy(), mesh.faces.copy())

    field, flow = scenario.field, scenario.flow
    return dataclasses.replace(
        scenario,
        cavity=dataclasses.replace(scenario.cavity, mesh=copied(scenario.cavity.mesh)),
        collision=copied(scenario.collision),
        field=dataclasses.replace(field, bricks=field.bricks.copy(), samples=field.samples.copy()),
        flow=None if flow is None else dataclasses.replace(flow, samples=flow.samples.copy()),
    )


def own_dynamics(scenario: Scenario, num: int, options: argparse.Namespace, say: Say) -> None:
    """Say what it costs that each vehicle has drawn dynamics of its own, once episodes end in every step."""
    unity = {name: (1.0, 1.0) for name in ("mass", "inertia", "added_mass", "linear_damping", "quadratic_damping")}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "unity.toml"
        path.write_text("".join(f"{name} = [{low}, {high}]\n" for name, (low, high) in unity.items()))
        choices = {"num_threads": options.threads, "device": options.device, **OPTIONS}
        envs = [BatchedVecEnv(scenario, num, randomisation=chosen, **choices) for chosen in (None, str(path))]
    looks: list[Any] = [env.reset() for env in envs]
    for env in envs:
        env._task.randomise_time_limits(0)
    spent = np.zeros((1 + TURNS, 2))
    for turn in spent:
        for n, env in enumerate(envs):
            start, end, steps = cpu_seconds([]), time.perf_counter() + options.seconds, 0
            while time.perf_counter() < end:
                looks[n] = env.step(steer(looks[n]))[0]
                steps += num
            turn[n] = 1e6 * (cpu_seconds([]) - start) / steps
    for env in envs:
        env.close()
    (nominal, own), cost = np.median(spent[1:], axis=0), np.median(spent[1:, 1] / spent[1:, 0]) - 1.0
    say(f"- Own dynamics, {num:,} vehicles: {own:.2f} us of CPU time per decision, {nominal:.2f} without, {cost:+.1%}.")


def many_caves(scenario: Scenario, num_caves: int, num: int, options: argparse.Namespace, say: Say) -> list[str]:
    """Print a row each of a batch in one cave and in many with as many vehicles; return how they compare."""
    rates, notes = [], []
    for count in (1, num_caves):
        caves = [copy_of(scenario) for _ in range(count)]
        before = psutil.Process().memory_info().rss
        env = BatchedVecEnv(caves, num, num_threads=options.threads, device=options.device, **OPTIONS)
        grown = psutil.Process().memory_info().rss - before
        rates.append(max(measure(f"batch, field, {count} caves", env, steer, options.seconds, say) for _ in range(2)))
        notes.append(f"- {count} caves: {grown / 1e6 / count:,.2f} MB for each and its {num // count:,} vehicles.")
        env.close()
    return [
        *notes,
        f"- {num_caves} caves have {rates[1] / rates[0]:.2f} of the throughput of one, with {num:,} vehicles.",
    ]


def parts(scenario: Scenario, num: int, rays: str, say: Say) -> None:
    """Say the CPU time of each kernel per decision of a vehicle, on one thread."""
    env = BatchedVecEnv(scenario, num, rays=rays, num_threads=1, **OPTIONS)
    task: Any = env._task
    obs = env.reset()
    spent: dict[str, float] = {}
    for decision in range(40):
        env.step_async(steer(obs))
        for launch in task.world.launches[0]:
            start = time.process_time()
            launch.launch()
            if decision >= 10:
                spent[launch.kernel.key] = spent.get(launch.kernel.key, 0.0) + time.process_time() - start
        obs = env._task.copy_of("observations")
    line = ", ".join(f"{name} {1e6 * duration / 30 / num:.2f}" for name, duration in spent.items())
    say(f"- Rays in the {rays}, {num:,} vehicles, microseconds of CPU time per decision: {line}.")
    env.close()


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("scenario", type=Path, nargs="?")
    parser.add_argument("--sizes", type=int, nargs="+", default=[1, 64, 1024, 16384])
    parser.add_argument("--seconds", type=float, default=4.0, help="by the clock, for each line")
    parser.add_argument("--threads", type=int, default=None, help="of the batch; as many as there are by default")
    parser.add_argument("--device", default="cpu", help="of the batch: cpu, cuda")
    everything = ["pybullet", "mesh", "field", "scraping", "dynamics", "caves"]
    parser.add_argument("--only", nargs="+", default=everything, choices=everything, help="what to measure")
    parser.add_argument("--keep", action="store_true", help="put the table into eval/results/batch.md")
    options = parser.parse_args()
    record = Record("eval/benchmarks/batch.py")
    tube, num_caves, num_in_caves = (144, 174), 256, 4096
    if options.smoke:
        options.sizes, options.seconds, tube, num_caves, num_in_caves = [1, 8], 0.2, (24, 30), 3, 12
    scenario = fine_tube(*tube) if options.scenario is None else read_scenario(options.scenario)
    faces = f"{len(scenario.cavity.mesh.faces):,} triangles, {len(scenario.collision.faces):,} for contacts"
    record.say(f"{scenario.name}: {faces}, field every {scenario.field.spacing:g} m.\n")
    record.say(
        "| | N | decisions/s | decisions/CPU-s | CPU-us/decision | episodes | touched |\n|---|---|---|---|---|---|---|"
    )
    notes = rows(scenario, num_caves, num_in_caves, options, record.say)
    record.say("")
    for note in notes:
        record.say(note)
    if "dynamics" in options.only:
        for num in options.sizes:
            own_dynamics(scenario, num, options, record.say)
    for rays in ("mesh", "field"):
        if rays in options.only and options.device == "cpu":
            parts(scenario, max(options.sizes), rays, record.say)
    if options.keep:
        record.keep(RESULTS / "batch.md", "batch")


def rows(scenario: Scenario, num_caves: int, num_in_caves: int, options: argparse.Namespace, say: Say) -> list[str]:
    """Print the table's rows, and return what is to be said below it."""
    acts = {"": steer, ", policy asked": with_network()}
    for kind, sizes in PYBULLET_SIZES.items() if "pybullet" in options.only else ():
        for num in sizes:
            env = pybullet_env(kind, num, scenario)
            measure(f"PyBullet, {kind}", env, steer, options.seconds, say)
            env.close()
    for rays in ("mesh", "field"):
        for num in options.sizes if rays in options.only else ():
            env = BatchedVecEnv(scenario, num, rays=rays, num_threads=options.threads, device=options.device, **OPTIONS)
            for suffix, act in acts.items():
                measure(f"batch, {rays}{suffix}", env, act, options.seconds, say)
            env.close()
    if "scraping" in options.only:
        num = max(options.sizes)
        env = BatchedVecEnv(scenario, num, num_threads=options.threads, device=options.device, **OPTIONS)
        measure("batch, field, scraping", env, scrape, options.seconds, say, 3 if options.smoke else UNTIL_SCRAPING)
        env.close()
    return many_caves(scenario, num_caves, num_in_caves, options, say) if "caves" in options.only else []


if __name__ == "__main__":
    main()
