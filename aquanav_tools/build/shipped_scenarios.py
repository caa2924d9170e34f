"""Building the scenarios that come with aquanav, from scenarios/*.toml."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from aquanav_tools.build.cave_stages import Closing
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.build.recipe import BuildResult, build_made_up
from aquanav_tools.cave.cavity import WALL
from aquanav_tools.cave.closing.solid import ClosedSurface
from aquanav_tools.cave.options import PanelOptions, StartOptions, WaterOptions
from aquanav_tools.cave.route.passability import route_clearance
from aquanav_tools.cave.scan.resolution import Resolution
from aquanav_tools.cave.scan.surface import Surface
from aquanav_tools.errors import InputError, near_names
from aquanav_tools.provenance import file_hash
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.scenario.shipped import CONTENT, SETTINGS_FILE, WORK_SUFFIX, named_folder
from aquanav_tools.shipped import shipped_names, shipped_path
from aquanav_tools.sim.vehicle import parse_vehicle
from aquanav_tools.store import locked
from aquanav_tools.synthetic.galleries import GalleryOptions, gallery_cave
from aquanav_tools.synthetic.made_up import made_up_cavity
from aquanav_tools.tables import from_table, read_toml
from aquanav_tools.types import Stages, silent

Split = Literal["train", "validation", "test"]
MERGED_VOXELS = 0.1
"""Triangles are merged where that moves the wall by no more than this, voxels."""
FAR_SHARE = 0.6
"""Starts of shipped caves lie in this share of the way, at its far end, so that their results stay comparable; caves
that are drawn, and those that users build, have them everywhere."""
TURN_LENGTH = 1.0
"""Turns are measured between stretches of the way of this length, m."""


@dataclass(frozen=True)
class ShippedScenario:
    """What a file in scenarios/ holds."""

    title: str
    """What the cave is like, in a few words."""
    split: Split
    """What it is for; results are reported on "test" alone."""
    cave: GalleryOptions
    """How it is made up."""
    vehicle: str = "bluerov2"
    """Vehicle that must be able to pass."""
    panels: PanelOptions = field(default_factory=PanelOptions)
    starts: StartOptions = field(default_factory=lambda: StartOptions(last_share=FAR_SHARE))
    water: WaterOptions = field(default_factory=WaterOptions)


def read_shipped(name: str) -> ShippedScenario:
    """Return the recipe of a shipped scenario.

    Raises:
        InputError: there is none of that name, or its file has an unknown key or a value that makes no sense.
    """
    known = shipped_names(CONTENT)
    if name not in known:
        raise InputError(
            f"aquanav ships no scenario '{name}'. The nearest names are {', '.join(near_names(name, known))}; "
            "`aquanav scenarios` lists all."
        )
    path = shipped_path(CONTENT, name)
    return from_table(ShippedScenario, read_toml(path), path.name)


def build_shipped(
    name: str, display: Stages = silent, announce: Callable[[str], None] | None = None
) -> BuildResult | None:
    """Build a shipped scenario into its folder in the cache; None where it lies there already.

    Raises:
        AquanavError: the cave cannot be made or built; nothing that could be taken for a scenario is left.
    """
    recipe = read_shipped(name)
    folder = named_folder(name)
    if (folder / SETTINGS_FILE).is_file():
        return None
    work = folder.with_name(folder.name + WORK_SUFFIX)
    with locked(work, waits=True), contextlib.ExitStack() as ending:
        # While it is held: who waits for it then makes another one.
        ending.callback(shutil.rmtree, work, ignore_errors=True)
        if (folder / SETTINGS_FILE).is_file():  # built by another process meanwhile
            return None
        journal = Journal(display) if announce is None else Journal(display, announce)
        journal.announce(f"Building {name}, {recipe.title}, in {folder}: about a minute on a free core, and only once.")
        return build_gallery(recipe, shipped_path(CONTENT, name), folder, journal)


def build_gallery(recipe: ShippedScenario, recipe_path: Path, folder: Path, journal: Journal) -> BuildResult:
    """Build the scenario of a recipe, named after its file, into a folder; what lies there is replaced.

    Raises:
        AquanavError: the cave cannot be made, or the vehicle cannot pass.
    """
    name = recipe_path.stem
    with journal.stage("Making up the cave"):
        closing = made_up(name, recipe)
    options = BuildOptions(
        input=recipe_path,
        output=folder,
        name=name,
        vehicle=recipe.vehicle,
        panels=recipe.panels,
        starts=recipe.starts,
        water=recipe.water,
        overwrite=True,
    )
    return build_made_up(closing, options, journal, {recipe_path.name: file_hash(recipe_path)})


def made_up(name: str, recipe: ShippedScenario) -> Closing:
    """Return the cavity of a recipe. It is closed from the start and proven; nothing has to be resampled."""
    try:
        cave = gallery_cave(recipe.cave)
    except ValueError as cause:
        raise InputError(f"{name}: {cause}") from cause
    cavity = made_up_cavity(cave.truth, MERGED_VOXELS * recipe.cave.voxel)
    closed = ClosedSurface(cavity.mesh, cavity.labels == WALL, "made-up")
    resolution = Resolution(recipe.cave.voxel, "the grid the cave was made up on", 0.0)
    return Closing(resolution, Surface(cave.mesh, cave.mesh.vertices), closed, cavity)


@dataclass(frozen=True)
class Difficulty:
    """How hard a scenario is, in figures that do not depend on who dives it."""

    length: float
    """Of the way to the goal, m."""
    least_clearance: float
    """Of the way, over half of the vehicle's width; 1 leaves no room."""
    median_clearance: float
    """The same for the median of the way."""
    curvature: float
    """By how much the way turns, degrees per metre."""
    num_loops: int
    num_dead_ends: int
    current: str
    """Preset of the water."""


def difficulty(scenario: Scenario) -> Difficulty:
    """Return how hard a scenario is for the vehicle it carries."""
    radius = parse_vehicle(scenario.vehicle_toml, scenario.name).capsule.radius
    line = scenario.guide.centreline
    clearance = route_clearance(scenario.cavity.wall_surface, line)
    ends = line[:: max(1, round(TURN_LENGTH / np.linalg.norm(line[1] - line[0])))]
    ahead = np.diff(ends, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    turns = np.degrees(np.arccos(np.clip((ahead[1:] * ahead[:-1]).sum(axis=1), -1.0, 1.0)))
    network = scenario.network
    return Difficulty(
        length=scenario.guide.length,
        least_clearance=clearance.least / radius,
        median_clearance=clearance.median / radius,
        curvature=float(turns.sum() / scenario.guide.length),
        num_loops=network.num_loops,
        num_dead_ends=network.num_dead_ends,
        current=str(scenario.settings.water.current),
    )
