"""A boat's task, for the environment with one and for the batch: bays, seas, rules and spaces, and what is drawn."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.envs.bays import Bays
from aquanav_tools.envs.choices import check_choice
from aquanav_tools.envs.definitions import refuse_own
from aquanav_tools.envs.episode import COLLISION_RULES
from aquanav_tools.envs.reward import TERMS, boat_weights
from aquanav_tools.envs.seas import Seas
from aquanav_tools.envs.surface_observation import DISTANCE_SCALE, SPEED_SCALE, surface_size, surface_space
from aquanav_tools.errors import InputError
from aquanav_tools.sea.generate import MapSettings
from aquanav_tools.sea.sea_map import SeaMap
from aquanav_tools.sim.batch.boat_state import BoatEpisode, BoatTask, DrawEpisode
from aquanav_tools.sim.batch.boat_world import BoatWorld, Succession
from aquanav_tools.sim.boat import Boat, footprint_of, load_boat
from aquanav_tools.sim.original import OriginalVehicle
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
    observation: str = "full"
    vehicle: str | Path | Boat | OriginalVehicle = "otter"
    max_decisions: int | None = None


def split_options(options: dict[str, Any]) -> tuple[SurfaceChoices, dict[str, Any]]:
    """Return the choices among named options, and the others, which are the task's."""
    own = {field.name for field in fields(SurfaceChoices)}
    choices = SurfaceChoices(**{name: value for name, value in options.items() if name in own})
    return choices, {name: value for name, value in options.items() if name not in own}


class SurfaceTask:
    """Prepares worlds of boats, and draws their episodes."""

    def __init__(self, bay: Bay, choices: SurfaceChoices, options: TaskOptions) -> None:
        """Prepare bays and rules.

        Raises:
            ScenarioError: the bay cannot be read, or has no start.
            InputError: an option is unknown or senseless.
        """
        refuse_own(options, choices.observation, "Boats")
        if options.randomisation is not None:
            raise InputError(
                f"Boats draw no dynamics, and randomisation is '{options.randomisation}'. Leave it out, or take a cave."
            )
        self.options, self.boat, self.pattern = options, boat_of(choices.vehicle), boat_pattern()
        self.footprint = footprint_of(self.boat)
        self.observation_space = surface_space(choices.observation)
        self.numbers = _task_numbers(options, choices)
        self.bays = Bays(bay, self.footprint.width, options.starts)
        self._seas = Seas(choices.sea, options.current)

    def make_world(
        self,
        num: int,
        draw_episode: DrawEpisode,
        succession: Succession,
        device: str = "cpu",
        num_threads: int | None = None,
    ) -> BoatWorld:
        """Return a world of `num` boats; arguments as of `BoatWorld`."""
        return BoatWorld(
            self.boat,
            self.numbers,
            num,
            draw_episode,
            pattern=self.pattern,
            num_waves=self._seas.num_waves,
            succession=succession,
            device=device,
            num_threads=num_threads,
        )

    def draw(self, rng: np.random.Generator, options: TaskOptions, start: int | None) -> BoatEpisode:
        """Return an episode: its bay, berth, sea and current are drawn, in this order, and what its sensor errs by.

        Args:
            rng: What is drawn from, gusts later on included.
            options: Of this episode.
            start: Number of one of a fixed bay's berths; None draws the berth.

        Raises:
            InputError: there is no such berth.
        """
        sea, berth, path, number = self.bays.choose(rng, {} if start is None else {"start": start})
        water, fraction = self._seas.draw(rng, sea.depth, options.current_range)
        noise, dropout = options.sensor_noise, options.sensor_dropout
        ray_seed = int(rng.integers(1 << 32)) if noise > 0.0 or dropout > 0.0 else 0
        return BoatEpisode(sea, berth, water, path, number, fraction, noise, dropout, ray_seed)


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


def _task_numbers(options: TaskOptions, choices: SurfaceChoices) -> BoatTask:
    """Return the task as the kernels take it.

    Raises:
        InputError: there is no such rule for collisions or measure of progress, or no decision is allowed.
    """
    weights = boat_weights(options.reward)
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
        observation=choices.observation,
        size=surface_size(choices.observation),
        action_delay=options.action_delay,
        observation_delay=options.observation_delay,
        dt=DT,
        substeps=SUBSTEPS,
    )


def episode_info(world: BoatWorld, i: int) -> dict[str, Any]:
    """Return what is known of boat `i` after a decision, by the keys of `SurfaceEnv`'s info but for the reward's."""
    row = {name: world.view_of(name)[i] for name in _INFO}
    info: dict[str, Any] = {
        "position": row["positions"].copy(),
        "orientation": row["orientations"].copy(),
        "velocity": row["velocities"].copy(),
        "current": world.current_at(i),
        "rays": row["rays"].copy(),
        "clearance": float(row["clearances"]),
        "collision": bool(row["touched"] > 0),
        "num_collisions": int(row["collisions"]),
        "progress": float(row["lengths"] - row["remaining"]),
        "remaining": float(row["remaining"]),
        "cost": float(row["touched"] > 0),
    }
    return info


_INFO = (
    "positions", "orientations", "velocities", "rays", "clearances", "touched", "collisions", "lengths", "remaining",
)  # fmt: skip
