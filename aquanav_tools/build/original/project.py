"""From a clone of the original's Unity project to its caves, each placed as its scene had it."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.build.original.placement import Placement, best_placement, likely_placement
from aquanav_tools.build.original.rewarder import Rewarder, read_rewarders
from aquanav_tools.build.original.tube import Tube, tube_of
from aquanav_tools.cave.scan.fbx import read_fbx
from aquanav_tools.cave.scan.read import world_from_file
from aquanav_tools.cave.scan.surface_file import SurfaceFile
from aquanav_tools.errors import InputError
from aquanav_tools.types import Array, Mesh

logger = logging.getLogger(__name__)

ASSETS_DIR = "Assets"
MAX_MODELS = 500
GOAL_BEFORE_EXIT = 3.5
"""Of the original's caves whose panels are known, the goals lie 3 to 4 m before the exit, m."""


@dataclass(frozen=True, eq=False)
class OriginalCave:
    """A cave of the original in the world frame."""

    name: str
    """Its model's file name in small letters with hyphens, as scenarios are called."""
    model: Path
    mesh: Mesh
    """Open at both ends, m."""
    line: Array
    """(C, 3) middle line from the entrance to the exit, m."""
    radii: Array
    """(C,) mean distance of the wall from it, m."""
    placement: Placement
    rewarder: Rewarder | None
    """Whose panels stood in it; None where none fits and the placement was chosen by the other caves' size."""

    @property
    def goal(self) -> Array:
        """(3,) centre of the last panel, m, at most 0.6 m from the goal of the original's training settings.

        Without panels, a place on the middle line as far before the exit as the original's goals are.
        """
        if self.rewarder is not None:
            return self.rewarder.centres[-1]
        ways = np.linalg.norm(self.line - self.line[-1], axis=1)
        return self.line[np.flatnonzero(ways >= GOAL_BEFORE_EXIT)[-1]]


@dataclass(frozen=True, eq=False)
class _Model:
    path: Path
    mesh: Mesh
    tube: Tube


def read_project(folder: Path) -> list[OriginalCave]:
    """Return all caves of a clone of the SafeRLAUV project, by name.

    A cave is a model that is one tube with two open ends; its panels are those that fit it best. Neither is known by
    its name: the scenes that joined them are lost, and names repeat.

    Raises:
        InputError: the folder is no Unity project, holds no cave or no panels, or a file of it cannot be read.
    """
    assets = _assets(folder)
    rewarders = read_rewarders(assets)
    if not rewarders:
        raise InputError(
            f"{assets} has no prefab with the panels of a DistanceRewarder, which tell where the caves stand and where "
            "their goals are. Clone the whole SafeRLAUV project, its prefabs too."
        )
    models = list(_tubes(assets))
    if not models:
        raise InputError(
            f"{assets} has no FBX model of a cave: none is a single tube with two open ends. Clone the whole SafeRLAUV "
            "project; if its models are pointers of Git LFS, run git lfs pull."
        )
    fits = [best_placement(model.tube, rewarders) for model in models]
    placed = [fit[0] for fit in fits if fit is not None]
    if not placed:
        raise InputError(
            f"None of the {len(rewarders)} DistanceRewarders in {assets} fits any of its {len(models)} caves: "
            f"{', '.join(model.path.name for model in models)}. Caves and panels are of different versions; clone the "
            "project again."
        )
    names = _unique_names([model.path for model in models])
    caves = []
    for name, model, fit in zip(names, models, fits, strict=True):
        placement, rewarder = fit if fit is not None else (likely_placement(model.tube, placed), None)
        line, radii = placement.apply(model.tube.line), model.tube.radii * placement.scale[2]
        if placement.runs_backwards(line, rewarder.centres) if rewarder is not None else bool(line[0, 0] > line[-1, 0]):
            line, radii = line[::-1], radii[::-1]
        caves.append(OriginalCave(name, model.path, placement.place(model.mesh), line, radii, placement, rewarder))
    return sorted(caves, key=lambda cave: cave.name)


def _assets(folder: Path) -> Path:
    if not folder.is_dir():
        raise InputError(f"There is no folder {folder}. Name a clone of the SafeRLAUV project.")
    assets = folder if folder.name == ASSETS_DIR else folder / ASSETS_DIR
    if not assets.is_dir():
        raise InputError(
            f"{folder} is no Unity project: it has no folder {ASSETS_DIR}. Name the folder that git cloned from "
            "dadecampo/SafeRLAUV on GitHub."
        )
    return assets


def _tubes(assets: Path) -> Iterator[_Model]:
    """Yield the models that are caves. One that cannot be read is told and left out: a clone has many others."""
    paths = sorted(path for path in assets.rglob("*") if path.suffix.lower() == ".fbx" and path.is_file())
    if len(paths) > MAX_MODELS:
        raise InputError(
            f"{assets} has {len(paths)} FBX models, more than {MAX_MODELS}. Name the project's own folder."
        )
    for path in paths:
        try:
            mesh = _upright(read_fbx(path))
        except InputError as error:
            logger.warning("%s", error)
            continue
        tube = tube_of(mesh)
        if tube is not None:
            yield _Model(path, mesh, tube)


def _upright(read: SurfaceFile) -> Mesh:
    """Return the mesh in an FBX file in metres, z up."""
    assert isinstance(read.surface, Mesh)
    assert read.metres_per_unit is not None
    assert read.up is not None
    turn = read.metres_per_unit * world_from_file(read.up)
    return Mesh(read.surface.vertices @ turn.T, read.surface.faces)


def _unique_names(paths: list[Path]) -> list[str]:
    """Return a scenario's name for each model; a model whose name was taken gets a number."""
    names: list[str] = []
    for path in paths:
        plain = re.sub(r"[^a-z0-9]+", "-", path.stem.lower()).strip("-") or "cave"
        taken = sum(name == plain or name.startswith(f"{plain}--") for name in names)
        names.append(plain if not taken else f"{plain}--{taken + 1}")
    return names
