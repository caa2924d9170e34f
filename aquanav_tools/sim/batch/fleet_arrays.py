"""What the kernels read and write, as structures on the device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.actuators import Controls, make_controls
from aquanav_tools.sim.batch.contact import Hull
from aquanav_tools.sim.batch.disturbance import Disturbance
from aquanav_tools.sim.batch.motion import Body, make_body, vec6
from aquanav_tools.sim.batch.original import DraggedBody, make_dragged_body
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.task import ProgressMeasure
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
FRICTION = 0.09
"""Bullet multiplies the two bodies' 0.3."""
CONTACT_MARGIN = 0.005
"""Bullet makes contacts between surfaces that overlap, or are within 0 to 7 mm of each other (measured), m."""


@wp.struct
class Craft:
    """A vehicle: one of two models of motion, its actuators, its hull."""

    is_original: wp.int32
    body: Body
    dragged: DraggedBody
    controls: Controls
    hull: Hull


def make_craft(scenario: Scenario, vehicle: Vehicle, device: Any) -> Craft:
    """Return a vehicle in a scenario's water."""
    craft, dt = Craft(), scenario.settings.limits.dt
    parameters = vehicle.motion_parameters(scenario.settings.water.density)
    craft.is_original = int(isinstance(vehicle, OriginalVehicle))
    if craft.is_original:
        craft.dragged = make_dragged_body(parameters, dt, device)
    else:
        craft.body = make_body(parameters, dt, device)
    craft.controls = make_controls(vehicle, dt)
    craft.hull = _make_hull(scenario, vehicle)
    return craft


def _make_hull(scenario: Scenario, vehicle: Vehicle) -> Hull:
    hull, capsule, mass = Hull(), vehicle.capsule, vehicle.total_mass
    hull.half_axis, hull.radius = 0.5 * capsule.axis_length, capsule.radius
    field_error = 0.5 * np.sqrt(3.0) * scenario.field.spacing
    hull.margin, hull.friction = CONTACT_MARGIN, FRICTION
    hull.reach = (
        capsule.radius + CONTACT_MARGIN + scenario.settings.collision_error + field_error + 0.25 * capsule.axis_length
    )
    hull.mass, hull.inertia, hull.masses = mass[:3].mean(), mass[3:].mean(), vec6(*mass)
    return hull


@wp.struct
class Starts:
    """Where episodes begin."""

    positions: wp.array(dtype=wp.vec3d)
    orientations: wp.array(dtype=wp.vec4d)
    extra: wp.array2d(dtype=f64)
    """(S, E) what the vehicle's model adds to the state."""
    gates: wp.array(dtype=wp.int32)
    remaining: wp.array(dtype=f64)


@wp.struct
class Beginnings:
    """All that episodes may begin with."""

    listed: Starts
    """The scenario's."""
    unlisted: Starts
    """(N,) one for each vehicle's next episode, where they are in no list."""


DRAWN, UNLISTED = wp.constant(-1), wp.constant(-2)
"""In place of a start's index: it is to be drawn from the list; it is the vehicle's own, in a list of its own."""


def make_starts(states: Array, scenario: Scenario, device: Any) -> Starts:
    """Return starts at (S, 13) states or more; the vehicle's model says what it adds."""
    starts, guide = Starts(), scenario.guide
    gates = [guide.locate(position, scenario.field) for position in states[:, :3]]
    remaining = [guide.remaining(position, gate) for position, gate in zip(states[:, :3], gates, strict=True)]
    starts.positions = wp.array(states[:, :3], dtype=wp.vec3d, device=device)
    starts.orientations = wp.array(states[:, 3:7], dtype=wp.vec4d, device=device)
    starts.extra = wp.array(np.pad(states[:, 13:], ((0, 0), (0, 1))), dtype=wp.float64, ndim=2, device=device)
    starts.gates = wp.array(gates, dtype=wp.int32, device=device)
    starts.remaining = wp.array(remaining, dtype=wp.float64, device=device)
    return starts


@dataclass(frozen=True)
class TaskNumbers:
    """The task's definition as the kernels take it; `envs` fills it from the definition that all backends share."""

    goal: Array
    """(3,) world, m."""
    tolerance: float
    """The goal is reached with this much or less to go, m."""
    max_decisions: int
    ends_on_collision: bool
    weights: tuple[float, float, float, float, float, float, float]
    """Of the reward's terms: progress, time, contact, proximity, goal, collision, timeout."""
    scales: tuple[float, float, float]
    """Of the observation: distance to the goal, m; speed, m/s; rate of turn, rad/s."""
    entrance_height: float
    """Height from which depth is measured, m."""
    size: int
    """Values of an observation: its first 31, or all 44."""
    progress: ProgressMeasure = "panels"
    """What the reward's progress is measured by."""
    sensor_noise: float = 0.0
    """Standard deviation of the error of each ray's distance, m."""
    sensor_dropout: float = 0.0
    """Probability that a ray gets no echo."""
    action_delay: int = 0
    """Decisions between choosing an action and its effect."""
    observation_delay: int = 0
    """Decisions by which observations are late."""


@wp.struct
class Rules:
    """`TaskNumbers` on the device, and time."""

    goal: wp.vec3d
    tolerance: f64
    max_decisions: wp.int32
    ends_on_collision: wp.int32
    weights: wp.array(dtype=f64)
    scales: wp.vec3d
    entrance_height: f64
    dt: f64
    substeps: wp.int32
    next_step: wp.int32
    """Whether an ended episode is followed by the next at the next step, not in the same one."""
    disturbance: Disturbance


def make_rules(task: TaskNumbers, scenario: Scenario, next_step: bool, device: Any) -> Rules:
    """Return the rules of a task in a scenario."""
    rules, limits = Rules(), scenario.settings.limits
    rules.goal, rules.tolerance, rules.max_decisions = wp.vec3d(*task.goal), task.tolerance, task.max_decisions
    rules.ends_on_collision, rules.next_step = int(task.ends_on_collision), int(next_step)
    rules.weights = wp.array(task.weights, dtype=wp.float64, device=device)
    rules.scales, rules.entrance_height = wp.vec3d(*task.scales), task.entrance_height
    rules.dt, rules.substeps = limits.dt, limits.substeps
    rules.disturbance.noise, rules.disturbance.dropout = task.sensor_noise, task.sensor_dropout
    rules.disturbance.action_delay, rules.disturbance.observation_delay = task.action_delay, task.observation_delay
    return rules


@wp.struct
class Fans:
    """A pattern of rays."""

    directions: wp.array(dtype=wp.vec3)
    """Body frame."""
    lengths: wp.array(dtype=wp.float32)
    """m."""
    exact: wp.int32
    """Whether rays go to the mesh; otherwise they are traced through the field."""


@wp.struct
class Fleet:
    """All vehicles: one row of each array per vehicle."""

    seeds: wp.array(dtype=wp.int32)
    """(N,) of the episodes: 32 bits each, from which all that is drawn follows."""
    order: wp.array(dtype=wp.int32)
    """(N,) vehicles in the order in which they are computed."""
    commands: wp.array2d(dtype=wp.float32)
    """(N, 3) ballast, steer and thrust."""
    acting: wp.array2d(dtype=wp.float32)
    """(N, 3) the command that takes effect: an earlier one where actions are delayed."""
    waiting_commands: wp.array2d(dtype=wp.float32)
    """(N, 3 D) commands of the last D decisions, without effect so far."""
    waiting_observations: wp.array2d(dtype=wp.float32)
    """(N, V D) observations of the last D decisions, not seen so far."""
    positions: wp.array(dtype=wp.vec3d)
    orientations: wp.array(dtype=wp.vec4d)
    velocities: wp.array(dtype=vec6)
    extra: wp.array2d(dtype=f64)
    """Thrusters' forces, or the height of the water's surface."""
    levels: wp.array(dtype=f64)
    currents: wp.array(dtype=wp.vec3d)
    """Of the water where the last decision began, m/s."""
    shares: wp.array(dtype=f64)
    """Of the water's velocity that this episode has."""
    phases: wp.array(dtype=f64)
    """Of the waves on the surface, rad."""
    eddies: wp.array2d(dtype=f64)
    """(N, C) coefficients of the gusts and eddies around each vehicle."""
    gates: wp.array(dtype=wp.int32)
    remaining: wp.array(dtype=f64)
    """Along the guide, m."""
    to_go: wp.array(dtype=f64)
    """By the measure that the reward goes by, m."""
    panels_crossed: wp.array(dtype=wp.int32)
    touched_panels: wp.array2d(dtype=wp.bool)
    """(N, P) of the original's measure of progress; else P is 0."""
    gained: wp.array(dtype=f64)
    """What that became shorter by in the last decision, m."""
    decisions: wp.array(dtype=wp.int32)
    ages: wp.array(dtype=wp.int32)
    """Decisions by which this episode's time runs out earlier."""
    episodes: wp.array(dtype=wp.int32)
    start_indices: wp.array(dtype=wp.int32)
    """In the scenario's list; -1 where the start is in none."""
    beginnings: wp.array(dtype=wp.vec3d)
    """Where the episodes began, m."""
    wanted_starts: wp.array(dtype=wp.int32)
    """Index of the next episode's start, or DRAWN or UNLISTED."""
    touched: wp.array(dtype=wp.int32)
    """Physics steps of the last decision in contact."""
    is_touching: wp.array(dtype=wp.int32)
    collisions: wp.array(dtype=wp.int32)
    """Contacts begun in this episode."""
    outcomes: wp.array(dtype=wp.int32)
    """0 running, 1 success, 2 collision, 3 timeout."""
    restarted: wp.array(dtype=wp.int32)
    """Whether this step began an episode."""
    rays: wp.array2d(dtype=wp.float32)
    """(N, 28) true distances, m."""
    clearances: wp.array(dtype=wp.float32)
    """Of the hull, m."""
    observations: wp.array2d(dtype=wp.float32)
    final_observations: wp.array2d(dtype=wp.float32)
    terms: wp.array2d(dtype=wp.float32)
    """(N, 7) of the reward."""
    rewards: wp.array(dtype=wp.float32)
    terminated: wp.array(dtype=wp.bool)
    truncated: wp.array(dtype=wp.bool)
    returns: wp.array(dtype=wp.float32)
    """Sum of rewards in this episode."""
    last_outcomes: wp.array(dtype=wp.int32)
    """The last step's outcome, which the beginning of the next episode leaves as it is; so the next three."""
    last_returns: wp.array(dtype=wp.float32)
    last_lengths: wp.array(dtype=wp.int32)
    last_collisions: wp.array(dtype=wp.int32)
