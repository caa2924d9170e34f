"""The stages every kind of build ends with: from a scanned surface to a scenario."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import cKDTree

from aquanav_tools import __version__
from aquanav_tools.build.accept_open import accepting, median_occlusion, noting_guesswork, surface_of
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.build.time_stage import note_time
from aquanav_tools.build.water_stage import find_currents, water_settings
from aquanav_tools.build.weaknesses import MAX_MEDIAN_VOXELS, note_weaknesses
from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.cave.centreline.find import find_centreline
from aquanav_tools.cave.closing.ambient_occlusion import check_is_hollow
from aquanav_tools.cave.closing.collision import CollisionMesh, collision_mesh
from aquanav_tools.cave.closing.free_space import NONE_KNOWN, FreeSpace
from aquanav_tools.cave.closing.portals import Cut
from aquanav_tools.cave.closing.reconstruct import ClosedScan, ReconstructionOptions, close_scan
from aquanav_tools.cave.closing.solid import ClosedSurface
from aquanav_tools.cave.measure.statistics import CaveStatistics, ScanFit, measure_cave, measure_fit
from aquanav_tools.cave.route.guide import Guide
from aquanav_tools.cave.route.panels import place_panels
from aquanav_tools.cave.route.passability import Passability, measure_passability
from aquanav_tools.cave.route.route import find_route
from aquanav_tools.cave.route.starts import Start, draw_starts
from aquanav_tools.cave.scan.resolution import Resolution, choose_resolution
from aquanav_tools.cave.scan.surface import Surface
from aquanav_tools.cave.water.flow import Flow
from aquanav_tools.errors import InputError, MeshError
from aquanav_tools.geometry.mesh.handles import Handle, find_handles
from aquanav_tools.geometry.volume.distance import choose_spacing, distance_field
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.geometry.volume.geodesic import WaterGraph
from aquanav_tools.scenario.schema import BuiltBy, GoalSettings, LimitSettings, Scenario, ScenarioSettings
from aquanav_tools.sim.vehicle import load_vehicle, vehicle_path
from aquanav_tools.store import StageStore
from aquanav_tools.text_files import read_text
from aquanav_tools.types import Array, BoolArray, Capsule, Mesh, PointCloud
from aquanav_tools.values import kept_value

COLLISION_ERROR_SHARE = 0.05
"""The collision mesh may differ from the cavity by this share of the vehicle's radius."""
FIT_SAMPLES = 50_000
NUM_VIEWPOINTS = 200
MAX_CUT_SHARE = 0.5
"""Cuts that take away more of the water than this are warned of."""
VOXELS_OF_MISFIT = 5.0
"""Relief and noise look alike before closing. Where half of the scan then turns out to lie farther from the cavity, it
was noise, and the voxel becomes this many times that distance; never larger than the vehicle's radius."""


@dataclass(frozen=True, eq=False)
class BuiltCave:
    """A finished scenario with what is known about its making."""

    scenario: Scenario
    statistics: CaveStatistics
    fit: ScanFit
    resolution: Resolution
    surface: Surface
    """The scan as it was used."""
    closed: ClosedSurface
    occlusion: float
    """Median share of the view from roomy places that is scanned wall."""
    passability: Passability
    handles: tuple[Handle, ...]
    """What one can swim around or through, thinnest first."""
    collision: CollisionMesh

    @property
    def voxel(self) -> float:
        """Resolution of the scan, m."""
        return self.resolution.voxel

    @property
    def method(self) -> str:
        """How the surface was closed: "caps" or "winding"; "made-up" where it was closed from the start."""
        return self.closed.method


@dataclass(frozen=True, eq=False)
class Closing:
    """The cavity in a scan, or a made-up one, and what it was made from."""

    resolution: Resolution
    surface: Surface
    closed: ClosedSurface
    cavity: Cavity


def build_scenario(
    scan: Mesh | PointCloud,
    options: BuildOptions,
    journal: Journal,
    free_space: FreeSpace = NONE_KNOWN,
    measured: Array | None = None,
    store: StageStore | None = None,
) -> BuiltCave:
    """Return the scenario in a scan (world frame, metres, z up).

    Args:
        scan: walls.
        options: settings of the stages.
        journal: collects their cost and what is poor but usable.
        free_space: what is known to be water.
        measured: (N, 3) where the walls were measured, m; everywhere when not given.
        store: keeps the closed cavity, the longest of the stages, for a later run with other routes or starts.

    Raises:
        MeshError: the scan encloses no passage that the vehicle can dive; the message says why.
    """
    closing = _closing(scan, options, journal, load_vehicle(options.vehicle).capsule.radius, free_space, store)
    _note_large_cut(closing, options, journal)
    if measured is not None:
        observed = _near_points(closing.cavity, measured, 2.0 * closing.resolution.voxel)
        closing = replace(closing, cavity=replace(closing.cavity, observed=observed))
    return scenario_in(closing, options, journal, options.kind)


def scenario_in(closing: Closing, options: BuildOptions, journal: Journal, kind: str) -> BuiltCave:
    """Return the scenario in a cavity.

    Args:
        closing: the cavity.
        options: settings of the stages.
        journal: collects their cost and what is poor but usable.
        kind: how the cavity came about, for the scenario's settings.

    Raises:
        MeshError: the vehicle cannot dive it; the message says why.
    """
    vehicle = load_vehicle(options.vehicle)
    rng = np.random.default_rng(options.seed)
    resolution, surface, closed, cavity = closing.resolution, closing.surface, closing.closed, closing.cavity
    with journal.stage("Measuring distances"):
        field = distance_field(cavity.mesh, choose_spacing(cavity.mesh, vehicle.capsule.radius))
        accept = noting_guesswork(journal) if kind == "photos" else accepting(options.closing, journal)
        share = median_occlusion(surface.mesh, _roomy_places(field, rng), accept)
    way = _find_way(cavity, field, vehicle.capsule, options, journal, rng)
    with journal.stage("Tracing the centreline"):
        network = find_centreline(cavity, field)
    with journal.stage("Simplifying the collision mesh"):
        collision = collision_mesh(cavity, COLLISION_ERROR_SHARE * vehicle.capsule.radius)
    with journal.stage("Measuring the cave"):
        fit = measure_fit(cavity, _sample(surface.points, rng), resolution.voxel, closed.mesh)
        statistics = measure_cave(cavity, field, way.guide, [branch.points for branch in network.branches])
        handles = find_handles(cavity.mesh)
    settings = _settings(options, kind, way.guide, vehicle.name, collision)
    toml = read_text(vehicle_path(options.vehicle))
    scenario = Scenario(settings, cavity, collision.mesh, field, way.guide, way.starts, toml, way.flow, network)
    built = BuiltCave(
        scenario, statistics, fit, resolution, surface, closed, share, way.passability, handles, collision
    )
    note_weaknesses(built, options, journal)
    note_time(scenario, journal)
    return built


def with_route(built: BuiltCave, options: BuildOptions, journal: Journal) -> BuiltCave:
    """Return the same cave with another route, and what depends on it: panels, current, starts, goal.

    Args:
        built: the cave with any route.
        options: settings of the stages; their ends of the route and their name are those of the result.
        journal: collects the cost of the stages and what is poor but usable.

    Raises:
        MeshError: the narrowest place between the ends is too tight for the vehicle.
    """
    before, rng = built.scenario, np.random.default_rng(options.seed)
    way = _find_way(before.cavity, before.field, load_vehicle(options.vehicle).capsule, options, journal, rng)
    with journal.stage("Measuring the cave"):
        branches = [branch.points for branch in before.network.branches]
        statistics = measure_cave(before.cavity, before.field, way.guide, branches)
    settings = _settings(options, before.settings.built.kind, way.guide, before.settings.vehicle, built.collision)
    scenario = replace(before, settings=settings, guide=way.guide, starts=way.starts, flow=way.flow, content_hash="")
    along = replace(built, scenario=scenario, statistics=statistics, passability=way.passability)
    note_weaknesses(along, options, journal)
    note_time(scenario, journal)
    return along


@dataclass(frozen=True, eq=False)
class _Way:
    """All of a scenario that depends on where its route leads."""

    guide: Guide
    passability: Passability
    flow: Flow | None
    starts: tuple[Start, ...]


def _find_way(
    cavity: Cavity,
    field: DistanceField,
    capsule: Capsule,
    options: BuildOptions,
    journal: Journal,
    rng: np.random.Generator,
) -> _Way:
    with journal.stage("Finding the route"):
        graph = WaterGraph(field, capsule.radius)
        guide = _find_guide(cavity, field, graph, capsule, options)
        passability = measure_passability(cavity, field, guide.centreline, 2.0 * capsule.radius)
    flow = find_currents(cavity, field, guide, options.water, journal)
    with journal.stage("Placing the starts"):
        starts = draw_starts(cavity, field, guide, capsule, options.starts, rng, graph)
    return _Way(guide, passability, flow, starts)


def _note_large_cut(closing: Closing, options: BuildOptions, journal: Journal) -> None:
    """Warn where the user's cuts take most of the cave: a direction may be the wrong way round."""
    share = 1.0 - closing.cavity.volume / closing.closed.mesh.volume
    if options.closing.cut and share > MAX_CUT_SHARE:
        sentence = (
            f"The cuts take away {share:.0%} of the water. The last three numbers of a cut point towards the part that "
            "goes; turn them round if the wrong one went."
        )
        journal.announce(f"Look (large-cut): {sentence}")
        journal.warn("large-cut", sentence)


def _find_guide(
    cavity: Cavity, field: DistanceField, graph: WaterGraph, capsule: Capsule, options: BuildOptions
) -> Guide:
    """Return the panels along the way from the entrance to the goal."""
    ends = (_place(options.route.entrance, cavity), _place(options.route.goal, cavity))
    route = find_route(cavity, field, capsule.radius, *ends, graph)
    # One vehicle's length from the ends: it must reach the goal without touching the lid behind it.
    return place_panels(cavity, field, route, capsule.length, options.panels, capsule.radius)


def _settings(
    options: BuildOptions, kind: str, guide: Guide, vehicle: str, collision: CollisionMesh
) -> ScenarioSettings:
    """Return what the scenario says of itself; its goal is the last panel."""
    return ScenarioSettings(
        name=options.title,
        built=BuiltBy(__version__, kind),
        goal=GoalSettings(tuple(float(c) for c in guide.centres[-1])),  # type: ignore[arg-type]
        vehicle=vehicle,
        water=water_settings(options.water),
        limits=LimitSettings(decisions=options.decisions),
        collision_error=collision.bound,
    )


def _closing(
    scan: Mesh | PointCloud,
    options: BuildOptions,
    journal: Journal,
    vehicle_radius: float,
    free_space: FreeSpace,
    store: StageStore | None,
) -> Closing:
    """Return what `_close` returns, from the store where it is kept there."""
    if store is None:
        return _close(scan, options, journal, vehicle_radius, free_space)
    inputs = (scan, free_space, options.closing, vehicle_radius, options.seed)
    with store.open("closed", _close, *inputs) as folder:
        return kept_value(
            Closing, folder / "closed.npz", lambda: _close(scan, options, journal, vehicle_radius, free_space)
        )


def _close(
    scan: Mesh | PointCloud, options: BuildOptions, journal: Journal, vehicle_radius: float, free_space: FreeSpace
) -> Closing:
    """Return the cavity in a scan, and what it was made from; once more and coarser where noise asks for it."""
    given = np.array(options.closing.inside).reshape(-1, 3)
    free_space = replace(free_space, inside=np.concatenate([free_space.inside, given]))
    min_portal = options.closing.min_portal or 4.0 * vehicle_radius
    with journal.stage("Choosing the resolution"):
        resolution = choose_resolution(scan, vehicle_radius, options.closing.memory, options.closing.voxel)
    found = _close_at(resolution, scan, options, journal, min_portal, free_space)
    points = _sample(found.surface.points, np.random.default_rng(options.seed))
    misfit = measure_fit(found.cavity, points, resolution.voxel, found.closed.mesh).median
    coarser = VOXELS_OF_MISFIT * misfit
    is_loose = misfit > MAX_MEDIAN_VOXELS * resolution.voxel
    if is_loose and options.closing.voxel is None and coarser <= vehicle_radius:
        resolution = replace(resolution, voxel=coarser, reason="the noise that a first, finer surface showed")
        found = _close_at(resolution, scan, options, journal, min_portal, free_space)
    return Closing(resolution, found.surface, found.closed, found.cavity)


def _close_at(
    resolution: Resolution,
    scan: Mesh | PointCloud,
    options: BuildOptions,
    journal: Journal,
    min_portal: float,
    free_space: FreeSpace,
) -> ClosedScan:
    """Return the cavity in a scan at a resolution, and what it was made from."""
    journal.announce(
        f"Closing at {1000 * resolution.voxel:.0f} mm ({resolution.reason}); this takes about "
        f"{resolution.memory_gb:.1f} GB of the {options.closing.memory:.1f} GB allowed."
    )
    with journal.stage("Preparing the surface"):
        voxel = resolution.voxel
        lamps = np.concatenate([free_space.inside, free_space.legs.mean(axis=1)])
        surface = surface_of(scan, voxel, lamps, accepting(options.closing, journal))
    with journal.stage("Closing the cavity") as progress:
        how = ReconstructionOptions(
            voxel,
            min_portal,
            keep_triangles=isinstance(scan, Mesh),
            cuts=tuple(_cut(plane) for plane in options.closing.cut),
            accept_open=options.closing.accept_open,
        )
        found = close_scan(surface, how, free_space, progress)
        if not len(free_space.inside) and not len(free_space.legs):
            check_is_hollow(found.cavity, float(found.closed.is_scan.mean()))
    return found


def _near_points(cavity: Cavity, points: Array, distance: float) -> BoolArray:
    """Return the (F,) flags of wall with one of some points within a distance (m) of it."""
    nearest, _ = cKDTree(points).query(cavity.mesh.triangles.mean(axis=1))
    return np.asarray((nearest <= distance) & (cavity.labels == WALL))


def _cut(plane: tuple[float, ...]) -> Cut:
    normal = np.array(plane[3:])
    return Cut(np.array(plane[:3]), normal / np.linalg.norm(normal))


def _place(text: str, cavity: Cavity) -> Array | None:
    """Return the place that a portal's label or a point "X,Y,Z" names; None for an empty text.

    Raises:
        InputError: there is no such portal, or the text is neither.
    """
    if not text:
        return None
    parts = text.replace(",", " ").split()
    try:
        numbers = [float(part) for part in parts]
    except ValueError:
        numbers = []
    if len(numbers) == 3 and np.isfinite(numbers).all():
        return np.array(numbers)
    if len(numbers) == 1:
        for portal in cavity.portals:
            if portal.label == numbers[0]:
                return portal.centre
        known = ", ".join(f"{portal.label} at {portal.centre.round(1)}" for portal in cavity.portals)
        raise InputError(f"There is no portal {text}. There are: {known or 'none'}.")
    raise InputError(f"'{text}' is neither the label of a portal nor a point X,Y,Z in metres.")


def _roomy_places(field: DistanceField, rng: np.random.Generator) -> Array:
    """Return up to NUM_VIEWPOINTS (N, 3) places with at least half of the largest clearance, m.

    Raises:
        MeshError: no sample lies in water.
    """
    indices, clearance = field.water()
    if not len(indices):
        raise MeshError(
            f"The water is nowhere as wide as the distance between two samples, {field.spacing:.2g} m: no vehicle of "
            "that size fits in. Check --unit, or choose a smaller vehicle with --vehicle."
        )
    roomy = indices[clearance >= 0.5 * field.max_clearance]
    chosen = np.sort(rng.choice(len(roomy), min(len(roomy), NUM_VIEWPOINTS), replace=False))
    return field.positions(roomy[chosen])


def _sample(points: Array, rng: np.random.Generator) -> Array:
    return points[np.sort(rng.choice(len(points), min(len(points), FIT_SAMPLES), replace=False))]
