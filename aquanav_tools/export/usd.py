"""USD as text (.usda): z up, metres, quaternions (w, x, y, z). Levels of detail are a variant set of the cave."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aquanav_tools.export.meshes import face_colours
from aquanav_tools.export.numbers import rotation_to
from aquanav_tools.export.scene import Craft, Scene
from aquanav_tools.types import Array, Mesh

HEAD = (
    '#usda 1.0\n(\n    defaultPrim = "World"\n    metersPerUnit = 1\n    kilogramsPerUnit = 1\n    upAxis = "Z"\n)\n\n'
)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])


def write_usd(scene: Scene, folder: Path) -> tuple[str, ...]:
    """Write scene.usda."""
    levels = "".join(f'"lod{n}" {{\n{_mesh("Visual", level)}}}\n' for n, level in enumerate(scene.levels))
    parts = [
        'def Xform "Cave" (\nvariants = { string lod = "lod0" }\nprepend variantSets = "lod"\n)\n{\n',
        _mesh("Collision", scene.collision, collides=True),
        f'variantSet "lod" = {{\n{levels}}}\n}}\n',
        _curve("Route", scene.guide.centreline, is_closed=False),
        *(_curve(f"Panel_{n}", panel.polygon, is_closed=True) for n, panel in enumerate(scene.guide.panels)),
        *(_place(f"Portal_{lid.label}", lid.centre, rotation_to(lid.normal)) for lid in scene.portals),
        *(_place(f"Start_{n}", pose.position, pose.orientation) for n, pose in enumerate(scene.starts)),
        _place("Goal", scene.goal, LEVEL),
        _vehicle(scene.craft, scene.starts[0].position, scene.starts[0].orientation),
    ]
    gravity = 'def PhysicsScene "Physics"\n{\nvector3f physics:gravityDirection = (0, 0, -1)\n}\n'
    text = HEAD + 'def Xform "World"\n{\n' + gravity + "".join(parts) + "}\n"
    (folder / "scene.usda").write_text(text, encoding="ascii")
    return ("scene.usda",)


def _rows(values: Array) -> str:
    return "[" + ", ".join("(" + ", ".join(f"{value:.9g}" for value in line) + ")" for line in values) + "]"


def _mesh(name: str, mesh: Mesh, collides: bool = False) -> str:
    schemas, more = "", 'uniform token subdivisionScheme = "none"\nuniform bool doubleSided = true\n'
    if collides:
        schemas = '(\nprepend apiSchemas = ["PhysicsCollisionAPI", "PhysicsMeshCollisionAPI"]\n)\n'
        more += 'uniform token purpose = "guide"\nuniform token physics:approximation = "none"\n'
    if mesh.colours is not None:
        share = face_colours(mesh) / 255.0
        linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
        more += f'color3f[] primvars:displayColor = {_rows(linear)} (\ninterpolation = "uniform"\n)\n'
    counts = ", ".join(["3"] * len(mesh.faces))
    indices = ", ".join(map(str, mesh.faces.ravel()))
    return (
        f'def Mesh "{name}" {schemas}{{\n{more}int[] faceVertexCounts = [{counts}]\n'
        f"int[] faceVertexIndices = [{indices}]\npoint3f[] points = {_rows(mesh.vertices)}\n}}\n"
    )


def _curve(name: str, points: Array, is_closed: bool) -> str:
    wrap = "periodic" if is_closed else "nonperiodic"
    return (
        f'def BasisCurves "{name}"\n{{\nuniform token type = "linear"\nuniform token wrap = "{wrap}"\n'
        f"int[] curveVertexCounts = [{len(points)}]\npoint3f[] points = {_rows(points)}\n"
        'float[] widths = [0.02] (\ninterpolation = "constant"\n)\n}\n'
    )


def _moved(place: Array, turn: Array) -> str:
    where, how = (", ".join(f"{value:.9g}" for value in values) for values in (place, turn))
    return (
        f"double3 xformOp:translate = ({where})\nquatd xformOp:orient = ({how})\n"
        'uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:orient"]\n'
    )


def _place(name: str, place: Array, turn: Array) -> str:
    return f'def Xform "{name}"\n{{\n{_moved(place, turn)}}}\n'


def _vehicle(craft: Craft, place: Array, turn: Array) -> str:
    """Return the vehicle as a rigid body; what is along z of a thruster's or a ray's prim is its direction."""
    schemas = '"PhysicsRigidBodyAPI", "PhysicsMassAPI"'
    centre, moments = (", ".join(f"{v:.9g}" for v in values) for values in (craft.centre_of_mass, craft.inertia))
    hull = (
        'def Capsule "Hull" (\nprepend apiSchemas = ["PhysicsCollisionAPI"]\n)\n{\nuniform token axis = "X"\n'
        f"double radius = {craft.capsule.radius:.9g}\ndouble height = {craft.capsule.axis_length:.9g}\n"
        'uniform token purpose = "guide"\n}\n'
    )
    marks = [
        *(_place(f"Thruster_{n}", at, rotation_to(push)) for n, (at, push) in enumerate(craft.thrusters)),
        *(_place(f"Ray_{n}", np.zeros(3), rotation_to(ray)) for n, ray in enumerate(craft.rays.directions)),
    ]
    # A light shines along -z of its own.
    shine = _moved(craft.lamp, rotation_to(np.array([-1.0, 0.0, 0.0])))
    lamp = f'def SphereLight "Lamp"\n{{\nfloat inputs:radius = 0.02\n{shine}}}\n'
    return (
        f'def Xform "Vehicle" (\nprepend apiSchemas = [{schemas}]\n)\n{{\nfloat physics:mass = {craft.mass:.9g}\n'
        f"point3f physics:centerOfMass = ({centre})\nfloat3 physics:diagonalInertia = ({moments})\n"
        f"{_moved(place, turn)}{_mesh('Look', craft.look)}{hull}{lamp}{''.join(marks)}}}\n"
    )
