"""Which vehicle dives a cave: the one it was built for, or another one whose hull fits."""

from __future__ import annotations

import weakref
from dataclasses import replace
from pathlib import Path

import gymnasium
import numpy as np

from aquanav_tools.cave.route.capsule_checker import CapsuleChecker
from aquanav_tools.cave.route.passability import measure_passability
from aquanav_tools.cave.route.starts import Start
from aquanav_tools.errors import InputError, MeshError, ScenarioError
from aquanav_tools.geometry.volume.geodesic import MAX_NODES, WaterGraph
from aquanav_tools.provenance import file_hash
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import OtherVehicle, Scenario
from aquanav_tools.sim.vehicle import load_vehicle, parse_vehicle, vehicle_path
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.text_files import read_text
from aquanav_tools.types import Array

_adapted: weakref.WeakKeyDictionary[Scenario, dict[object, Scenario]] = weakref.WeakKeyDictionary()
"""Scenarios for other vehicles, by the one they come from: environments of one cave share it."""


def prepared(scenario: str | Path | Scenario, vehicle: str | Path | Vehicle | None) -> tuple[Scenario, Vehicle]:
    """Return a scenario and the vehicle that dives it; starts that it does not fit at are left out with a warning.

    Raises:
        ScenarioError: the scenario cannot be read, or has no start.
        InputError: there is no such vehicle, or its hull does not fit, as in `with_room_for`.
    """
    cave = scenario if isinstance(scenario, Scenario) else read_scenario(scenario)
    if not cave.starts:
        raise ScenarioError(f"The scenario {cave.name} has no starts. Build it again.")
    craft = vehicle_of(cave, vehicle)
    roomy = with_room_for(cave, craft)
    if roomy is not cave:
        gymnasium.logger.warn(left_out_sentence(roomy, craft.name, len(cave.starts) - len(roomy.starts)))
    return roomy, craft


def vehicle_of(scenario: Scenario, vehicle: str | Path | Vehicle | None = None) -> Vehicle:
    """Return a vehicle by name or path of a TOML file; without one the scenario's."""
    if isinstance(vehicle, Vehicle):
        return vehicle
    if vehicle is None and scenario.vehicle_toml:
        return parse_vehicle(scenario.vehicle_toml, f"vehicle of the scenario {scenario.name}")
    return load_vehicle(scenario.settings.vehicle if vehicle is None else vehicle)


def dived_by(scenario: Scenario, vehicle: str | Path | None) -> Scenario:
    """Return a scenario with a vehicle by name or path in place of its own; itself where that is the same, or None.

    Raises:
        InputError: there is no such vehicle, or its hull does not fit, as in `with_room_for`.
    """
    if vehicle is None:
        return scenario
    path = vehicle_path(vehicle)
    craft = load_vehicle(path)
    if craft == vehicle_of(scenario):
        return scenario
    text = read_text(path)
    known = _adapted.setdefault(scenario, {})
    if text not in known:
        roomy = with_room_for(scenario, craft)
        known[text] = replace(
            roomy,
            settings=replace(scenario.settings, vehicle=craft.name),
            vehicle_toml=text,
            other_vehicle=OtherVehicle(craft.name, str(vehicle), file_hash(path), _left_out(scenario, roomy)),
        )
    return known[text]


def with_room_for(scenario: Scenario, vehicle: Vehicle) -> Scenario:
    """Return a scenario with those of its starts from which a vehicle can reach the goal; itself where these are all.

    A build has checked this for the scenario's own vehicle, and so for every hull that is no longer and no wider. A
    bend that is too short for a long hull is not seen.

    Raises:
        InputError: no start is left; the message says how wide the way is.
    """
    own, hull = vehicle_of(scenario).capsule, vehicle.capsule
    if hull.radius <= own.radius and hull.length <= own.length:
        return scenario
    known = _adapted.setdefault(scenario, {})
    if hull not in known:
        starts = _usable_starts(scenario, vehicle)
        known[hull] = scenario if len(starts) == len(scenario.starts) else replace(scenario, starts=starts)
    return known[hull]


def left_out_sentence(scenario: Scenario, vehicle: str, num_left_out: int) -> str:
    """Return what is said where a vehicle cannot begin at some of a scenario's starts."""
    return (
        f"{num_left_out} of the {len(scenario.starts) + num_left_out} starts of {scenario.name} are left out: the hull "
        f"of {vehicle} would touch the wall there, or does not fit through on the way to the goal. The others are "
        "numbered anew, from 0."
    )


def _left_out(scenario: Scenario, roomy: Scenario) -> tuple[int, ...]:
    """Return the numbers of the starts that only the first of two scenarios has."""
    kept = {id(start.pose) for start in roomy.starts}
    return tuple(number for number, start in enumerate(scenario.starts) if id(start.pose) not in kept)


def _usable_starts(scenario: Scenario, vehicle: Vehicle) -> tuple[Start, ...]:
    """Return the starts whose pose is free for a vehicle's hull and joined to the goal, with their way for it."""
    positions = np.array([start.pose.position for start in scenario.starts])
    lengths = ways_to_goal(scenario, vehicle.capsule.radius, positions)
    if not np.isfinite(lengths).any():
        raise InputError(_too_tight(scenario, vehicle))
    checker = CapsuleChecker(scenario.cavity, scenario.field, vehicle.capsule)
    usable = tuple(
        replace(start, geodesic_to_goal=float(length))
        for start, length in zip(scenario.starts, lengths, strict=True)
        if np.isfinite(length) and checker.distance(start.pose) > 0.0
    )
    if not usable:
        raise InputError(
            f"{_size(vehicle)} cannot begin in {scenario.name}: at each of its {len(positions)} starts, which keep off "
            f"the wall for {vehicle_of(scenario).name}, its hull would touch the wall. Choose a smaller vehicle, or "
            "build the scenario for this one: aquanav-build-cave --vehicle."
        )
    return usable


def ways_to_goal(scenario: Scenario, radius: float, positions: Array, max_nodes: int = MAX_NODES) -> Array:
    """Return the (N,) lengths of the ways from (N, 3) positions to the goal for a ball, m; inf where there is none.

    They are sought on as many samples of the water as a build seeks its route on, unless another number is given.
    """
    goal = scenario.guide.centres[-1]
    try:
        graph = WaterGraph(scenario.field, radius, max_nodes)
    except MeshError:
        return np.full(len(positions), np.inf)
    gap = float(np.linalg.norm(graph.points[graph.nearest_open(goal)] - goal))
    if gap > scenario.guide.radii[-1] + scenario.settings.goal.tolerance:
        return np.full(len(positions), np.inf)
    return graph.ways_from(goal).lengths_to(positions)


def _too_tight(scenario: Scenario, vehicle: Vehicle) -> str:
    line, width = scenario.guide.centreline, 2.0 * vehicle.capsule.radius
    narrowest = measure_passability(scenario.cavity, scenario.field, line, width).narrowest
    return (
        f"{_size(vehicle)} finds no way to the goal of {scenario.name}, which was built for "
        f"{vehicle_of(scenario).name}: the passage is {narrowest.width:.2f} m wide where it is narrowest, "
        f"{narrowest.arc_length:.1f} m from the entrance. Choose a smaller vehicle, or a wider cave."
    )


def _size(vehicle: Vehicle) -> str:
    hull = vehicle.capsule
    return f"The vehicle {vehicle.name} ({hull.length:.2f} m long, {2.0 * hull.radius:.2f} m wide)"
