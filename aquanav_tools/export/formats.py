"""Writing a scenario in a format: what all formats share, then the format's own files."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.export.current import UNIT_STRENGTH, write_current
from aquanav_tools.export.gltf import write_gltf
from aquanav_tools.export.meshes import write_obj, write_palette
from aquanav_tools.export.mjcf import write_mjcf
from aquanav_tools.export.scene import Craft, Scene, scene_of
from aquanav_tools.export.sdf import write_sdf
from aquanav_tools.export.stonefish import write_stonefish
from aquanav_tools.export.urdf import write_urdf
from aquanav_tools.export.usd import write_usd
from aquanav_tools.scenario.schema import Scenario

Writer = Callable[[Scene, Path], tuple[str, ...]]


def _only_meshes(scene: Scene, folder: Path) -> tuple[str, ...]:
    return ("meshes/cave.obj", "meshes/collision.obj")


FORMATS: dict[str, Writer] = {
    "gltf": write_gltf, "mjcf": write_mjcf, "obj": _only_meshes, "sdf": write_sdf,
    "stonefish": write_stonefish, "urdf": write_urdf, "usd": write_usd,
}  # fmt: skip
"""By name; each writes its files into a folder that has the meshes already, and returns those to open."""


def check_format(name: str) -> None:
    """Refuse a format that is not known.

    Raises:
        InputError: with the nearest name.
    """
    if name not in FORMATS:
        raise InputError(f"There is no format '{name}'.{did_you_mean(name, FORMATS)}")


def check_target(folder: Path) -> None:
    """Refuse a folder that holds something.

    Raises:
        InputError: it is a file, or not empty.
    """
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise InputError(f"{folder} exists and is no empty folder; nothing was written. Delete it, or choose another.")


def export_scenario(scenario: Scenario, name: str, folder: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Write a scenario in a format into a new or empty folder.

    Returns:
        The files to open, relative to the folder; and sentences on what the scenario lacks.

    Raises:
        InputError: the format is not known, the folder holds something or cannot be written to.
    """
    check_format(name)
    check_target(folder)
    scene = scene_of(scenario)
    try:
        (folder / "meshes").mkdir(parents=True)
        _write_shared(scene, folder)
        return FORMATS[name](scene, folder), scene.notes
    except OSError as cause:
        raise InputError(f"Cannot write the scene to {folder}: {cause}. Choose another folder.") from cause


def _write_shared(scene: Scene, folder: Path) -> None:
    meshes = folder / "meshes"
    write_palette(meshes)
    for n, level in enumerate(scene.levels):
        write_obj(level, meshes / (f"cave-lod{n}.obj" if n else "cave.obj"))
    write_obj(scene.collision, meshes / "collision.obj")
    write_obj(scene.craft.look, meshes / "vehicle.obj")
    if scene.current is not None:
        write_current(scene.current, folder)
    (folder / "scene.json").write_text(json.dumps(_table(scene), indent=1, default=_plain), encoding="utf-8")


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no form in JSON")


def _table(scene: Scene) -> dict[str, Any]:
    """Return all that is known of a scene: what a format has no word for is here."""
    return {
        "name": scene.name,
        "units": "SI: m, s, kg, N, rad. World: z up. Body: x ahead, y left, z up. Quaternions: (w, x, y, z).",
        "collision_error": scene.collision_error,
        "portals": [
            {"label": lid.label, "centre": lid.centre, "normal": lid.normal, "area": lid.area} for lid in scene.portals
        ],
        "starts": [{"position": pose.position, "orientation": pose.orientation} for pose in scene.starts],
        "route": scene.guide.centreline,
        "panels": [
            {"centre": gate.centre, "normal": gate.normal, "polygon": gate.polygon, "arc_length": gate.arc_length}
            for gate in scene.guide.panels
        ],
        "goal": {"position": scene.goal, "tolerance": scene.goal_tolerance},
        "water": {
            "density": scene.water.density,
            "temperature": scene.water.temperature,
            "salinity": scene.water.salinity,
            "surface": scene.water.surface,
            "current": scene.water.current,
            "current_grid_is_for": _meaning(scene),
        },
        "vehicle": _craft_table(scene.craft),
    }


def _meaning(scene: Scene) -> str | None:
    if scene.current is None:
        return None
    unit = f"a mean of {UNIT_STRENGTH:g} m/s through the narrowest section; the scenario's own water is still"
    return unit if scene.current.is_unit else "the scenario's own current"


def _craft_table(craft: Craft) -> dict[str, Any]:
    table: dict[str, Any] = {
        "name": craft.name,
        "mass": craft.mass,
        "inertia": craft.inertia,
        "centre_of_mass": craft.centre_of_mass,
        "capsule": {"radius": craft.capsule.radius, "axis_length": craft.capsule.axis_length, "axis": "x"},
        "lamp": {"position": craft.lamp, "direction": [1.0, 0.0, 0.0]},
        "thrusters": [{"position": place, "direction": push} for place, push in craft.thrusters],
        "max_forward": craft.max_forward,
        "max_reverse": craft.max_reverse,
        "rays": {"directions": craft.rays.directions, "lengths": craft.rays.lengths},
    }
    if craft.hydrodynamics is not None:
        water, body = craft.hydrodynamics.water, craft.hydrodynamics.body
        table["volume"], table["buoyancy_height"] = body.volume, body.buoyancy_height
        table["added_mass"] = water.matrix()
        table["linear_damping"], table["quadratic_damping"] = water.linear_damping, water.quadratic_damping
    return table
