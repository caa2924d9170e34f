"""Batches for tests: the reward "safe" and the full observation in a given scenario."""

from __future__ import annotations

from typing import Any

import numpy as np

from aquanav_tools.scenario.schema import Current, Scenario
from aquanav_tools.sim.batch.caves import CaveTask
from aquanav_tools.sim.batch.setup import CaveSetup, WorldOptions
from aquanav_tools.sim.batch.world import BatchWorld
from aquanav_tools.sim.contacts import default_contacts, load_bullet
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.sim.water import water_of
from aquanav_tools.task import ProgressMeasure


def make_world(
    scenario: Scenario,
    vehicle: Vehicle,
    num: int,
    *,
    has_goal: bool = True,
    current: Current = (0.0, 0.0, 0.0),
    progress: ProgressMeasure = "panels",
    contacts: str = "own",
    goal: Any = None,
    entrance: Any = (0.0, 0.0, 0.0),
    **options: Any,
) -> BatchWorld:
    """Return a batch whose episodes go on through collisions, reset with seeds and starts 0, 1, ... ."""
    settings = scenario.settings
    task = CaveTask(
        goal=np.array(settings.goal.position if goal is None else goal, dtype=np.float64),
        tolerance=settings.goal.tolerance if has_goal else -1.0,
        max_decisions=settings.limits.decisions,
        ends_on_collision=False,
        weights=(10.0, -0.01, -0.01, -0.02, 500.0, -1000.0, 0.0),
        entrance=np.array(entrance),
        water=water_of(scenario, current),
        progress=progress,
    )
    engines = [load_bullet()(scenario, vehicle) for _ in range(num)] if contacts == "bullet" else []
    setup = CaveSetup(scenario, vehicle, task)
    world = BatchWorld([setup], np.zeros(num, dtype=np.int32), WorldOptions(**options), engines)
    starts = np.arange(num, dtype=np.int32) % len(scenario.starts)
    world.reset(np.arange(num), starts, {"sensor_noise": 0.0, "sensor_dropout": 0.0, "current_range": (1.0, 1.0)})
    return world


def place(world: BatchWorld, positions: np.ndarray, orientations: np.ndarray | None = None) -> None:
    """Put the vehicles at rest at (N, 3) positions with (N, 4) quaternions."""
    world.arrays.positions.assign(positions)
    world.arrays.velocities.zero_()
    if orientations is not None:
        world.arrays.orientations.assign(orientations)


def look_from(world: BatchWorld, states: np.ndarray) -> np.ndarray:
    """Put the vehicles into (N, 13) states and return the (N, V) observations there."""
    place(world, states[:, :3], states[:, 3:7])
    world.arrays.velocities.assign(states[:, 7:13])
    world.observe()
    observations: np.ndarray = world.as_numpy("observations").copy()
    return observations


def random_turns(rng: np.random.Generator, num: int) -> np.ndarray:
    """Return (N, 4) unit quaternions in all directions."""
    turns = rng.normal(size=(num, 4))
    return turns / np.linalg.norm(turns, axis=1, keepdims=True)


class Dive:
    """One vehicle in a world of its own, that can be put anywhere and driven by commands."""

    def __init__(self, scenario: Scenario, vehicle: Vehicle, contacts: str | None = None, **options: Any) -> None:
        contacts = contacts or default_contacts()
        self.world = make_world(scenario, vehicle, 1, has_goal=False, contacts=contacts, num_threads=1, **options)

    def begin(self, position: Any, orientation: np.ndarray) -> None:
        """Begin anew, at rest at a pose."""
        self.world.reset(np.zeros(1), np.zeros(1, dtype=np.int32))
        place(self.world, np.array([position], dtype=np.float64), orientation[None])

    def step(self, *command: float) -> int:
        """Hold ballast, steer and thrust for a decision; return how many of its steps touched the wall."""
        self.world.as_numpy("commands")[:] = command
        self.world.step()
        return int(self.world.as_numpy("touched")[0])

    @property
    def state(self) -> np.ndarray:
        """(13,) or more: position, quaternion, velocity over ground in the body frame, what the model adds."""
        names = ("positions", "orientations", "velocities", "extra")
        return np.concatenate([self.world.as_numpy(name)[0] for name in names])

    def move(self, velocity: np.ndarray) -> None:
        """Give the vehicle a velocity and rate of turn, body frame."""
        self.world.as_numpy("velocities")[:] = velocity

    def close(self) -> None:
        """Let go of the physics."""
        self.world.close()
