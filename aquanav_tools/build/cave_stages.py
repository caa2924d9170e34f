"""The stages every kind of build ends with: from a scanned surface to a scenario."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools import __version__
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.cave.cavity import Cavity, to_manifold
from aquanav_tools.cave.closing import close_surface, from_manifold
from aquanav_tools.cave.distance import choose_spacing, distance_field
from aquanav_tools.cave.enclosure import check_enclosure
from aquanav_tools.cave.field import DistanceField
from aquanav_tools.cave.panels import place_panels
from aquanav_tools.cave.portals import cut_portals, find_openings
from aquanav_tools.cave.route import find_route
from aquanav_tools.cave.starts import draw_starts
from aquanav_tools.cave.statistics import CaveStatistics, ScanFit, measure_cave, measure_fit
from aquanav_tools.cave.surface import choose_voxel, surface_from_cloud, surface_from_mesh
from aquanav_tools.scenario.schema import BuiltBy, GoalSettings, Scenario, ScenarioSettings
from aquanav_tools.sim.vehicle import load_vehicle, vehicle_path
from aquanav_tools.types import Array, Mesh, PointCloud

COLLISION_ERROR_SHARE = 0.05
"""The collision mesh may differ from the cavity by this share of the vehicle's radius."""
FIT_SAMPLES = 50_000
NUM_VIEWPOINTS = 200
MIN_OBSERVED_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class BuiltCave:
    """A finished scenario with what is known about its making."""

    scenario: Scenario
    statistics: CaveStatistics
    fit: ScanFit
    voxel: float
    method: str
    """How the surface was closed: "lids" or "winding"."""
    enclosure: float
    """Median share of the view from roomy places that is scanned wall."""


def build_scenario(scan: Mesh | PointCloud, options: BuildOptions, journal: Journal) -> BuiltCave:
    """Return the scenario in a scan (world frame, metres, z up).

    Raises:
        MeshError: the scan encloses no passage that the vehicle can dive; the message says why.
    """
    vehicle = load_vehicle(options.vehicle)
    capsule = vehicle.capsule
    rng = np.random.default_rng(options.seed)
    with journal.stage("Preparing the surface"):
        voxel = options.closing.voxel or choose_voxel(scan, capsule.radius)
        surface = surface_from_mesh(scan) if isinstance(scan, Mesh) else surface_from_cloud(scan, voxel)
    with journal.stage("Closing the cavity"):
        closed = close_surface(surface, voxel, keep_triangles=isinstance(scan, Mesh))
        openings = find_openings(closed, options.closing.min_portal or 4.0 * capsule.radius)
        cavity = cut_portals(closed, surface, openings, voxel)
    with journal.stage("Measuring distances"):
        field = distance_field(cavity, choose_spacing(cavity, capsule.radius))
        share = check_enclosure(surface, _roomy_places(field, rng), "the middle of the passage")
    with journal.stage("Finding the route"):
        route = find_route(cavity, field, capsule.radius)
        # One vehicle's length from the ends: it must reach the goal without touching the lid behind it.
        guide = place_panels(cavity, field, route, capsule.length, options.panels)
    with journal.stage("Placing the starts"):
        starts = draw_starts(cavity, field, guide, capsule, options.starts, rng)
    with journal.stage("Simplifying the collision mesh"):
        tolerance = COLLISION_ERROR_SHARE * capsule.radius
        collision = _simplify(cavity, tolerance)
        fit = measure_fit(cavity, _sample(scan, rng), voxel)
    settings = ScenarioSettings(
        name=options.name or options.output.resolve().name,
        built=BuiltBy(__version__, options.kind),
        goal=GoalSettings(tuple(float(c) for c in guide.centres[-1])),  # type: ignore[arg-type]
        vehicle=vehicle.name,
        collision_error=tolerance,
    )
    statistics = measure_cave(cavity, field, guide)
    _note_weaknesses(statistics, fit, voxel, journal)
    vehicle_toml = vehicle_path(options.vehicle).read_text(encoding="utf-8")
    scenario = Scenario(settings, cavity, collision, field, guide, starts, vehicle_toml)
    return BuiltCave(scenario, statistics, fit, voxel, closed.method, share)


def _roomy_places(field: DistanceField, rng: np.random.Generator) -> Array:
    """Return up to NUM_VIEWPOINTS (N, 3) places with at least half of the largest clearance, m."""
    indices, clearance = field.water()
    roomy = indices[clearance >= 0.5 * field.max_clearance]
    chosen = np.sort(rng.choice(len(roomy), min(len(roomy), NUM_VIEWPOINTS), replace=False))
    return field.positions(roomy[chosen])


def _simplify(cavity: Cavity, tolerance: float) -> Mesh:
    mesh = from_manifold(to_manifold(cavity.mesh).simplify(tolerance))
    return Mesh(mesh.vertices.astype(np.float32).astype(np.float64), mesh.faces)


def _sample(scan: Mesh | PointCloud, rng: np.random.Generator) -> np.ndarray:
    points = scan.vertices if isinstance(scan, Mesh) else scan.points
    return points[np.sort(rng.choice(len(points), min(len(points), FIT_SAMPLES), replace=False))]


def _note_weaknesses(statistics: CaveStatistics, fit: ScanFit, voxel: float, journal: Journal) -> None:
    if statistics.observed_share < MIN_OBSERVED_SHARE:
        journal.warn(
            "unobserved-wall",
            f"Only {statistics.observed_share:.0%} of the wall was seen by the scan; the rest was filled in. Scan the "
            "missing parts, or treat clearance there with care.",
        )
    if fit.percentile_95 > voxel:
        journal.warn(
            "loose-fit",
            f"5 % of the scan's points lie farther than {fit.percentile_95:.3f} m from the cavity (a voxel is "
            f"{voxel:.3f} m). Noise, stray objects or thin walls were smoothed away; look at the picture.",
        )
    if statistics.num_portals < 2:
        journal.warn(
            "few-portals",
            f"{statistics.num_portals} open ends were found, so the goal is the farthest place inside the cave. If the "
            "passage goes on, check that the scan is open there, or lower --min-portal.",
        )
