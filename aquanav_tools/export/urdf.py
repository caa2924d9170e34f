"""URDF: z up, metres, angles roll, pitch, yaw. The cave and the vehicle are a file each.

PyBullet collides a mesh as its convex hull unless it is said to be concave, by an attribute of its own, which other
readers pass over.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from aquanav_tools.export.numbers import pose6, rotation_to, row, save_xml
from aquanav_tools.export.scene import Craft, Scene
from aquanav_tools.types import Array

ALONG_X = np.array([np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0])
"""Quaternion that lays a cylinder's axis, z, along x."""
TINY = 1e-6
"""Mass of what only marks a place, kg: readers refuse zero, or take it for fixed to the world."""


def write_urdf(scene: Scene, folder: Path) -> tuple[str, ...]:
    """Write cave.urdf (load it fixed to the world) and vehicle.urdf."""
    cave = Element("robot", name=scene.name)
    rock = SubElement(cave, "link", name="cave")
    _geometry(rock, "visual", "meshes/cave.obj")
    _geometry(rock, "collision", "meshes/collision.obj").set("concave", "yes")
    save_xml(cave, folder / "cave.urdf")
    save_xml(_vehicle(scene.craft), folder / "vehicle.urdf")
    return ("cave.urdf", "vehicle.urdf")


def _geometry(link: Element, kind: str, path: str) -> Element:
    part = SubElement(link, kind)
    SubElement(SubElement(part, "geometry"), "mesh", filename=path)
    return part


def _vehicle(craft: Craft) -> Element:
    root = Element("robot", name=craft.name)
    base = SubElement(root, "link", name="base")
    _add_inertia(base, craft.mass, craft.inertia, craft.centre_of_mass)
    _geometry(base, "visual", "meshes/vehicle.obj")
    half, radius = 0.5 * craft.capsule.axis_length, row(craft.capsule.radius)
    if half > 0.0:  # URDF has no capsule
        middle = SubElement(base, "collision")
        _add_origin(middle, np.zeros(3), ALONG_X)
        SubElement(SubElement(middle, "geometry"), "cylinder", radius=radius, length=row(2.0 * half))
    for end in sorted({-half, half}):
        cap = SubElement(base, "collision")
        _add_origin(cap, np.array([end, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
        SubElement(SubElement(cap, "geometry"), "sphere", radius=radius)
    for n, (place, push) in enumerate(craft.thrusters):
        _add_marker(root, f"thruster-{n}", place, rotation_to(push))
    for n, direction in enumerate(craft.rays.directions):
        _add_marker(root, f"ray-{n}", np.zeros(3), rotation_to(direction))
    _add_marker(root, "lamp", craft.lamp, rotation_to(np.array([1.0, 0.0, 0.0])))
    return root


def _add_marker(root: Element, name: str, place: Array, turn: Array) -> None:
    """Add a link whose z points along a thruster, a ray or the lamp."""
    _add_inertia(SubElement(root, "link", name=name), TINY, np.full(3, TINY), np.zeros(3))
    joint = SubElement(root, "joint", name=f"{name}-joint", type="fixed")
    SubElement(joint, "parent", link="base")
    SubElement(joint, "child", link=name)
    _add_origin(joint, place, turn)


def _add_inertia(link: Element, mass: float, inertia: Array, centre: Array) -> None:
    inertial = SubElement(link, "inertial")
    _add_origin(inertial, centre, np.array([1.0, 0.0, 0.0, 0.0]))
    SubElement(inertial, "mass", value=row(mass))
    moments = {name: row(value) for name, value in zip(("ixx", "iyy", "izz"), inertia, strict=True)}
    SubElement(inertial, "inertia", moments, ixy="0", ixz="0", iyz="0")


def _add_origin(parent: Element, place: Array, turn: Array) -> None:
    words = pose6(place, turn).split()
    SubElement(parent, "origin", xyz=" ".join(words[:3]), rpy=" ".join(words[3:]))
