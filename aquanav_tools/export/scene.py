"""What every format writes: one plain record of a scenario, its vehicle and its water. World frame, SI units."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.cavity import Portal
from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.export.current import CurrentGrid, sample_current
from aquanav_tools.export.looks import looks_of
from aquanav_tools.photograph.options import Lamp
from aquanav_tools.scenario.schema import Scenario, WaterSettings
from aquanav_tools.sim.appearance import vehicle_mesh
from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.sensors import RayPattern, boat_pattern, original_pattern
from aquanav_tools.sim.vehicle import load_vehicle, parse_vehicle
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Array, Capsule, Mesh, Pose


@dataclass(frozen=True, eq=False)
class Craft:
    """The vehicle. Body frame: x ahead, y left, z up."""

    name: str
    mass: float
    """kg, without added mass."""
    inertia: Array
    """(3,) about body x, y, z through the centre of mass, kg m^2."""
    centre_of_mass: Array
    """(3,) m."""
    capsule: Capsule
    """What it touches as, along x."""
    look: Mesh
    """How it is drawn, with colours."""
    rays: RayPattern
    lamp: Array
    """(3,) place of the lamp, which shines ahead, m."""
    thrusters: tuple[tuple[Array, Array], ...] = ()
    """(3,) place, m, and (3,) unit vector of the push forward, of each; none where forces act at once."""
    max_forward: float = 0.0
    """Most force of a thruster, N."""
    max_reverse: float = 0.0
    """Most force of a thruster in reverse, N."""
    hydrodynamics: FossenVehicle | None = None
    """Its volume, added mass and damping; None for a vehicle of the original, which has none of these."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A cave with all that a simulator may want to know of it."""

    name: str
    levels: tuple[Mesh, ...]
    """Levels of detail, the finest first, with colours; faces look into the water, where they are seen from."""
    collision: Mesh
    """Closed, lids of portals included; faces look into the water."""
    collision_error: float
    """Bound on the distance between the collision mesh and the cavity, m."""
    portals: tuple[Portal, ...]
    starts: tuple[Pose, ...]
    guide: Guide
    goal: Array
    """(3,) m."""
    goal_tolerance: float
    """m."""
    water: WaterSettings
    current: CurrentGrid | None
    """None where the water stands still and no way of it through the cave is known."""
    craft: Craft
    notes: tuple[str, ...]
    """Sentences on what the scenario lacks."""


def scene_of(scenario: Scenario) -> Scene:
    """Return the record of a scenario.

    Raises:
        InputError: the pictured cave beside the scenario is damaged or of another cave.
    """
    levels, has_colours = looks_of(scenario)
    current = sample_current(scenario)
    settings = scenario.settings
    notes = [] if has_colours else ["The scenario has no colours of a scan: its wall has the one colour of rock."]
    if not scenario.cavity.portals:
        notes.append("The scenario has no portals: its cave is closed all around, and none are written.")
    if current is None:
        notes.append("The scenario has no current: no grid of it is written.")
    return Scene(
        name=settings.name,
        levels=levels,
        collision=inside_out(scenario.collision),
        collision_error=settings.collision_error,
        portals=scenario.cavity.portals,
        starts=tuple(start.pose for start in scenario.starts),
        guide=scenario.guide,
        goal=np.array(settings.goal.position),
        goal_tolerance=settings.goal.tolerance,
        water=settings.water,
        current=current,
        craft=craft_of(_vehicle_of(scenario)),
        notes=tuple(notes),
    )


def craft_of(vehicle: Vehicle) -> Craft:
    """Return the record of a vehicle.

    Raises:
        TypeError: it is of another model than those of `sim.vehicle.MODELS`.
    """
    if not isinstance(vehicle, FossenVehicle | OriginalVehicle):
        raise TypeError(f"{vehicle.name} is a {type(vehicle).__name__}, which has no body that is known here.")
    thrusters = vehicle.thrusters if isinstance(vehicle, FossenVehicle) else None
    lamp = Lamp()
    is_boat = isinstance(vehicle, OriginalVehicle) and vehicle.ballast is None
    return Craft(
        name=vehicle.name,
        mass=vehicle.body.mass,
        inertia=np.array(vehicle.body.inertia),
        centre_of_mass=np.array(vehicle.body.centre_of_mass),
        capsule=vehicle.capsule,
        look=vehicle_mesh(vehicle),
        rays=boat_pattern() if is_boat else original_pattern(),
        lamp=np.array([0.5 * vehicle.capsule.length, -lamp.right, lamp.up]),
        thrusters=()
        if thrusters is None
        else tuple(
            (np.array(place), np.array(push) / np.linalg.norm(push))
            for place, push in zip(thrusters.positions, thrusters.directions, strict=True)
        ),
        max_forward=0.0 if thrusters is None else thrusters.max_forward,
        max_reverse=0.0 if thrusters is None else thrusters.max_reverse,
        hydrodynamics=vehicle if isinstance(vehicle, FossenVehicle) else None,
    )


def inside_out(mesh: Mesh) -> Mesh:
    """Return a mesh whose faces look the other way."""
    return Mesh(mesh.vertices, np.ascontiguousarray(mesh.faces[:, ::-1]), mesh.colours)


def _vehicle_of(scenario: Scenario) -> Vehicle:
    if scenario.vehicle_toml:
        return parse_vehicle(scenario.vehicle_toml, f"vehicle of the scenario {scenario.name}")
    return load_vehicle(scenario.settings.vehicle)
