"""Scenarios of both tasks, caves and bays, and the environment of either: for training and evaluation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from aquanav_tools.envs.batch import Batch
from aquanav_tools.envs.boat_batch import BoatBatch
from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.bay import Bay, is_bay, read_bay
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario

Place = Scenario | Bay
PlaceEnv = CaveEnv | SurfaceEnv


def read_place(spec: str | Path) -> Place:
    """Return the cave or the bay of a name or path.

    Raises:
        ScenarioError: it cannot be read.
    """
    return read_bay(spec) if is_bay(spec) else read_scenario(spec)


def make_env(place: Place, *, max_decisions: int | None = None, **choices: Any) -> PlaceEnv:
    """Return the environment of a scenario.

    Args:
        place: The scenario.
        max_decisions: Episode limit; None takes the scenario's.
        choices: observation, action, and the fields of `TaskOptions`.
    """
    if isinstance(place, Scenario):
        return CaveEnv(place, max_decisions=max_decisions, **choices)
    settings = place.settings
    return SurfaceEnv(
        place.map_path or settings.rocks,
        sea=settings.sea,
        vehicle=settings.vehicle,
        max_decisions=max_decisions or settings.decisions,
        **choices,
    )


def make_batch(place: str | Path | Place, num: int, *, max_decisions: int | None = None, **choices: Any) -> Batch:
    """Return a batch of `num` vehicles in a scenario: in a cave Warp's, in bays compiled loops.

    Args:
        place: The scenario, its name or path.
        num: Vehicles.
        max_decisions: Episode limit; None takes the scenario's.
        choices: The other options of `CaveBatch` or `BoatBatch`.
    """
    found = read_place(place) if isinstance(place, str | Path) else place
    if isinstance(found, Scenario):
        return CaveBatch(found, num, max_decisions=max_decisions, **choices)
    settings = found.settings
    return BoatBatch(
        found.map_path or settings.rocks,
        num,
        sea=settings.sea,
        vehicle=settings.vehicle,
        max_decisions=max_decisions or settings.decisions,
        **choices,
    )


def cave_of(place: Place, what: str) -> Scenario:
    """Return a scenario that is a cave; `what` takes no other.

    Raises:
        InputError: it is a bay.
    """
    if isinstance(place, Bay):
        raise InputError(f"{what} takes caves only, and {place.name} is a bay. Leave it out, or name a cave.")
    return place
