"""aquanav export: a scenario as a scene of another simulator."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Export:
    """Write a scenario for another simulator: aquanav export cave-test-1 --to mjcf -o out/scene.

    Formats: sdf (Gazebo), urdf (PyBullet, ROS), mjcf (MuJoCo), stonefish, usd, gltf, obj. All come with the meshes as
    OBJ, with scene.json (portals, starts, route, panels, water, vehicle) and with the current as CSV and VTK, where
    there is one.
    """

    scenario: Annotated[str, tyro.conf.Positional]
    """A scenario's folder or name."""
    to: str
    """The format: sdf, urdf, mjcf, stonefish, usd, gltf or obj."""
    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for the scene, new or empty."""


def run_export(options: Export) -> None:
    """Write the scene and say what to open, and what the scenario lacks.

    Raises:
        InputError: the format is not known, or the folder holds something.
        ScenarioError: there is no such scenario, or it is damaged.
    """
    from aquanav_tools.export.formats import check_format, check_target, export_scenario
    from aquanav_tools.scenario.folder import read_scenario

    check_format(options.to)
    check_target(options.output)
    opened, notes = export_scenario(read_scenario(options.scenario), options.to, options.output)
    for note in notes:
        print(f"Note: {note}")
    print("Scene: " + ", ".join(str(options.output / name) for name in opened))
