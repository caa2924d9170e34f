"""What the kernels of boats read and write, as structures on the device."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.sea.sea_map import Berth, SeaMap, ShortestPath
from aquanav_tools.sim.batch.boat_contact import Bay, HullOutline, OutlineWork
from aquanav_tools.sim.batch.boat_hull import HullWork
from aquanav_tools.sim.batch.boat_motion import BoatBody
from aquanav_tools.sim.batch.boat_rays import Beams
from aquanav_tools.sim.batch.boat_water import Sea
from aquanav_tools.sim.batch.motion import vec6
from aquanav_tools.sim.batch.runtime import BOAT_OPTIONS
from aquanav_tools.sim.sea_water import SeaWater

wp.set_module_options(BOAT_OPTIONS)

f64 = wp.float64
AHEAD = 128
"""Decisions for which gusts are drawn at once: chosen; drawing takes as long for one as for all of them."""
PRESETS = ("paper", "full", "original")
PAPER, FULL, ORIGINAL = (wp.constant(n) for n in range(3))


@dataclass(frozen=True)
class BoatTask:
    """The task's definition as the kernels take it; `envs` fills it."""

    max_decisions: int
    ends_on_collision: bool
    weights: tuple[float, ...]
    """(7,) of the reward's terms, in the order of `envs.reward.TERMS`."""
    scales: tuple[float, float, float]
    """Of the observation: distance to the goal, m; speed, m/s; rate of turn, rad/s."""
    observation: str
    """One of PRESETS."""
    size: int
    """Values of an observation."""
    action_delay: int = 0
    """Decisions between choosing an action and its effect."""
    observation_delay: int = 0
    """Decisions by which observations are late."""
    dt: float = 0.02
    """Physics step, s."""
    substeps: int = 5
    """Physics steps of a decision."""


@dataclass(frozen=True)
class BoatEpisode:
    """All that is drawn for an episode when it begins."""

    bay: SeaMap
    berth: Berth
    """Where the boat begins."""
    water: SeaWater
    """Its waves, and the gusts to come."""
    path: ShortestPath | None = None
    """The shortest from the berth to the goal."""
    start_index: int = -1
    """Of the berth in the bay's list; -1 where it is in none."""
    current_fraction: float = 1.0
    """Of the water's current."""
    noise: float = 0.0
    """Standard deviation of the error of each beam's distance, m."""
    dropout: float = 0.0
    """Probability that a beam gets no echo."""
    seed: int = 0
    """From 0 to 2^32 - 1: all above was drawn from it, and what kernels draw follows from it."""


DrawEpisode = Callable[[int], BoatEpisode]
"""Returns the next episode of a boat."""


@wp.struct
class BoatRules:
    """`BoatTask` on the device."""

    max_decisions: wp.int32
    ends_on_collision: wp.int32
    weights: wp.array(dtype=f64)
    scales: wp.vec3d
    preset: wp.int32
    dt: f64
    substeps: wp.int32


def make_boat_rules(task: BoatTask, device: Any) -> BoatRules:
    """Return a task on a device."""
    rules = BoatRules()
    rules.max_decisions, rules.ends_on_collision = task.max_decisions, int(task.ends_on_collision)
    rules.weights, rules.scales = wp.array(task.weights, dtype=wp.float64, device=device), wp.vec3d(*task.scales)
    rules.preset = PRESETS.index(task.observation)
    rules.dt, rules.substeps = task.dt, task.substeps
    return rules


@wp.struct
class Surroundings:
    """What is around each boat in its episode. All of it comes again from the episode's seed, but for the phases."""

    bays: wp.array(dtype=Bay)
    bay_of: wp.array(dtype=wp.int32)
    """(N,) the boat's bay."""
    sea: Sea
    currents: wp.array2d(dtype=wp.vec3d)
    """(N, AHEAD) of the water without its waves in the coming decisions, m/s."""
    winds: wp.array2d(dtype=wp.vec2d)
    """(N, AHEAD) of the air at 10 m, m/s."""


@wp.struct
class Model:
    """What boats are, and room to compute in."""

    bodies: wp.array(dtype=BoatBody)
    outline: HullOutline
    beams: Beams
    hull_work: HullWork
    outline_work: OutlineWork


@wp.struct
class FreeMotion:
    """Where a law of motion of the user's own says that boats would go were there no rocks."""

    positions: wp.array(dtype=wp.vec3d)
    orientations: wp.array(dtype=wp.vec4d)
    velocities: wp.array(dtype=vec6)


@wp.struct
class BoatState:
    """All boats: one row of each array per boat."""

    commands: wp.array2d(dtype=wp.float32)
    """(N, 3) ballast, of which boats have none, steer and thrust."""
    acting: wp.array2d(dtype=wp.float32)
    """(N, 3) the command that takes effect: an earlier one where actions are delayed."""
    waiting_commands: wp.array2d(dtype=wp.float32)
    """(N, 3 D) commands of the last D decisions, without effect so far."""
    waiting_observations: wp.array2d(dtype=wp.float32)
    """(N, V D) observations of the last D decisions, not seen so far."""
    positions: wp.array(dtype=wp.vec3d)
    orientations: wp.array(dtype=wp.vec4d)
    velocities: wp.array(dtype=vec6)
    positions_before: wp.array(dtype=wp.vec3d)
    """One physics step ago."""
    orientations_before: wp.array(dtype=wp.vec4d)
    currents: wp.array(dtype=wp.vec3d)
    """Of the water without its waves in the last decision, m/s."""
    body_of: wp.array(dtype=wp.int32)
    """Index of the body that each boat has."""
    noises: wp.array(dtype=wp.float32)
    dropouts: wp.array(dtype=wp.float32)
    ray_gain: wp.array(dtype=wp.float32)
    """Factor of the distances that beams measure, where dynamics are drawn; so the next three."""
    ray_bias: wp.array(dtype=wp.float32)
    """What is added to them, m."""
    action_delays: wp.array(dtype=wp.int32)
    """Decisions."""
    observation_delays: wp.array(dtype=wp.int32)
    """Decisions."""
    seeds: wp.array(dtype=wp.int32)
    """Of the episodes: 32 bits each, from which all that is drawn follows."""
    lengths: wp.array(dtype=f64)
    """Distance of the goal at the episode's beginning, m."""
    remaining: wp.array(dtype=f64)
    """Distance of the goal, m."""
    gained: wp.array(dtype=f64)
    """What that became shorter by in the last decision, m."""
    decisions: wp.array(dtype=wp.int32)
    ages: wp.array(dtype=wp.int32)
    """Decisions by which this episode's time runs out earlier."""
    touched: wp.array(dtype=wp.int32)
    """Physics steps of the last decision in contact."""
    is_touching: wp.array(dtype=wp.int32)
    collisions: wp.array(dtype=wp.int32)
    """Contacts begun in this episode."""
    outcomes: wp.array(dtype=wp.int32)
    held: wp.array(dtype=wp.int32)
    """Whether the boat stays where it is in this step: its last episode is over."""
    restarted: wp.array(dtype=wp.int32)
    """Whether this step began an episode."""
    rays: wp.array2d(dtype=wp.float32)
    """(N, R) true distances, m."""
    tags: wp.array2d(dtype=wp.int32)
    """(N, R) what the beams met."""
    clearances: wp.array(dtype=f64)
    """Of the hull from above, m; only `BoatWorld.as_numpy` computes them."""
    observations: wp.array2d(dtype=wp.float32)
    final_observations: wp.array2d(dtype=wp.float32)
    terms: wp.array2d(dtype=f64)
    """(N, 7) of the reward."""
    rewards: wp.array(dtype=f64)
    terminated: wp.array(dtype=wp.bool)
    truncated: wp.array(dtype=wp.bool)
    returns: wp.array(dtype=f64)
    """Sum of rewards in this episode."""
    last_outcomes: wp.array(dtype=wp.int32)
    """The last step's outcome, which the beginning of the next episode leaves as it is; so the next three."""
    last_returns: wp.array(dtype=f64)
    last_lengths: wp.array(dtype=wp.int32)
    last_collisions: wp.array(dtype=wp.int32)


def make_boat_state(num: int, task: BoatTask, num_rays: int, delays: tuple[int, int], device: Any) -> BoatState:
    """Return the arrays of `num` boats; `delays` are the longest of actions and of observations, decisions."""
    state, size = BoatState(), task.size
    widths = {"commands": 3, "acting": 3, "rays": num_rays, "tags": num_rays, "terms": len(task.weights)}
    widths |= {"observations": size, "final_observations": size}
    widths |= {"waiting_commands": 3 * delays[0], "waiting_observations": size * delays[1]}
    for name, field in BoatState.vars.items():  # type: ignore[attr-defined]  # Warp makes the class a struct
        shape = (num, widths[name]) if name in widths else (num,)
        setattr(state, name, wp.zeros(shape, dtype=field.type.dtype, device=device))
    state.ray_gain.fill_(1.0)
    state.action_delays.fill_(task.action_delay)
    state.observation_delays.fill_(task.observation_delay)
    return state


def write_row(array: Any, i: int, value: Any) -> None:
    """Write one row of a device's array."""
    if array.device.is_cpu:
        array.numpy()[i] = value
    else:
        row = wp.array(np.asarray(value)[None], dtype=array.dtype, ndim=array.ndim, device=array.device)
        wp.copy(array, row, dest_offset=i * row.size, count=row.size)
