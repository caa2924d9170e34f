"""Building and loading scenarios."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from aquanav_tools.api.bars import stages
from aquanav_tools.build.built import BuiltScenario, build_options, build_scenario
from aquanav_tools.envs.factory import AnyScenario, read_any_scenario


def build_cave(
    input: str | Path,
    output: str | Path,
    *,
    recipe: str | Path | None = None,
    overwrite: bool = False,
    progress: bool = False,
    **settings: Any,
) -> BuiltScenario:
    """Build a scenario folder from photos, a video, a scan or a survey.

    Args:
        input: Folder of photos or a video; a mesh or a point cloud; or a survey (.svx, .3d, .th).
        output: Scenario folder to write.
        recipe: TOML file with settings, as in pipelines/build; `settings` win over it.
        overwrite: Whether to replace another scenario in the output folder.
        progress: Whether to show a bar for each stage, where stderr is a terminal.
        settings: Every other option of aquanav-build-cave by its name: vehicle="bluerov2", unit="cm", up="y", seed=0,
            voxel=0.1 (m), positions=... and so on; those of panels, starts and water as dicts, water={"current": ...}.

    Raises:
        InputError: no such input or setting (with the nearest name), or a value that makes no sense.
        ReconstructionError: the photos could not be turned into cameras and points.
        MeshError: the surface could not be turned into a watertight cavity that the vehicle can pass.
        ResourceError: memory or disk are too small.
    """
    given = {"input": Path(input), "output": Path(output), "overwrite": overwrite, **settings}
    return build_scenario(build_options(given, None if recipe is None else Path(recipe)), stages(progress))


def load_scenario(scenario: str | Path) -> AnyScenario:
    """Return a cave (`Scenario`) or a bay for boats (`Bay`), checked whole; a shipped cave is built when first used.

    Of a cave, in metres and the world's frame (z up): `cavity.mesh.vertices` (V, 3) and `.faces` (F, 3), `starts`,
    `guide.length` of the route from start to goal, `field` with the clearance, `flow` with the current or None.

    Args:
        scenario: A scenario folder, or a shipped name such as "cave-test-1" or "bay-calm".

    Raises:
        ScenarioError: there is none (with the nearest names), or it is damaged.
    """
    return read_any_scenario(scenario)
