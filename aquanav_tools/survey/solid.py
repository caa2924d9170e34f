"""A survey alone becomes a cave: what was measured of its walls, drawn around its legs.

The rules, which the README of a build should tell its user:

- A wall point (the end of a splay, or left, right, up, down) counts for the leg it lies beside, as a distance from that
  leg. A long shot down the passage so widens nothing: it says how wide the passage is where it ended.
- A wall point that is LONG_SHOT times as far from every leg as the upper quartile of its station's points looked into a
  passage that was not surveyed; it is cut to that distance.
- Between wall points the wall is a weighted mean (shapes.py), creases are rounded by about a voxel (sculpt.py).
- No wall is closer to a leg than MIN_RADIUS: a passage that was surveyed is never sealed, and that is proven.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.cavity import from_manifold, prove_watertight, to_manifold
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.mesh.intersections import self_intersections
from aquanav_tools.survey.model import Station, StationFlag, Survey
from aquanav_tools.survey.passage_graph import PassageGraph, passage_graph
from aquanav_tools.survey.sculpt import sculpt
from aquanav_tools.survey.shapes import DEFAULT_RADIUS, MIN_RADIUS, Core, Shape, axes_across, bells, tubes, widths
from aquanav_tools.survey.walls import pair_with_legs, wall_points
from aquanav_tools.types import Array, BoolArray, Mesh

VOXEL = 0.2
"""Spacing of the grid the surface is drawn on, m: finer than the spacing of any splays."""
SIMPLIFY_VOXELS = (0.05, 0.02, 0.005)
"""Triangles are merged where that moves the surface by no more than this, voxels; the first without crossing faces."""
ENTRANCE_MARGIN = 0.1
"""The passage is cut this far outside an entrance's station, m, so that the station stays in the water."""

ON_PLANE = 1e-4
"""Faces whose corners are this close to an entrance's plane are the cut, m."""


@dataclass(frozen=True, eq=False)
class EntrancePlane:
    """Where the passage is cut open."""

    name: str
    point: Array
    """(3,) m."""
    normal: Array
    """(3,) unit vector out of the cave."""
    reach: float
    """How far the passage can extend from the point, m."""


@dataclass(frozen=True, eq=False)
class SurveyCave:
    """The solid made of a survey."""

    mesh: Mesh
    """Closed and proven; flat at the entrances. Its shape between wall points is a model, not a measurement."""
    legs: Array
    """(M, 2, 3) centreline, all inside, m."""
    stations: Array
    """(N, 3) its stations, all inside, m."""
    entrances: tuple[EntrancePlane, ...]
    num_wall_points: int
    """How many points of the wall were measured."""
    median_misfit: float
    """Median distance from the measured wall points to the solid's wall, m; NaN without any."""
    p95_misfit: float
    """95 % of the wall points are within this distance of the solid's wall, m. Long shots are among the others."""
    measured_share: float
    """Share of the centreline's length whose both ends have wall points of their own."""
    genus: int
    """Number of handles of the surface."""
    num_loops: int
    """Number of independent loops of the survey; where passages run into each other there are fewer handles."""
    warnings: tuple[str, ...]

    @property
    def open_surface(self) -> Mesh:
        """The wall alone, open at the entrances: what a scan of this cave would be."""
        corners = self.mesh.triangles
        is_lid = np.zeros(len(corners), dtype=bool)
        for plane in self.entrances:
            is_flat = (np.abs((corners - plane.point) @ plane.normal) < ON_PLANE).all(axis=1)
            is_lid |= is_flat & (np.linalg.norm(corners - plane.point, axis=2) < 2.0 * plane.reach).all(axis=1)
        return Mesh(self.mesh.vertices, self.mesh.faces[~is_lid])


def survey_solid(survey: Survey, voxel: float = VOXEL) -> SurveyCave:
    """Return the cave that a survey's legs, splays and passage dimensions describe.

    Raises:
        InputError: the survey has no legs under ground.
        MeshError: the pieces do not join into one closed solid with every leg inside.
    """
    graph = passage_graph(survey)
    walls = wall_points(survey, graph)
    pairs = pair_with_legs(walls, graph)
    mean, longest, is_measured = widths(walls, pairs, graph)
    pieces = tubes(walls, pairs, graph, mean, longest)
    rounded: list[Shape] = [*pieces, *bells(walls, pairs, graph, pieces, longest)]
    cores = [Core(piece.start, piece.end) for piece in pieces]
    planes = _entrance_planes(survey, graph, longest)
    mesh, genus = _opened(sculpt(rounded, cores, voxel), planes, voxel)
    prove_watertight(mesh)
    _prove_open(mesh, graph)
    both = is_measured[graph.legs].all(axis=1)
    share = float(graph.lengths[both].sum() / graph.lengths.sum())
    warnings = _warnings(survey, graph, is_measured, planes)
    return SurveyCave(
        mesh,
        graph.segments,
        graph.nodes,
        planes,
        len(walls.points),
        *_misfit(mesh, walls.points),
        share,
        genus,
        len(graph.legs) - len(graph.nodes) + 1,
        (*survey.warnings, *warnings),
    )


def _entrance_planes(survey: Survey, graph: PassageGraph, longest: Array) -> tuple[EntrancePlane, ...]:
    """Return the planes at entrances; where none is marked, where legs on the surface meet legs under ground."""
    at_node: dict[int, StationFlag] = {}
    for station, node in zip(survey.stations, graph.node_of.tolist(), strict=True):
        at_node[node] = at_node.get(node, StationFlag.NONE) | station.flags
    both = StationFlag.SURFACE | StationFlag.UNDERGROUND
    marked = [index for index, station in enumerate(survey.stations) if station.flags & StationFlag.ENTRANCE]
    guessed = [index for index, node in enumerate(graph.node_of.tolist()) if at_node[node] & both == both]
    planes: dict[int, EntrancePlane] = {}
    for index in marked or guessed:
        node = int(graph.node_of[index])
        if node >= 0 and node not in planes:
            planes[node] = _plane(survey.stations[index], graph, node, float(longest[node]))
    return tuple(planes.values())


def _plane(station: Station, graph: PassageGraph, node: int, reach: float) -> EntrancePlane:
    inwards = graph.neighbours(node) - graph.nodes[node]
    inwards = (inwards / np.linalg.norm(inwards, axis=1, keepdims=True)).mean(axis=0)
    size = float(np.linalg.norm(inwards))
    normal = -inwards / size if size > 0.1 else np.array([0.0, 0.0, 1.0])
    return EntrancePlane(station.name, graph.nodes[node] + ENTRANCE_MARGIN * normal, normal, reach)


def _opened(surface: Mesh, planes: tuple[EntrancePlane, ...], voxel: float) -> tuple[Mesh, int]:
    """Return the largest piece of the solid, cut at the entrances, and its genus."""
    solid = to_manifold(surface)
    for plane in planes:
        solid = solid - _outside(plane)
    # Pieces of negative volume are pockets of rock that tubes enclose; no survey can have measured one.
    pieces = sorted(solid.decompose(), key=lambda piece: -piece.volume())
    if not pieces:
        raise MeshError("The tubes along the survey's legs enclose no space. Check the survey's scale.")
    return _simplified(pieces[0], voxel), int(pieces[0].genus())


def _simplified(solid, voxel: float) -> Mesh:  # type: ignore[no-untyped-def]  # manifold3d ships no types
    """Return the solid with as few triangles as can be had without faces that cross."""
    for share in SIMPLIFY_VOXELS:
        mesh = from_manifold(solid.simplify(share * voxel))
        if not len(self_intersections(mesh)):
            return mesh
    return from_manifold(solid)


def _outside(plane: EntrancePlane):  # type: ignore[no-untyped-def]  # manifold3d ships no types
    """Return a block on the outer side of an entrance's plane, as large as the passage can be there."""
    import manifold3d

    side, _ = axes_across(plane.normal)
    size = 2.0 * plane.reach
    block = manifold3d.Manifold.cube([size, size, size]).translate([-size / 2, -size / 2, 0.0])
    world_from_block = np.column_stack([side, np.cross(plane.normal, side), plane.normal, plane.point])
    return block.transform(world_from_block)


def _prove_open(mesh: Mesh, graph: PassageGraph) -> None:
    """Check that every leg lies inside the solid.

    Raises:
        MeshError: some does not; the message says where.
    """
    import igl

    count = int(np.ceil(graph.lengths.max() / (0.5 * MIN_RADIUS))) + 1
    share = np.linspace(0.0, 1.0, count)[:, None, None]
    samples = ((1.0 - share) * graph.segments[:, 0] + share * graph.segments[:, 1]).reshape(-1, 3)
    inside = np.asarray(igl.fast_winding_number(mesh.vertices, mesh.faces, samples)) > 0.5
    if not inside.all():
        place = samples[np.flatnonzero(~inside)[0]].round(1).tolist()
        raise MeshError(
            f"{(~inside).mean():.1%} of the survey's legs lie outside the cave made of it, the first place is {place}. "
            "An entrance's plane may cut another passage: mark entrances at the ends of legs only."
        )


def _misfit(mesh: Mesh, points: Array) -> tuple[float, float]:
    import igl

    if not len(points):
        return float("nan"), float("nan")
    gaps = np.sqrt(np.asarray(igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces)[0]))
    return float(np.median(gaps)), float(np.percentile(gaps, 95))


def _warnings(
    survey: Survey, graph: PassageGraph, is_measured: BoolArray, planes: tuple[EntrancePlane, ...]
) -> list[str]:
    warnings = []
    if not is_measured.all():
        warnings.append(
            f"{int((~is_measured).sum())} of {len(is_measured)} stations have neither splays nor passage dimensions; "
            + (
                "the width there runs evenly between those of the stations that have."
                if is_measured.any()
                else f"the passage is drawn {2.0 * DEFAULT_RADIUS:g} m wide everywhere."
            )
        )
    if graph.others:
        warnings.append(
            f"{len(graph.others)} parts of the survey hang together with the rest by no leg under ground and were left "
            f"out, those of: {', '.join(graph.others)}."
        )
    if not planes:
        warnings.append("No station is marked as an entrance, so the cave has no opening. Add *entrance or cut one.")
    return warnings
