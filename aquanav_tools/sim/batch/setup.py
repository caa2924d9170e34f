"""What a batch in caves is made from: its caves, each with a vehicle and a task, and what all vehicles share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.caves import CaveTask
from aquanav_tools.sim.batch.engine import MotionLaw
from aquanav_tools.sim.randomisation import Randomisation
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Pose

RaySource = Literal["field", "mesh"]


@dataclass(frozen=True, eq=False)
class CaveSetup:
    """One of the caves of a batch."""

    scenario: Scenario
    vehicle: Vehicle
    """Moves and collides as all vehicles in this cave do."""
    task: CaveTask
    draw_start: Callable[[int], Pose] | None = None
    """Returns the start of the episode with a seed from 0 to 2^32 - 1; None draws from the scenario's list."""


@dataclass(frozen=True, kw_only=True)
class WorldOptions:
    """What all vehicles of a batch have in common."""

    observation: str = "full"
    """One of `observation.PRESETS`."""
    rays: RaySource = "field"
    """Traced through the distance field, or cast exactly against the mesh."""
    action_delay: int = 0
    """Decisions between choosing an action and its effect."""
    observation_delay: int = 0
    """Decisions by which observations are late."""
    randomisation: Randomisation | None = None
    """From which each episode draws its vehicle's dynamics; None leaves them as the vehicle's file has them."""
    next_step: bool = True
    """Whether an ended episode's successor begins at the next step (its command is not used then), or in the same."""
    device: str = "cpu"
    """"cpu", "cuda" or "cuda:0"."""
    num_threads: int | None = None
    """On the processor; None takes as many as the process may use."""
    law: MotionLaw | None = None
    """How vehicles move where there is no wall; None leaves it to the kernels. On the processor only."""
