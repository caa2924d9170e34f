"""A scenario of Stonefish: z down, metres, angles roll, pitch, yaw; our (x, y, z) is its (x, -y, -z).

Stonefish computes mass and drag from meshes and materials, and takes mass, inertia and centre of mass where they are
given. Source: its documentation's chapters on environment, materials, dynamic bodies, robots and actuators (1.3).
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from aquanav_tools.export.meshes import PALETTE, write_obj
from aquanav_tools.export.numbers import pose6, row, save_xml
from aquanav_tools.export.scene import Craft, Scene
from aquanav_tools.types import Array, Mesh

DOWN = np.array([1.0, -1.0, -1.0])
"""Half a turn about x: between z up and z down, in the world as in the body."""
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
FRICTION = 0.09
"""Of rock and hull, as everywhere here."""


def write_stonefish(scene: Scene, folder: Path) -> tuple[str, ...]:
    """Write scenario.scn and its meshes with z down; the folder is the data path that Stonefish is given."""
    for name, mesh in (("cave", scene.levels[0]), ("collision", scene.collision), ("vehicle", scene.craft.look)):
        write_obj(turned_down(mesh), folder / "meshes" / f"{name}-ned.obj")
    root = Element("scenario")
    _add_environment(root, scene)
    _add_materials(root)
    _add_cave(root)
    _add_vehicle(root, scene)
    save_xml(root, folder / "scenario.scn")
    return ("scenario.scn",)


def turned_down(mesh: Mesh) -> Mesh:
    """Return a mesh with z down."""
    return Mesh(mesh.vertices * DOWN, mesh.faces, mesh.colours)


def _add_environment(root: Element, scene: Scene) -> None:
    place = SubElement(root, "environment")
    SubElement(place, "ned", latitude="0.0", longitude="0.0")
    ocean = SubElement(place, "ocean")
    SubElement(ocean, "water", density=row(scene.water.density), jerlov="0.2")
    SubElement(ocean, "waves", height="0.0")
    if isinstance(scene.water.current, tuple):  # else the water goes its way through the cave, which is not uniform
        current = SubElement(ocean, "current", type="uniform")
        SubElement(current, "velocity", xyz=row(_down(np.array(scene.water.current))))
    SubElement(SubElement(place, "atmosphere"), "sun", azimuth="0.0", elevation="-90.0")  # it is dark


def _add_materials(root: Element) -> None:
    materials = SubElement(root, "materials")
    for name, density in (("rock", 2700.0), ("hull", 1000.0)):
        SubElement(materials, "material", name=name, density=row(density), restitution="0.0")
    table = SubElement(materials, "friction_table")
    for first, second in (("rock", "rock"), ("rock", "hull"), ("hull", "hull")):
        SubElement(table, "friction", material1=first, material2=second, static=row(FRICTION), dynamic=row(FRICTION))
    looks = SubElement(root, "looks")
    SubElement(looks, "look", name="coloured", gray="1.0", roughness="0.9", texture=f"meshes/{PALETTE}")


def _add_cave(root: Element) -> None:
    cave = SubElement(root, "static", name="cave", type="model")
    for kind, name in (("physical", "collision"), ("visual", "cave")):
        part = SubElement(cave, kind)
        SubElement(part, "mesh", filename=f"meshes/{name}-ned.obj", scale="1.0")
        _add_pose(part, "origin", np.zeros(3), LEVEL)
    _add_surface(cave, "rock")
    _add_pose(cave, "world_transform", np.zeros(3), LEVEL)


def _add_vehicle(root: Element, scene: Scene) -> None:
    craft, start = scene.craft, scene.starts[0]
    robot = SubElement(root, "robot", name="vehicle", fixed="false", self_collisions="false")
    base = SubElement(robot, "base_link", name="base", type="model", physics="submerged", buoyant="true")
    mesh = SubElement(base, "physical")
    SubElement(mesh, "mesh", filename="meshes/vehicle-ned.obj", scale="1.0")
    _add_pose(mesh, "origin", np.zeros(3), LEVEL)
    _add_surface(base, "hull")
    SubElement(base, "mass", value=row(craft.mass))
    SubElement(base, "inertia", xyz=row(craft.inertia))
    _add_pose(base, "cg", _down(craft.centre_of_mass), LEVEL)
    _add_thrusters(robot, craft)
    lamp = SubElement(robot, "light", name="lamp")
    SubElement(lamp, "specs", radius="0.05", illuminance="5000.0")
    SubElement(lamp, "color", temperature="5600.0")
    _add_pose(lamp, "origin", _down(craft.lamp), LEVEL)
    SubElement(lamp, "link", name="base")
    turn = start.orientation * np.array([1.0, *DOWN])  # seen from a frame that is turned likewise
    _add_pose(robot, "world_transform", _down(start.position), turn)


def _add_thrusters(robot: Element, craft: Craft) -> None:
    """Add each as a push along its x, between its limits."""
    for n, (place, push) in enumerate(craft.thrusters):
        actuator = SubElement(robot, "actuator", name=f"thruster-{n}", type="push")
        limits = {"lower_limit": row(-craft.max_reverse), "upper_limit": row(craft.max_forward)}
        SubElement(actuator, "specs", limits, inverted="false")
        _add_pose(actuator, "origin", _down(place), rotation_along_x(_down(push)))
        SubElement(actuator, "link", name="base")


def rotation_along_x(direction: Array) -> Array:
    """Return the (4,) quaternion of a turn that takes x to a (3,) unit vector."""
    x, y, z = direction
    if x < -1.0 + 1e-12:
        return np.array([0.0, 0.0, 0.0, 1.0])  # half a turn about z; every axis across would do
    turn = np.array([1.0 + x, 0.0, -z, y])
    unit: Array = turn / np.linalg.norm(turn)
    return unit


def _add_surface(body: Element, material: str) -> None:
    SubElement(body, "material", name=material)
    SubElement(body, "look", name="coloured")


def _add_pose(parent: Element, name: str, place: Array, turn: Array) -> None:
    words = pose6(place, turn).split()
    SubElement(parent, name, xyz=" ".join(words[:3]), rpy=" ".join(words[3:]))


def _down(vector: Array) -> Array:
    return np.asarray(vector * DOWN + 0.0, dtype=np.float64)
