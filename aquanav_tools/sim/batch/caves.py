"""Caves on the device. All worlds of a process share what they hold of the same cave in the same place."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.bvh import Bvh, make_bvh
from aquanav_tools.sim.batch.field import Grid, make_grid
from aquanav_tools.sim.batch.progress import Measure, make_measure
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.spheres import Ends, make_ends
from aquanav_tools.sim.batch.wall_rays import Wall, make_wall
from aquanav_tools.sim.batch.water import Water, make_water
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.sim.water import WaterParts
from aquanav_tools.task import ProgressMeasure
from aquanav_tools.types import Array, IntArray, Mesh

wp.set_module_options(OPTIONS)

f64 = wp.float64


@wp.struct
class Starts:
    """Where episodes begin."""

    positions: wp.array(dtype=wp.vec3d)
    orientations: wp.array(dtype=wp.vec4d)
    extra: wp.array2d(dtype=f64)
    """(S, E) what the vehicle's model adds to the state."""
    gates: wp.array(dtype=wp.int32)


@dataclass(frozen=True)
class CaveTask:
    """The task in one cave: `envs` fills it from the definition that all backends share."""

    goal: Array
    """(3,) world, m."""
    tolerance: float
    """The goal is reached with this much or less to go, m."""
    max_decisions: int
    ends_on_collision: bool
    weights: tuple[float, float, float, float, float, float, float]
    """Of the reward's terms: progress, time, contact, proximity, goal, collision, timeout."""
    entrance: Array
    """(3,) first panel's centre, from whose height depth is measured, m."""
    water: WaterParts
    """Its currents and waves; each vehicle has gusts and eddies of its own."""
    progress: ProgressMeasure = "panels"
    """What the reward's progress is measured by."""
    start_numbers: IntArray | None = None
    """Of the scenario's listed starts those that episodes draw from; all when not given."""


@wp.struct
class Rules:
    """A `CaveTask` on the device, and time."""

    goal: wp.vec3d
    tolerance: f64
    max_decisions: wp.int32
    ends_on_collision: wp.int32
    weights: wp.array(dtype=f64)
    entrance_height: f64
    dt: f64
    substeps: wp.int32


@wp.struct
class Cave:
    """A cave, its water and the task in it."""

    grid: Grid
    """Clearance."""
    wall: Bvh
    """What hulls meet."""
    ray_wall: Wall
    """What exact rays meet; without cells where they are traced through the grid."""
    middle: wp.vec3d
    """Where the meshes' origin is in the world."""
    ends: Ends
    water: Water
    measure: Measure
    starts: Starts
    """The scenario's."""
    start_numbers: wp.array(dtype=wp.int32)
    """Those of them that episodes draw from."""
    rules: Rules


def make_cave(scenario: Scenario, vehicle: Vehicle, task: CaveTask, *, has_exact_rays: bool, device: Any) -> Cave:
    """Return a scenario on a device, for a vehicle's hull and starts.

    Raises:
        MeshError: progress is "geodesic", and there is no way to the goal for the vehicle.
    """
    cave, limits = Cave(), scenario.settings.limits
    middle = scenario.cavity.mesh.vertices.mean(axis=0)
    cave.grid, cave.middle = (
        shared(scenario.field, device, lambda: make_grid(scenario.field, device)),
        wp.vec3d(*middle),
    )
    cave.wall = shared_bvh(scenario.collision, middle, device)
    if has_exact_rays:
        cave.ray_wall = shared_wall(scenario.cavity.mesh, scenario.field, middle, device)
    cave.ends = make_ends(scenario.cavity, task.entrance, task.goal, device)
    cave.water = make_water(task.water, scenario.field, cave.grid, limits.dt * limits.substeps, device)
    cave.measure = make_measure(task.progress, scenario, vehicle.capsule, device)
    states = np.array([vehicle.state_at(start.pose) for start in scenario.starts])
    gates = shared(scenario, "gates", lambda: _listed_gates(scenario))
    cave.starts = make_starts(states, gates, device)
    numbers = np.arange(len(states)) if task.start_numbers is None else task.start_numbers
    cave.start_numbers = wp.array(numbers, dtype=wp.int32, device=device)
    rules = cave.rules
    rules.goal, rules.tolerance, rules.max_decisions = wp.vec3d(*task.goal), task.tolerance, task.max_decisions
    rules.ends_on_collision = int(task.ends_on_collision)
    rules.weights = wp.array(task.weights, dtype=wp.float64, device=device)
    rules.entrance_height, rules.dt, rules.substeps = task.entrance[2], limits.dt, limits.substeps
    return cave


def make_starts(states: Array, gates: list[int], device: Any) -> Starts:
    """Return starts at (S, 13) states or more, in (S,) gates; the vehicle's model says what it adds."""
    starts = Starts()
    starts.positions = wp.array(states[:, :3], dtype=wp.vec3d, device=device)
    starts.orientations = wp.array(states[:, 3:7], dtype=wp.vec4d, device=device)
    starts.extra = wp.array(np.pad(states[:, 13:], ((0, 0), (0, 1))), dtype=wp.float64, ndim=2, device=device)
    starts.gates = wp.array(gates, dtype=wp.int32, device=device)
    return starts


def gates_at(scenario: Scenario, positions: Array) -> list[int]:
    """Return the gates of (S, 3) positions that were not tracked before."""
    return [scenario.guide.locate(position, scenario.field) for position in positions]


def _listed_gates(scenario: Scenario) -> list[int]:
    return gates_at(scenario, np.array([start.pose.position for start in scenario.starts]))


_shared: weakref.WeakKeyDictionary[Any, dict[Any, Any]] = weakref.WeakKeyDictionary()


def shared(source: Any, key: Any, make: Callable[[], Any]) -> Any:
    """Return what `make` made of a source under a key, made where there is none yet; it lives as long as the source."""
    made = _shared.setdefault(source, {})
    if str(key) not in made:
        made[str(key)] = make()
    return made[str(key)]


def shared_bvh(mesh: Mesh, middle: Array, device: Any) -> Bvh:
    """Return a mesh on a device as hulls meet it, moved so that `middle` is at the origin."""
    bvh: Bvh = shared(mesh, (device, middle.tolist()), lambda: make_bvh(mesh, middle, device))
    return bvh


def shared_wall(mesh: Mesh, field: DistanceField, middle: Array, device: Any) -> Wall:
    """Return a mesh as exact rays meet it, moved so that `middle` is at the origin, in the cells of its field."""
    # Beside the wall the mesh is kept, so that no other one gets its id.
    key = (id(mesh), device, middle.tolist())
    wall: Wall = shared(field, key, lambda: (make_wall(mesh, field, middle, device), mesh))[0]
    return wall
