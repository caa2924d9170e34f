"""Batches for tests: the reward "safe" and the full observation in a given scenario."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquanav_tools.scenario.schema import Current, Scenario
from aquanav_tools.sim.batch.fleet import BatchWorld
from aquanav_tools.sim.batch.fleet_arrays import TaskNumbers
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.sim.water import Water


def make_world(
    scenario: Scenario,
    vehicle: Vehicle,
    num: int,
    has_goal: bool = True,
    current: Current = (0.0, 0.0, 0.0),
    **options: Any,
) -> BatchWorld:
    """Return a batch whose episodes go on through collisions, reset with seed 0 and the starts 0, 1, ... ."""
    settings = scenario.settings
    task = TaskNumbers(
        goal=np.array(settings.goal.position),
        tolerance=settings.goal.tolerance if has_goal else -1.0,
        max_decisions=settings.limits.decisions,
        ends_on_collision=False,
        weights=(10.0, -0.01, -0.01, -0.02, 500.0, -1000.0, 0.0),
        scales=(10.0, 1.0, 0.5 * np.pi),
        entrance_height=0.0,
        size=44,
    )
    water = Water(scenario, current)
    world = BatchWorld(scenario, vehicle, task, num, water=water, **options)
    world.reset(np.arange(num), np.arange(num, dtype=np.int32) % len(scenario.starts))
    return world


def place(world: BatchWorld, positions: np.ndarray, orientations: np.ndarray | None = None) -> None:
    """Put the vehicles at rest at (N, 3) positions with (N, 4) quaternions."""
    world.fleet.positions.assign(positions)
    world.fleet.velocities.zero_()
    if orientations is not None:
        world.fleet.orientations.assign(orientations)


def random_turns(rng: np.random.Generator, num: int) -> np.ndarray:
    """Return (N, 4) unit quaternions in all directions."""
    turns = rng.normal(size=(num, 4))
    return turns / np.linalg.norm(turns, axis=1, keepdims=True)
