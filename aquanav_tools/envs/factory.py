"""Scenarios of both tasks, caves and bays, and the environment of either: for training and evaluation."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from aquanav_tools.envs.batch import Batch
from aquanav_tools.envs.boat_batch import BoatBatch
from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.joint_batch import JointBatch
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.envs.surface_task import ORIGINAL_BOAT, boat_of
from aquanav_tools.envs.vehicles import dived_by, left_out_sentence
from aquanav_tools.errors import InputError
from aquanav_tools.provenance import file_hash
from aquanav_tools.scenario.bay import Bay, is_bay, read_bay
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import OtherVehicle, Scenario
from aquanav_tools.scenario.shipped import build_side_by_side
from aquanav_tools.scenario.split import distribution_of, fixed_draw
from aquanav_tools.sim.boat import boat_path
from aquanav_tools.sim.contacts import Contacts
from aquanav_tools.sim.vehicle import vehicle_path

logger = logging.getLogger(__name__)

AnyScenario = Scenario | Bay
Spec = str | Path | AnyScenario
Given = TypeVar("Given", bound=Spec)
NUM_DRAWN = 16
"""Caves that stand for a style without a seed, unless another number is asked for."""
TaskEnv = CaveEnv | SurfaceEnv


def read_any_scenario(spec: str | Path) -> AnyScenario:
    """Return the cave or the bay of a name or path.

    Raises:
        ScenarioError: it cannot be read.
    """
    return read_bay(spec) if is_bay(spec) else read_scenario(spec)


def with_vehicle(scenario: AnyScenario, vehicle: str | None) -> AnyScenario:
    """Return a scenario with another vehicle, by name or path, in scenario of its own; itself without one.

    Raises:
        InputError: there is no such vehicle or boat, or its hull does not fit, as in `vehicles.with_room_for`.
    """
    if vehicle is None:
        return scenario
    if isinstance(scenario, Scenario):
        return dived_by(scenario, vehicle)
    boat = boat_of(vehicle)
    if boat == boat_of(scenario.settings.vehicle):
        return scenario
    path = vehicle_path(vehicle) if vehicle == ORIGINAL_BOAT else boat_path(vehicle)
    other = OtherVehicle(getattr(boat, "name", path.stem), vehicle, file_hash(path))
    return replace(scenario, settings=replace(scenario.settings, vehicle=vehicle), other_vehicle=other)


def say_left_out(scenarios: Iterable[AnyScenario]) -> None:
    """Log a warning for each scenario, once, in which another vehicle has fewer starts than the scenario's own."""
    for scenario in dict.fromkeys(scenarios):
        other = scenario.other_vehicle
        if other is not None and other.left_out and isinstance(scenario, Scenario):
            logger.warning(left_out_sentence(scenario, other.name, len(other.left_out)))


def make_env(
    scenario: AnyScenario, *, max_decisions: int | None = None, contacts: Contacts | None = None, **choices: Any
) -> TaskEnv:
    """Return the environment of a scenario.

    Args:
        scenario: The scenario.
        max_decisions: Episode limit; None takes the scenario's.
        contacts: In caves, as `CaveEnv` has it.
        choices: observation, action, and the fields of `TaskOptions`.
    """
    if isinstance(scenario, Scenario):
        return CaveEnv(scenario, max_decisions=max_decisions, contacts=contacts, **choices)
    settings = scenario.settings
    return SurfaceEnv(
        scenario.map_path or settings.rocks,
        sea=settings.sea,
        vehicle=settings.vehicle,
        max_decisions=max_decisions or settings.decisions,
        **choices,
    )


def with_drawn(specs: Given | Sequence[Given], num: int, num_caves: int, cave_seed: int) -> list[Given | str]:
    """Return scenarios as a list, with caves, which are built, in place of each generated/STYLE without a seed.

    Args:
        specs: The scenarios.
        num: Vehicles: at most so many scenarios there are.
        num_caves: Caves that are drawn for all such names together.
        cave_seed: Draws them.

    Raises:
        ScenarioError: a cave cannot be built.
        InputError: there is no such style, or no number of caves.
    """
    several: list[Given] = [specs] if isinstance(specs, str | Path | AnyScenario) else list(specs)
    if num_caves < 1:
        raise InputError(f"num_caves must be at least 1, got {num_caves}.")
    num_drawn = sum(isinstance(spec, str | Path) and distribution_of(str(spec)) is not None for spec in several)
    if not num_drawn:
        return [*several]
    drawn = fixed_draw(several, min(num_caves, num - len(several) + num_drawn), cave_seed)
    build_side_by_side(drawn)
    return drawn


def make_batch(
    scenarios: Spec | Sequence[Spec],
    num: int,
    *,
    max_decisions: int | None = None,
    num_caves: int = NUM_DRAWN,
    cave_seed: int = 0,
    **choices: Any,
) -> Batch:
    """Return a batch of `num` vehicles in a scenario, in a cave or in bays; or in several.

    Args:
        scenarios: The scenario, its name or path; or several, over which the vehicles are shared out evenly, in order.
        num: Vehicles.
        max_decisions: Episode limit; None takes each scenario's.
        num_caves: Caves that stand for generated/STYLE, or generated/mixed, without a seed: a fixed draw of those that
            are for training.
        cave_seed: Draws them.
        choices: The other options of `CaveBatch` or `BoatBatch`.

    Raises:
        ScenarioError: a scenario cannot be read, or has no start.
        InputError: an option is unknown, senseless or not batched; or scenarios do not go into one batch.
    """
    several = with_drawn(scenarios, num, num_caves, cave_seed)
    if not several:
        raise InputError("A batch needs a scenario.")
    read = [read_any_scenario(scenario) if isinstance(scenario, str | Path) else scenario for scenario in several]
    caves = [scenario for scenario in read if isinstance(scenario, Scenario)]
    bays = [scenario for scenario in read if isinstance(scenario, Bay)]
    if caves and bays:
        raise InputError(
            f"{caves[0].name} is a cave and {bays[0].name} a bay: they do not go into one batch, as their actions and "
            "observations differ."
        )
    if caves:
        return CaveBatch(caves, num, max_decisions=max_decisions, **choices)
    makes = [_bay_maker(bay, max_decisions) for bay in bays]
    return makes[0](num, **choices) if len(makes) == 1 else JointBatch(makes, num, **choices)


def _bay_maker(scenario: Bay, max_decisions: int | None) -> Callable[..., Batch]:
    """Return what makes a bay's batch of a number of boats and further options."""
    settings = scenario.settings
    return partial(
        BoatBatch,
        scenario.map_path or settings.rocks,
        sea=settings.sea,
        vehicle=settings.vehicle,
        max_decisions=max_decisions or settings.decisions,
    )


def cave_of(scenario: AnyScenario, what: str) -> Scenario:
    """Return a scenario that is a cave; `what` takes no other.

    Raises:
        InputError: it is a bay.
    """
    if isinstance(scenario, Bay):
        raise InputError(f"{what} takes caves only, and {scenario.name} is a bay. Leave it out, or name a cave.")
    return scenario
