"""One cave of a batch: who dives it, where episodes begin, and what the physics are told of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from aquanav_tools.envs.reward import TERMS, cave_weights
from aquanav_tools.envs.starting import Starts
from aquanav_tools.envs.vehicles import prepared
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Current, Scenario
from aquanav_tools.sim.time_limit import decision_limit
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.sim.water import WaterParts, water_of
from aquanav_tools.task import TaskOptions
from aquanav_tools.types import Pose

if TYPE_CHECKING:
    from aquanav_tools.sim.batch.setup import CaveSetup

CaveSpec = str | Path | Scenario


@dataclass(frozen=True, eq=False)
class Room:
    """A cave, with what is made of it."""

    scenario: Scenario
    vehicle: Vehicle
    starts: Starts
    setup: CaveSetup


def make_room(
    cave: CaveSpec, vehicle: str | Path | Vehicle | None, task: TaskOptions, reward: str, limit: int | None
) -> Room:
    """Return what is made of a cave and the vehicle in it.

    Args:
        cave: A scenario folder, or a scenario in memory.
        vehicle: Its name or file; None for the cave's own.
        task: The options.
        reward: Name of the reward.
        limit: Decisions of an episode; None takes the cave's own.

    Raises:
        ScenarioError: the scenario cannot be read, or has no start.
        InputError: an option makes no sense, or the vehicle's hull does not fit.
    """
    scenario, craft = prepared(cave, vehicle)
    starts = Starts(scenario, craft.capsule, task.starts, task.start_range)
    return Room(scenario, craft, starts, _setup(scenario, craft, task, reward, starts, limit))


def _setup(
    scenario: Scenario,
    vehicle: Vehicle,
    options: TaskOptions,
    reward: str,
    starts: Starts,
    limit: int | None,
) -> CaveSetup:
    from aquanav_tools.sim.batch.caves import CaveTask
    from aquanav_tools.sim.batch.setup import CaveSetup

    limit = decision_limit(scenario, vehicle) if limit is None else limit
    if limit < 1:
        raise InputError(f"max_decisions must be at least 1, got {limit}.")
    weights = cave_weights(reward, vehicle)
    task = CaveTask(
        goal=np.array(scenario.settings.goal.position, dtype=np.float64),
        tolerance=scenario.settings.goal.tolerance,
        max_decisions=limit,
        ends_on_collision=weights.ends_on_collision or options.on_collision == "end",
        weights=tuple(getattr(weights, name) for name in TERMS),
        entrance=scenario.guide.centres[0],
        water=_water_of(scenario, options.current),
        progress=options.progress,
        start_numbers=starts.numbers,
    )
    return CaveSetup(scenario, vehicle, task, partial(_drawn, starts) if options.starts == "anywhere" else None)


def _drawn(starts: Starts, seed: int) -> Pose:
    return starts.draw(np.random.default_rng(seed))


def _water_of(scenario: Scenario, current: Current | None) -> WaterParts:
    try:
        return water_of(scenario, current)
    except ValueError as cause:
        raise InputError(f"{cause} Choose another current.") from cause
