"""Building scenarios in caves that are drawn from a style and a seed: the short way, without pictures or a report.

The cavity is proven, and the distances, the way, the panels, the currents and the starts are those of every build.
What a drawn cave does not need is left out: closing, a simplified collision mesh (the cavity is its own, exactly), the
centreline graph, drawings. The grids of distances and currents grow with the opening.
"""

from __future__ import annotations

import dataclasses
import math
import os
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools import __version__
from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.options import PanelOptions, StartOptions
from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.cave.route.panels import place_panels
from aquanav_tools.cave.route.route import Route, find_route
from aquanav_tools.cave.route.starts import draw_starts
from aquanav_tools.cave.water.flow import Flow, find_flow
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.polyline import length_of
from aquanav_tools.geometry.volume.distance import distance_field
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.geometry.volume.geodesic import WaterGraph
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import BuiltBy, GoalSettings, LimitSettings, Scenario, ScenarioSettings
from aquanav_tools.scenario.shipped import (
    SETTINGS_FILE,
    WORK_SUFFIX,
    generated_name,
    mark_used,
    named_folder,
    trim_drawn,
)
from aquanav_tools.sim.vehicle import load_vehicle, vehicle_path
from aquanav_tools.store import locked
from aquanav_tools.synthetic.made_up import made_up_cavity
from aquanav_tools.synthetic.styles.catalogue import VEHICLE_WIDTH, DrawnCave, draw_cave
from aquanav_tools.synthetic.styles.surface import water_surface
from aquanav_tools.text_files import read_text
from aquanav_tools.types import Capsule

VEHICLE = "bluerov2"
"""Vehicle that must be able to pass."""
MERGED_VOXELS = 0.1
"""Triangles are merged where that moves the wall by no more than this, voxels."""
SPACING_RADII, SPACING_VOXELS = 0.5, 0.75
"""The distance field's spacing: the larger of these shares of the vehicle's radius and of the voxel. Rays that are
traced through it err by 1 to 5 mm in the median and by 19 to 70 mm at 99 % (six caves, against Embree)."""
MAX_NODES = 80_000
"""Places in the water among which ways are sought; more water is searched on every second sample."""
FLOW_CELLS = 12_000
"""The flow has about this many cells: velocities on the way are within 1 % (a bedding plane: 6 %) of those with
100,000, and 90 to 96 % of the flow passes cross-sections of the passage, where those have 97 to 99 %."""
NUM_STARTS = 20
SECONDS_PER_METRE = 6.0
"""An episode lasts so long for each metre of the way, s, and no less than the original's. The oracle takes 3 to 5.4 s
at full current in passages narrower than two vehicle widths; the 2 to 4 s of long ways in other caves end its dives."""
MIN_WIDTHS, MAX_WIDTHS = 1.25, 20.0
"""Narrowest place of the way, vehicle widths."""
SHORTEST = 12.0
"""Of the way, m: side passages that meet by chance may cut a winding one short."""
MAX_ATTEMPTS = 8
"""Caves that are drawn for a name until one can be dived."""


@dataclass(frozen=True, eq=False)
class GeneratedCave:
    """A scenario in a drawn cave, with what was drawn."""

    scenario: Scenario
    drawn: DrawnCave
    attempts: int
    """How many caves were drawn."""
    width: float
    """Of the narrowest place of the way, m."""


def generate(style: str, seed: int) -> GeneratedCave:
    """Return the scenario in the cave of a style and a seed; the same ones always give the same.

    A drawn cave that cannot be dived, or is narrower or wider than MIN_WIDTHS and MAX_WIDTHS allow, is drawn anew, a
    little wider.

    Raises:
        InputError: there is no such style, or the seed is out of range.
        MeshError: none of MAX_ATTEMPTS caves can be dived; the message has what was wrong with each.
    """
    faults = []
    for attempt in range(MAX_ATTEMPTS):
        drawn = draw_cave(style, seed, attempt)
        try:
            scenario, width = scenario_of(drawn)
        except MeshError as error:
            faults.append(str(error))
            continue
        return GeneratedCave(scenario, drawn, attempt + 1, width)
    text = "; ".join(f"{n}: {fault}" for n, fault in enumerate(faults, start=1))
    raise MeshError(
        f"None of {MAX_ATTEMPTS} caves of {generated_name(style, seed)} can be dived ({text}). Take another seed."
    )


def scenario_of(drawn: DrawnCave) -> tuple[Scenario, float]:
    """Return the scenario in a drawn cave and the width of the narrowest place of its way, m.

    Raises:
        MeshError: the surface is no proven solid, has not two whole portals, the vehicle cannot pass, the narrowest
            place is narrower or wider than MIN_WIDTHS and MAX_WIDTHS allow, or the way is shorter than SHORTEST.
    """
    capsule = load_vehicle(VEHICLE).capsule
    cavity = made_up_cavity(water_surface(drawn.plan, drawn.voxel, drawn.noise_seed), MERGED_VOXELS * drawn.voxel)
    field = distance_field(cavity.mesh, max(SPACING_RADII * capsule.radius, SPACING_VOXELS * drawn.voxel))
    graph = WaterGraph(field, capsule.radius, MAX_NODES)
    entrance, goal = (portal.centre for portal in cavity.portals)
    if drawn.end is not None:
        goal, room = drawn.end, field.clearance_at(drawn.end)
        if room < capsule.radius:
            raise MeshError(f"the end of its way has {room:.2f} m of room around it")
    route = find_route(cavity, field, capsule.radius, entrance, goal, graph)
    width = _narrowest(route, cavity, capsule)
    if not MIN_WIDTHS <= width / VEHICLE_WIDTH <= MAX_WIDTHS:
        raise MeshError(f"its narrowest place is {width:.2f} m, {width / VEHICLE_WIDTH:.1f} vehicle widths, wide")
    length = length_of(route.points)
    if length < SHORTEST:
        raise MeshError(f"its way is {length:.1f} m long")
    guide = place_panels(cavity, field, route, capsule.length, PanelOptions(), capsule.radius)
    rng = np.random.default_rng(drawn.noise_seed)
    options = StartOptions(count=NUM_STARTS, last_share=1.0)
    starts = draw_starts(cavity, field, guide, capsule, options, rng, graph)
    settings = ScenarioSettings(
        name=f"{drawn.style}-{drawn.seed}",
        built=BuiltBy(__version__, "synthetic"),
        goal=GoalSettings(tuple(float(c) for c in guide.centres[-1])),  # type: ignore[arg-type]
        vehicle=VEHICLE,
        limits=_limits(guide.length),
    )
    flow = _flow(cavity, field, guide)
    vehicle_toml = read_text(vehicle_path(VEHICLE))
    scenario = Scenario(settings, cavity, cavity.mesh, field, guide, starts, vehicle_toml, flow)
    return scenario, width


def _limits(way: float) -> LimitSettings:
    """Return the limits of episodes in a cave whose way has a length, m."""
    usual = LimitSettings()
    needed = math.ceil(SECONDS_PER_METRE * way / (usual.dt * usual.substeps))
    return dataclasses.replace(usual, decisions=max(needed, usual.decisions))


def _flow(cavity: Cavity, field: DistanceField, guide: Guide) -> Flow | None:
    spacing = max(field.spacing, float(np.cbrt(cavity.volume / FLOW_CELLS)))
    return find_flow(cavity, field, guide.centres, 0.0, spacing=spacing)


def _narrowest(route: Route, cavity: Cavity, capsule: Capsule) -> float:
    """Return twice the least clearance of the way, m; near its ends that is to the portal, not to the rock."""
    steps = np.linalg.norm(np.diff(route.points, axis=0), axis=1)
    along = np.append(0.0, np.cumsum(steps))
    near = 2.0 * capsule.length + 0.5 * float(np.sqrt(max(portal.area for portal in cavity.portals)))
    inside = (along > near) & (along < along[-1] - near)
    return 2.0 * float(route.clearance[inside].min() if inside.any() else route.clearance.max())


def is_built(style: str, seed: int) -> bool:
    """Return whether the scenario of a style and a seed lies in the cache."""
    return (named_folder(generated_name(style, seed)) / SETTINGS_FILE).is_file()


def build_generated(style: str, seed: int) -> Path:
    """Build the scenario of a style and a seed into its folder in the cache, unless it lies there; return the folder.

    It is written aside, and moved into its place as a whole: a process that is killed leaves nothing that could be
    taken for a scenario. Others that want the same one wait for it.

    Raises:
        AquanavError: as in `generate`.
    """
    folder = named_folder(generated_name(style, seed))
    if is_built(style, seed):
        mark_used(folder)
        return folder
    work = folder.with_name(folder.name + WORK_SUFFIX)
    with locked(work, waits=True):
        try:
            if not (folder / SETTINGS_FILE).is_file():
                staged = work / "staged"
                shutil.rmtree(staged, ignore_errors=True)  # what a killed process left
                write_scenario(generate(style, seed).scenario, staged)
                shutil.rmtree(folder, ignore_errors=True)  # half a scenario: it has no settings
                os.replace(staged, folder)
                trim_drawn(kept=folder)
        finally:
            shutil.rmtree(work, ignore_errors=True)
    return folder
