"""Measure the environment: decisions per second on one core, by what solves contacts and casts rays, reset, memory.

    python eval/benchmarks/env.py [scenario folder ...] [--smoke]

Without a folder it takes a tube of about 50,000 triangles. All times are this process's own CPU time on one thread, the
best of several runs, since other processes on the machine disturb. "ahead" swims along the route with the reactive
habit of steering to the goal, in one velocity of water everywhere and in the flow through the cave with its eddies;
"random" draws actions, the same in every run, and soon rubs along the walls, which is the dearest there is: what Bullet
itself takes of it is told apart.

Contacts are PyBullet's, where it is installed, or our own, rays cast against the mesh or traced through the distance
field: all in one run.
Where gym-pybullet-drones can be imported (clone github.com/utiasDSL/gym-pybullet-drones and name the clone in
PYTHONPATH), its hover task is stepped in the same run: no cave, no rays, 8 physics steps of 1/240 s per decision.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import dataclasses
import importlib.util
import itertools
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).parents[2]))  # the tiny caves live with the tests

from aquanav_tools.cave.cavity import prove_watertight
from aquanav_tools.cave.water.flow import find_flow
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.observation import layout
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.contacts import default_contacts
from aquanav_tools.types import Mesh
from eval.smoke import parser_of
from tests.caves import TUBE_LENGTH, TUBE_RADIUS, tube_scenario

GOAL = layout("full")["goal"]
CURRENT = (0.1, 0.0, 0.0)
"""m/s, along the passage."""
DRONES = "gym_pybullet_drones"


@dataclasses.dataclass(frozen=True)
class Size:
    """How much is measured."""

    decisions: int = 1000
    repeats: int = 8
    """Runs, of which the best counts."""
    resets: int = 200
    extra: int = 64
    """Environments whose memory is measured."""


SMOKE = Size(decisions=20, repeats=1, resets=3, extra=2)


def fine_tube(num_around: int = 144, num_along: int = 174) -> Scenario:
    """Return the tests' tube with a wall of about 50,000 well-shaped triangles, and water that flows through it."""
    x, angle = np.linspace(0, TUBE_LENGTH, num_along + 1), np.linspace(0, 2 * np.pi, num_around, endpoint=False)
    x, angle = (grid.ravel() for grid in np.meshgrid(x, angle, indexing="ij"))
    wall = np.stack([x, TUBE_RADIUS * np.cos(angle), TUBE_RADIUS * np.sin(angle)], axis=1)
    vertices = np.concatenate([wall, [[0, 0, 0], [TUBE_LENGTH, 0, 0]]])
    first, column = np.arange(num_along)[:, None] * num_around, np.arange(num_around)
    after = np.roll(column, -1)
    a, b, c, d = (first + side for side in (column, after, num_around + column, num_around + after))
    quads = [np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (b, d, c))]
    last = num_along * num_around
    ends = [
        np.stack([after, column, np.full(num_around, len(wall))], axis=1),
        np.stack([last + column, last + after, np.full(num_around, len(wall) + 1)], axis=1),
    ]
    mesh = Mesh(vertices, np.concatenate([*quads, *ends]).astype(np.int64))
    labels = np.repeat([0, 1, 2], [len(mesh.faces) - 2 * num_around, num_around, num_around])  # wall and two portals
    tube = tube_scenario()
    cavity = dataclasses.replace(tube.cavity, mesh=mesh, labels=labels, observed=labels == 0)
    prove_watertight(mesh)
    flow = find_flow(tube.cavity, tube.field, tube.guide.centres, TUBE_RADIUS)
    return dataclasses.replace(tube, cavity=cavity, collision=mesh, flow=flow)


def steer_to_goal(env: CaveEnv, obs: np.ndarray) -> list[int]:
    """Return an action that swims to the goal and does not look at the rays."""
    _, azimuth, elevation = obs[GOAL].tolist()
    turn = 0 if azimuth > 0.03 else 2 if azimuth < -0.03 else 1
    return [0 if elevation > 0.1 else 2 if elevation < -0.1 else 1, turn, 2]


def act_at_random(env: CaveEnv, obs: np.ndarray) -> Any:
    """Return any action."""
    return env.action_space.sample()


def microseconds(function: Callable[[], object], calls: int, repeats: int) -> float:
    """Return the CPU time of one call, the best of several runs."""
    best = np.inf
    for _ in range(repeats):
        start = time.process_time()
        for _ in range(calls):
            function()
        best = min(best, time.process_time() - start)
    return best / calls * 1e6


def per_decision(env: Any, act: Callable[[Any, Any], Any], size: Size) -> float:
    """Return the microseconds of a decision, resets included."""
    obs = env.reset(seed=0)[0]
    env.action_space.seed(0)  # how often random actions end at a wall, and so what they cost, differs by half

    def step() -> None:
        nonlocal obs
        obs, _, terminated, truncated, _ = env.step(act(env, obs))
        if terminated or truncated:
            obs = env.reset()[0]

    step()  # compiles
    return microseconds(step, size.decisions, size.repeats)


def bullet_steps(env: CaveEnv, size: Size) -> tuple[float, float]:
    """Return how many of the physics steps of a random decision ask Bullet, and the microseconds of one in Bullet."""
    import pybullet

    step, durations = pybullet.stepSimulation, []

    def timed(physicsClientId: int) -> None:
        start = time.perf_counter()
        step(physicsClientId=physicsClientId)
        durations.append(time.perf_counter() - start)

    pybullet.stepSimulation = timed  # which the environment calls through the module
    try:
        per_decision(env, act_at_random, size)
    finally:
        pybullet.stepSimulation = step
    # Other processes only ever lengthen a duration, so the lower quartile is nearer to what it takes than the mean.
    return len(durations) / (size.decisions * size.repeats), float(np.percentile(durations or [np.nan], 25)) * 1e6


def resident_mb() -> float:
    """Return this process's memory, MB."""
    return psutil.Process().memory_info().rss / 1e6


def memory_per_env(scenario: Scenario, num_extra: int) -> float:
    """Return the megabytes that one more environment of the same scenario takes."""
    envs = [CaveEnv(scenario)]
    envs[0].reset(seed=0)
    before = resident_mb()
    for _ in range(num_extra):
        envs.append(CaveEnv(scenario))
        envs[-1].reset(seed=0)
    grown = resident_mb() - before
    for env in envs:
        env.close()
    return grown / num_extra


def report(scenario: Scenario, size: Size) -> None:
    """Print everything about one scenario."""
    triangles = f"{len(scenario.cavity.mesh.faces)} triangles, {len(scenario.collision.faces)} for contacts"
    print(f"{scenario.name}: {triangles}, {scenario.settings.limits.substeps} substeps")
    solvers = ("bullet", "own") if default_contacts() == "bullet" else ("own",)
    for contacts, rays in itertools.product(solvers, ("mesh", "field")):
        options: dict[str, Any] = {"reward": "safe", "contacts": contacts, "rays": rays}
        env, flowing = (CaveEnv(scenario, current=current, **options) for current in (CURRENT, "full"))
        runs = (
            ("ahead", env, steer_to_goal),
            ("ahead, full flow", flowing, steer_to_goal),
            ("random", env, act_at_random),
        )
        for name, which, act in runs:
            duration = per_decision(which, act, size)
            print(f"  {contacts:<6} {rays:<5} {name:<17}{1e6 / duration:8.0f} decisions/s {duration:8.1f} us each")
        if contacts == "bullet":
            num_asked, duration = bullet_steps(env, size)
            print(f"  random: {num_asked:.1f} steps per decision ask Bullet, whose own step takes {duration:.1f} us")
        print(f"  reset {microseconds(env.reset, size.resets, size.repeats) / 1000:.3f} ms")
        env.close()
        flowing.close()
    print(f"  memory per extra environment {memory_per_env(scenario, size.extra):.2f} MB, the mean of {size.extra}")


def report_drones(size: Size) -> None:
    """Print the speed of gym-pybullet-drones' hover task, where it is installed."""
    if importlib.util.find_spec(DRONES) is None:
        print("gym-pybullet-drones is left out: it is not installed.")
        return
    from gym_pybullet_drones.envs.HoverAviary import HoverAviary

    env = HoverAviary(ctrl_freq=30, pyb_freq=240)
    duration = per_decision(env, lambda env, obs: env.action_space.sample(), size)
    print(f"gym-pybullet-drones, HoverAviary: {1e6 / duration:.0f} decisions/s, {duration:.1f} us each")
    env.close()


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("scenario", type=Path, nargs="*")
    options = parser.parse_args()
    size, tube = (SMOKE, (24, 30)) if options.smoke else (Size(), (144, 174))
    for scenario in [read_scenario(path) for path in options.scenario] or [fine_tube(*tube)]:
        report(scenario, size)
    report_drones(size)


if __name__ == "__main__":
    main()
