"""MJCF for MuJoCo: z up, metres, quaternions (w, x, y, z).

MuJoCo collides meshes as their convex hulls, which would fill a cave with rock. Its rays meet the triangles themselves.
So the cave is there twice: as a mesh that is seen and that rays meet, and as a rigid flex of the same triangles, whose
contacts are triangle by triangle.
"""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import numpy as np

from aquanav_tools.export.meshes import PALETTE
from aquanav_tools.export.numbers import rotation_to, row, save_xml
from aquanav_tools.export.scene import Craft, Scene
from aquanav_tools.sim.water_properties import water_viscosity
from aquanav_tools.types import Array

SEEN, TOUCHED, DRAWN = "1", "3", "2"
"""Groups of geoms: level 0 of the cave; what the vehicle touches as (hidden by default); what is only drawn."""
WALL_RADIUS = 0.001
"""Of the flex, m: MuJoCo wants its triangles to have a thickness."""


def write_mjcf(scene: Scene, folder: Path) -> tuple[str, ...]:
    """Write scene.xml, with the vehicle at the first start and each start as a keyframe."""
    root = Element("mujoco", model=scene.name)
    SubElement(root, "compiler", angle="radian", meshdir="meshes", texturedir="meshes")
    water = scene.water
    thickness = water_viscosity(water.temperature, water.salinity)
    SubElement(root, "option", timestep="0.005", density=row(water.density), viscosity=row(thickness))
    extent = float(np.ptp(scene.collision.vertices, axis=0).max())
    SubElement(root, "statistic", extent=row(extent), center=row(scene.collision.vertices.mean(axis=0)))
    SubElement(SubElement(root, "visual"), "map", znear=row(0.02 / extent), zfar="2")
    asset = SubElement(root, "asset")
    SubElement(asset, "texture", name="palette", type="2d", file=PALETTE)
    SubElement(asset, "material", name="palette", texture="palette")
    SubElement(asset, "mesh", name="cave", file="cave.obj", inertia="shell")
    SubElement(asset, "mesh", name="collision", file="collision.obj", inertia="shell")
    SubElement(asset, "mesh", name="vehicle", file="vehicle.obj", inertia="shell")
    world = SubElement(root, "worldbody")
    ghost = {"contype": "0", "conaffinity": "0", "type": "mesh"}
    SubElement(world, "geom", ghost, name="cave", mesh="cave", material="palette", group=SEEN)
    SubElement(world, "geom", ghost, name="wall", mesh="collision", group=TOUCHED)
    _add_sites(world, scene)
    _add_vehicle(world, scene)
    _add_flex(root, scene)
    _add_instruments(root, scene.craft)
    keys = SubElement(root, "keyframe")
    for n, start in enumerate(scene.starts):
        SubElement(keys, "key", name=f"start-{n}", qpos=f"{row(start.position)} {row(start.orientation)}")
    save_xml(root, folder / "scene.xml")
    return ("scene.xml",)


def _add_sites(world: Element, scene: Scene) -> None:
    for n, point in enumerate(scene.guide.centreline):
        SubElement(world, "site", name=f"route-{n}", pos=row(point), size="0.02", rgba="1 0.7 0 1", group="4")
    for n, panel in enumerate(scene.guide.panels):
        turn = row(rotation_to(panel.normal))
        SubElement(world, "site", name=f"panel-{n}", pos=row(panel.centre), quat=turn, size="0.05", group="4")
    for portal in scene.portals:
        turn = row(rotation_to(portal.normal))
        name = f"portal-{portal.label}"
        SubElement(world, "site", name=name, pos=row(portal.centre), quat=turn, size="0.1", rgba="1 0.3 0 1", group="4")
    size = row(max(scene.goal_tolerance, 0.01))
    SubElement(world, "site", name="goal", pos=row(scene.goal), size=size, rgba="0 1 0 0.3", group="4")


def _add_vehicle(world: Element, scene: Scene) -> None:
    craft, start = scene.craft, scene.starts[0]
    place = {"pos": row(start.position), "quat": row(start.orientation)}
    # In aquanav weights trim a vehicle until it floats; MuJoCo's water has drag, but no lift.
    body = SubElement(world, "body", place, name="vehicle", gravcomp="1")
    SubElement(body, "freejoint", name="vehicle")
    SubElement(body, "inertial", pos=row(craft.centre_of_mass), mass=row(craft.mass), diaginertia=row(craft.inertia))
    half = max(0.5 * craft.capsule.axis_length, 1e-4)  # a capsule of no length is refused
    ends = f"{row([-half, 0.0, 0.0])} {row([half, 0.0, 0.0])}"
    SubElement(body, "geom", name="hull", type="capsule", size=row(craft.capsule.radius), fromto=ends, group=TOUCHED)
    ghost = {"contype": "0", "conaffinity": "0", "type": "mesh"}
    SubElement(body, "geom", ghost, name="vehicle", mesh="vehicle", material="palette", group=DRAWN)
    SubElement(body, "light", name="lamp", pos=row(craft.lamp), dir="1 0 0", diffuse="1 1 1")
    for n, (position, push) in enumerate(craft.thrusters):
        SubElement(body, "site", name=f"thruster-{n}", pos=row(position), quat=row(rotation_to(push)), size="0.02")
    for n, direction in enumerate(craft.rays.directions):
        SubElement(body, "site", name=f"ray-{n}", quat=row(rotation_to(direction)), size="0.005")


def _add_flex(root: Element, scene: Scene) -> None:
    wall = scene.collision
    flex = SubElement(
        SubElement(root, "deformable"),
        "flex",
        name="wall",
        dim="2",
        body="world",
        radius=row(WALL_RADIUS),
        group=TOUCHED,
        vertex=row(wall.vertices.ravel()),
        element=" ".join(map(str, wall.faces.ravel())),
    )
    SubElement(flex, "contact", selfcollide="none")


def _add_instruments(root: Element, craft: Craft) -> None:
    """Add a motor to each thruster, along its site's z, and a range finder to each ray."""
    actuators, sensors = SubElement(root, "actuator"), SubElement(root, "sensor")
    limits = row([-craft.max_reverse, craft.max_forward])
    for n in range(len(craft.thrusters)):
        gear: Array = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])
        name = f"thruster-{n}"
        SubElement(actuators, "motor", name=name, site=name, gear=row(gear), ctrllimited="true", ctrlrange=limits)
    for n, length in enumerate(craft.rays.lengths):
        SubElement(sensors, "rangefinder", name=f"ray-{n}", site=f"ray-{n}", cutoff=row(length))
