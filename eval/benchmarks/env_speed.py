"""Measure the environment: decisions per second on one core, and where the time goes.

    python eval/benchmarks/env_speed.py [scenario folder ...]

Without a folder it takes a tube of about 36,000 triangles. "ahead" swims along the route with the reactive habit
of steering to the goal; "random" draws actions and soon rubs along the walls, which is the dearest that can happen.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import argparse
import dataclasses
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2]))  # the tiny caves live with the tests

from aquanav_tools.cave.cavity import prove_watertight
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.observation import layout
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Mesh
from tests.caves import TUBE_LENGTH, TUBE_RADIUS, tube_scenario

DECISIONS, REPEATS = 4000, 5
GOAL = layout("full")["goal"]
RNG = np.random.default_rng(0)


def fine_tube(num_around: int = 120, num_along: int = 150) -> Scenario:
    """Return the tests' tube with a wall of about 36,000 well-shaped triangles."""
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
    labels = np.zeros(len(mesh.faces), dtype=np.int64)
    tube = tube_scenario()
    cavity = dataclasses.replace(tube.cavity, mesh=mesh, labels=labels, observed=labels == 0)
    prove_watertight(mesh)
    return dataclasses.replace(tube, cavity=cavity, collision=mesh)


def steer_to_goal(obs: np.ndarray) -> list[int]:
    """Return an action that swims to the goal and does not look at the rays."""
    _, azimuth, elevation = obs[GOAL].tolist()
    turn = 0 if azimuth > 0.03 else 2 if azimuth < -0.03 else 1
    return [0 if elevation > 0.1 else 2 if elevation < -0.1 else 1, turn, 2]


def act_at_random(obs: np.ndarray) -> list[int]:
    """Return any action."""
    return RNG.integers(0, 3, 3).tolist()


def decisions_per_second(env: CaveEnv, act: Callable[[np.ndarray], list[int]]) -> float:
    """Return the best of several runs, by this process's own time: other processes on the machine do not count."""
    best = 0.0
    for _ in range(REPEATS):
        obs, _ = env.reset(seed=0)
        start = time.process_time()
        for _ in range(DECISIONS):
            obs, _, terminated, truncated, _ = env.step(act(obs))
            if terminated or truncated:
                obs, _ = env.reset()
        best = max(best, DECISIONS / (time.process_time() - start))
    return best


def microseconds(function: Callable[[], object], calls: int = 2000) -> float:
    """Return the time of one call, the best of several runs."""
    best = np.inf
    for _ in range(REPEATS):
        start = time.process_time()
        for _ in range(calls):
            function()
        best = min(best, time.process_time() - start)
    return best / calls * 1e6


def breakdown(env: CaveEnv) -> dict[str, float]:
    """Return the microseconds of a decision's parts in free water."""
    env.reset(seed=0)
    still = np.zeros(3)
    idle = env._actuators.apply(0.0, 0.0, 0.0)
    rays = env._sensor.sense(env._world.state)
    return {
        "action and actuators": microseconds(lambda: env._actuators.apply(*env._action_model.command([1, 1, 1]))),
        "physics, all substeps": microseconds(lambda: env._world.step(idle, still)),
        "28 rays": microseconds(lambda: env._sensor.sense(env._world.state)),
        "progress along the guide": microseconds(env._update_progress),
        "observation": microseconds(lambda: env._observe(rays, env._action_model.command([1, 1, 1]))),
        "info": microseconds(lambda: env._info(rays, False, {})),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenario", type=Path, nargs="*")
    scenarios = [read_scenario(path) for path in parser.parse_args().scenario] or [fine_tube()]
    for scenario in scenarios:
        env = CaveEnv(scenario)
        env.reset(seed=0)
        env.step([1, 1, 1])  # compiles
        triangles = f"{len(scenario.cavity.mesh.faces)} triangles, {len(scenario.collision.faces)} for contacts"
        print(f"{scenario.name}: {triangles}, {scenario.settings.limits.substeps} substeps")
        print(f"  ahead   {decisions_per_second(env, steer_to_goal):8.0f} decisions/s")
        print(f"  random  {decisions_per_second(env, act_at_random):8.0f} decisions/s")
        for name, duration in breakdown(env).items():
            print(f"  {name:<26}{duration:6.1f} us")
        env.close()


if __name__ == "__main__":
    main()
