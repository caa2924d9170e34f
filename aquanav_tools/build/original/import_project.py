"""The import, main path of its command: each cave of the original becomes a scenario folder, built like any scan."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.build.options import BuildOptions
from aquanav_tools.build.original.project import OriginalCave, read_project
from aquanav_tools.build.outputs import write_json
from aquanav_tools.build.recipe import BuildResult, build_cave
from aquanav_tools.cave.options import RouteOptions, StartOptions
from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array, Stages, silent

VEHICLE = "original-auv"
START_ROOM = 0.4
"""Starts keep this share of the passage's radius from the walls; the original's, where known, keep 0.46 to 0.77."""
START_SHARE = 0.15
"""Without panels, starts lie in this share of the way that is farthest from the goal: about before the first panel."""
RECORD_FILE = "original.json"
"""Beside the scenario folders: where each cave came from and how it was placed."""


@dataclass(frozen=True)
class ImportOptions:
    """One import."""

    project: Path
    output: Path
    caves: tuple[str, ...] = ()
    """Names of the caves to import; all when empty."""
    vehicle: str = VEHICLE
    overwrite: bool = False


def choose_caves(options: ImportOptions) -> list[OriginalCave]:
    """Return the caves of the project that the options name.

    Raises:
        InputError: the project cannot be read, or has no cave of a name.
    """
    caves = read_project(options.project)
    known = [cave.name for cave in caves]
    for name in options.caves:
        if name not in known:
            raise InputError(f"The project has no cave '{name}'.{did_you_mean(name, known)}")
    return [cave for cave in caves if not options.caves or cave.name in options.caves]


def import_caves(
    caves: Sequence[OriginalCave],
    options: ImportOptions,
    display: Stages = silent,
    announce: Callable[[str], None] | None = None,
) -> list[BuildResult]:
    """Build a scenario folder `output/name` for each cave, with the placed mesh as `output/name.obj` beside it.

    Raises:
        AquanavError: a cave cannot be built; those before it are finished.
    """
    options.output.mkdir(parents=True, exist_ok=True)
    write_json({cave.name: _facts(cave, options.project) for cave in caves}, options.output / RECORD_FILE)
    results = []
    for cave in caves:
        if announce is not None:
            announce(describe(cave))
        build = build_options(cave, options)
        build.input.write_text(cave.mesh.to_trimesh().export(file_type="obj"), encoding="ascii")
        results.append(build_cave(build, display, announce))
    return results


def describe(cave: OriginalCave) -> str:
    """Return a sentence on how a cave was placed."""
    if cave.rewarder is None:
        return (
            f"{cave.name}: no panels of the project fit {cave.model.name}, so where it stood and how large it was is "
            f"not known. It is made as wide and as long as the project's other caves ({cave.placement.extent:.0f} m, "
            f"mean radius {cave.placement.radius:.1f} m); its goal is a few metres before the far end."
        )
    return (
        f"{cave.name}: {cave.model.name} with the {len(cave.rewarder.centres)} panels of {cave.rewarder.name}, "
        f"which miss its middle line by {cave.placement.misfit:.2f} m (rms) at a mean radius of "
        f"{cave.placement.radius:.1f} m."
    )


def build_options(cave: OriginalCave, options: ImportOptions) -> BuildOptions:
    """Return how to build a cave: from its placed mesh, with its goal, and starts as the original's were."""
    goal = ",".join(f"{value:.4f}" for value in _route_end(cave, options.vehicle))
    return BuildOptions(
        input=options.output / f"{cave.name}.obj",
        output=options.output / cave.name,
        vehicle=options.vehicle,
        overwrite=options.overwrite,
        route=RouteOptions(goal=goal),
        starts=_starts(cave, load_vehicle(options.vehicle).capsule.radius),
    )


def _starts(cave: OriginalCave, vehicle_radius: float) -> StartOptions:
    """Return where starts lie: before the first panel, away from the walls. The original's own lists are lost."""
    steps = np.linalg.norm(np.diff(cave.line, axis=0), axis=1)
    stations = np.append(0.0, np.cumsum(steps)) / steps.sum()
    share = START_SHARE
    if cave.rewarder is not None:
        first, goal = (stations[_nearest(cave.line, cave.rewarder.centres[n])] for n in (0, -1))
        share = float(np.clip(first / max(goal, 1e-9), 0.05, 1.0))
    room = START_ROOM * float(cave.radii[stations <= share].min())
    return StartOptions(last_share=share, margin=max(room - vehicle_radius, 0.0))


def _nearest(line: Array, point: Array) -> int:
    return int(np.argmin(np.linalg.norm(line - point, axis=1)))


def _route_end(cave: OriginalCave, vehicle: str) -> Array:
    """Return where the route must end for its last panel to stand at the goal: a vehicle's length farther."""
    nearest = _nearest(cave.line, cave.goal)
    ways = np.linalg.norm(cave.line[nearest:] - cave.line[nearest], axis=1)
    beyond = np.flatnonzero(ways >= load_vehicle(vehicle).capsule.length)
    step = cave.line[nearest + beyond[0]] - cave.line[nearest] if len(beyond) else np.zeros(3)
    end: Array = cave.goal + step
    return end


def _facts(cave: OriginalCave, project: Path) -> dict[str, Any]:
    placement, rewarder = cave.placement, cave.rewarder
    facts: dict[str, Any] = {
        "model": cave.model.relative_to(project).as_posix(),
        "placement": {
            "quarter_turns": placement.num_quarters,
            "scale": placement.scale.tolist(),
            "move": placement.move.tolist(),
            "mean_radius": placement.radius,
        },
    }
    if rewarder is not None:
        facts["placement"]["misses"] = placement.misses.tolist()
        facts["panels"] = {
            "prefab": rewarder.name,
            "centres": rewarder.centres.tolist(),
            "normals": rewarder.normals.tolist(),
            "sides": rewarder.sides.tolist(),
        }
    return facts
