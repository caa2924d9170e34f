"""A boat's task, for the environment with one and for the batch: bays, seas, rules and spaces, and what is drawn."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.envs.bays import Bays
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.dict_observation import Parts
from aquanav_tools.envs.episode import COLLISION_RULES
from aquanav_tools.envs.extensions import Extensions
from aquanav_tools.envs.reward import TERMS, boat_weights
from aquanav_tools.envs.seas import Seas
from aquanav_tools.envs.starting import EVERYWHERE
from aquanav_tools.envs.surface_observation import DISTANCE_SCALE, SPEED_SCALE, surface_size
from aquanav_tools.errors import InputError
from aquanav_tools.sea.generate import MapSettings
from aquanav_tools.sea.sea_map import SeaMap
from aquanav_tools.sim.batch import sensors
from aquanav_tools.sim.batch.boat_state import BoatEpisode, BoatTask, DrawEpisode
from aquanav_tools.sim.batch.boat_world import BoatWorld
from aquanav_tools.sim.boat import Boat, footprint_of, load_boat
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.randomisation import read_randomisation
from aquanav_tools.sim.scales import RATE_SCALE
from aquanav_tools.sim.sea_state import SeaState
from aquanav_tools.sim.sensors import boat_pattern
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.task import TaskOptions

DT, SUBSTEPS, MAX_DECISIONS = 0.02, 5, 2400
"""The original's: physics step (s), steps per decision, and its limit of 12000 steps."""
ORIGINAL_BOAT = "boat"
Bay = SeaMap | MapSettings | int | str | Path | None


@dataclass(frozen=True)
class SurfaceChoices:
    """What both environments of boats are made with."""

    sea: str | SeaState = "calm"
    observation: str | Parts = "full"
    vehicle: str | Path | Boat | OriginalVehicle = "otter"
    max_decisions: int | None = None


def split_options(options: dict[str, Any]) -> tuple[SurfaceChoices, dict[str, Any]]:
    """Return the choices among named options, and the others, which are the task's."""
    own = {field.name for field in fields(SurfaceChoices)}
    choices = SurfaceChoices(**{name: value for name, value in options.items() if name in own})
    return choices, {name: value for name, value in options.items() if name not in own}


class SurfaceTask:
    """Prepares worlds of boats, and draws their episodes."""

    def __init__(self, bay: Bay, choices: SurfaceChoices, options: TaskOptions, own: Extensions) -> None:
        """Prepare bays and rules.

        Args:
            bay: As of `SurfaceEnv`.
            choices: The environment's own options.
            options: Of the task.
            own: What of the options is the user's own.

        Raises:
            ScenarioError: the bay cannot be read, or has no start.
            InputError: an option is unknown or senseless.
        """
        if options.start_range != EVERYWHERE:
            raise InputError("Bays have no share of the way to begin in: leave out start_range.")
        self._law = own.law(DT)
        self._ranges = None if options.randomisation is None else read_randomisation(options.randomisation)
        self.options, self.boat, self.pattern = options, boat_of(choices.vehicle), boat_pattern()
        self.footprint = footprint_of(self.boat)
        self.numbers = _task_numbers(options, choices, own)
        self.bays = Bays(bay, self.footprint.width, options.starts)
        self._seas = Seas(choices.sea, options.current)

    def make_world(
        self, num: int, draw_episode: DrawEpisode, next_step: bool, device: str, num_threads: int | None
    ) -> BoatWorld:
        """Return a world of `num` boats; arguments as of `BoatWorld`."""
        return BoatWorld(
            self.boat,
            self.numbers,
            num,
            draw_episode,
            pattern=self.pattern,
            num_waves=self._seas.num_waves,
            randomisation=self._ranges,
            law=self._law,
            next_step=next_step,
            device=device,
            num_threads=num_threads,
        )

    def draw(self, seed: int, options: TaskOptions, start: int | None) -> BoatEpisode:
        """Return the episode of a seed: its bay, berth, sea and current are drawn, in this order, and gusts later on.

        Args:
            seed: From 0 to 2^32 - 1.
            options: Of this episode.
            start: Number of one of a fixed bay's berths; None draws the berth.

        Raises:
            InputError: there is no such berth.
        """
        rng = np.random.default_rng(seed)
        sea, berth, path, number = self.bays.choose(rng, {} if start is None else {"start": start})
        water, fraction = self._seas.draw(rng, sea.depth, options.current_range)
        noise, dropout = options.sensor_noise, options.sensor_dropout
        return BoatEpisode(sea, berth, water, path, number, fraction, noise, dropout, seed)


def refuse_in_bays(options: TaskOptions, observation: str | Parts) -> None:
    """Refuse what has a meaning in caves alone.

    Raises:
        InputError: it is a sensor that comes with aquanav.
    """
    parts = () if isinstance(observation, str) else observation.values()
    for name in (*options.sensors, *parts):
        if isinstance(name, str) and name in sensors.BUILT_IN:
            raise InputError(
                f"The sensor {name} measures in caves: the rock around a vehicle, or its motion under water. Boats "
                "have their beams, and sensors of your own, named as module:Name. Leave it out."
            )


def boat_of(vehicle: str | Path | Boat | OriginalVehicle) -> Boat | OriginalVehicle:
    """Return a boat by its name or the path of its TOML file; "boat" is the original's.

    Raises:
        InputError: there is no such boat.
    """
    if isinstance(vehicle, Boat):
        return vehicle
    found = load_vehicle(vehicle) if vehicle == ORIGINAL_BOAT else vehicle
    if isinstance(found, str | Path):
        return load_boat(found)
    if not isinstance(found, OriginalVehicle) or found.ballast is not None:
        name = getattr(found, "name", found)
        raise InputError(f"{name!r} is no boat. Boats are `sim.boat.Boat`, and the original's, '{ORIGINAL_BOAT}'.")
    return found


def _task_numbers(options: TaskOptions, choices: SurfaceChoices, own: Extensions) -> BoatTask:
    """Return the task as the kernels take it, without what is the user's own.

    Raises:
        InputError: there is no such rule for collisions or measure of progress, or no decision is allowed.
    """
    weights = boat_weights(own.reward)
    check_choice("measure of progress on the surface", options.progress, ("panels",))
    check_choice("collision rule", options.on_collision, COLLISION_RULES)
    limit = MAX_DECISIONS if choices.max_decisions is None else choices.max_decisions
    if limit < 1:
        raise InputError(f"max_decisions must be at least 1, got {limit}.")
    return BoatTask(
        max_decisions=limit,
        ends_on_collision=weights.ends_on_collision or options.on_collision == "end",
        weights=tuple(getattr(weights, name) for name in TERMS),
        scales=(DISTANCE_SCALE, SPEED_SCALE, RATE_SCALE),
        observation=own.observation,
        size=surface_size(own.observation),
        action_delay=options.action_delay,
        observation_delay=own.observation_delay,
        dt=DT,
        substeps=SUBSTEPS,
    )
