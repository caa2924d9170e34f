"""SDF 1.9 for Gazebo: z up, metres, poses x y z roll pitch yaw."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from aquanav_tools.export.numbers import pose6, rotation_to, row, save_xml
from aquanav_tools.export.scene import Craft, Scene
from aquanav_tools.export.urdf import ALONG_X
from aquanav_tools.types import Array

LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def write_sdf(scene: Scene, folder: Path) -> tuple[str, ...]:
    """Write world.sdf: the cave, the vehicle at the first start, and a frame for every place."""
    root = Element("sdf", version="1.9")
    world = SubElement(root, "world", name="aquanav")
    for n, point in enumerate(scene.guide.centreline):
        _add_frame(world, f"route-{n}", point, LEVEL)
    for n, panel in enumerate(scene.guide.panels):
        _add_frame(world, f"panel-{n}", panel.centre, rotation_to(panel.normal))
    for portal in scene.portals:
        _add_frame(world, f"portal-{portal.label}", portal.centre, rotation_to(portal.normal))
    for n, start in enumerate(scene.starts):
        _add_frame(world, f"start-{n}", start.position, start.orientation)
    _add_frame(world, "goal", scene.goal, LEVEL)
    cave = SubElement(world, "model", name="cave")
    SubElement(cave, "static").text = "true"
    rock = SubElement(cave, "link", name="rock")
    _add_mesh(rock, "visual", "meshes/cave.obj")
    _add_mesh(rock, "collision", "meshes/collision.obj").set("concave", "yes")  # PyBullet's word; others pass over it
    _add_vehicle(world, scene)
    save_xml(root, folder / "world.sdf")
    return ("world.sdf",)


def _add_frame(parent: Element, name: str, place: Array, turn: Array) -> None:
    SubElement(SubElement(parent, "frame", name=name), "pose").text = pose6(place, turn)


def _add_mesh(link: Element, kind: str, path: str) -> Element:
    part = SubElement(link, kind, name=kind)
    mesh = SubElement(SubElement(part, "geometry"), "mesh")
    SubElement(mesh, "uri").text = path
    return part


def _add_vehicle(world: Element, scene: Scene) -> None:
    craft, start = scene.craft, scene.starts[0]
    model = SubElement(world, "model", name="vehicle")
    SubElement(model, "pose").text = pose6(start.position, start.orientation)
    base = SubElement(model, "link", name="base")
    SubElement(base, "gravity").text = "false"  # it is trimmed to float
    inertial = SubElement(base, "inertial")
    SubElement(inertial, "pose").text = pose6(craft.centre_of_mass, LEVEL)
    SubElement(inertial, "mass").text = row(craft.mass)
    moments = SubElement(inertial, "inertia")
    values = {"ixx": craft.inertia[0], "ixy": 0.0, "ixz": 0.0, "iyy": craft.inertia[1], "iyz": 0.0}
    for name, value in (values | {"izz": craft.inertia[2]}).items():
        SubElement(moments, name).text = row(value)
    _add_mesh(base, "visual", "meshes/vehicle.obj")
    _add_hull(base, craft)
    lamp = SubElement(base, "light", name="lamp", type="spot")
    SubElement(lamp, "pose").text = row([*craft.lamp, 0.0, -0.5 * np.pi, 0.0])  # its direction, -z, lies along x
    SubElement(lamp, "direction").text = "0 0 -1"
    spot = SubElement(lamp, "spot")
    for name, value in (("inner_angle", 0.6), ("outer_angle", 1.2), ("falloff", 1.0)):
        SubElement(spot, name).text = row(value)
    for n, (place, push) in enumerate(craft.thrusters):
        _add_frame(model, f"thruster-{n}", place, rotation_to(push))
    for n, direction in enumerate(craft.rays.directions):
        _add_frame(model, f"ray-{n}", np.zeros(3), rotation_to(direction))


def _add_hull(base: Element, craft: Craft) -> None:
    hull = SubElement(base, "collision", name="hull")
    SubElement(hull, "pose").text = pose6(np.zeros(3), ALONG_X)
    shape = SubElement(SubElement(hull, "geometry"), "capsule")
    SubElement(shape, "radius").text = row(craft.capsule.radius)
    SubElement(shape, "length").text = row(craft.capsule.axis_length)
