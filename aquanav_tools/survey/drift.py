"""A survey beside a scan: do they agree, does their difference grow along the way, and what would make them fit.

The survey is taken to be in the scan's coordinates up to a small error: turned or shifted by less than about half the
passage's width, the ends of its splays find the right walls. Farther off, give the pose that brings it there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.survey.model import StationFlag, Survey
from aquanav_tools.survey.passage_graph import PassageGraph, passage_graph
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh, Sim3

MIN_SPLAYS = 20
"""Fewer ends of splays than this do not hold the seven numbers of a similarity."""
MAX_ITERATIONS = 60
CONVERGED = 1e-7
"""The fit has settled when no corner of the survey moves by more than this share of its size."""
ROBUST_SPREADS = 2.5
"""A splay that misses the wall by this many times the usual spread counts half as much (Geman-McClure)."""
MIN_SPREAD = 0.01
"""Least spread, m: a laser's own error. Keeps a perfect fit from trusting only its best points."""
DAMPING = 1e-6
"""Share of the normal equations' mean diagonal added to it: a direction in which a smooth tube slides freely stays."""
MIN_AT_STATION = 6
"""With this many splays a station's own shift is found: twice as many as it has numbers."""
SHIFT_ITERATIONS = 8
SHIFT_DAMPING = 0.02
"""As DAMPING, for the shift of one station: the few splays of a straight tube hold nothing along it but noise."""

IDENTITY = Sim3(1.0, np.eye(3), np.zeros(3))


@dataclass(frozen=True, eq=False)
class DriftReport:
    """How a survey and a scan agree."""

    num_stations: int
    stations_outside: tuple[str, ...]
    """Names of stations under ground that are not inside the scan."""
    num_legs: int
    blocked_legs: tuple[tuple[str, str], ...]
    """Names of both stations of each leg that crosses a wall of the scan."""
    num_splays: int
    median_residual: float
    """Median distance from the ends of splays to the scan, m."""
    p95_residual: float
    """95 % of the splays end within this distance of the scan, m."""
    drift_per_100_m: float
    """Growth, per 100 m of survey from its first entrance, of the shift that brings each station's splays onto the
    wall, m; slope by Theil and Sen. A shift along a smooth passage cannot be seen and counts as none."""
    fit: Sim3
    """What brings the survey onto the scan best."""
    median_after_fit: float
    """Median distance after that, m."""

    @property
    def scan_scale(self) -> float:
        """What to multiply the scan by, so that its lengths are those of the survey."""
        return 1.0 / self.fit.scale

    @property
    def up(self) -> Array:
        """(3,) unit vector, in the scan's coordinates, that is up by the survey."""
        column: Array = self.fit.rotation[:, 2]
        return column

    @property
    def tilt(self) -> float:
        """Angle between the scan's up and the survey's, rad."""
        return float(np.arccos(np.clip(self.up[2], -1.0, 1.0)))

    @property
    def yaw(self) -> float:
        """Angle by which the survey is turned about up to meet the scan, rad, anticlockwise seen from above."""
        return float(np.arctan2(self.fit.rotation[1, 0], self.fit.rotation[0, 0]))


def check_drift(survey: Survey, mesh: Mesh, start: Sim3 = IDENTITY) -> DriftReport:
    """Compare a survey with the scan of the same cave.

    Args:
        survey: with splays under ground.
        mesh: the scan's surface or the cavity made of it, m.
        start: mesh_from_survey, as well as it is known; residuals are measured after it.

    Raises:
        InputError: the survey has no legs under ground, or too few splays.
    """
    graph = passage_graph(survey)
    splays = [splay for splay in survey.splays if graph.node_of[splay.start] >= 0]
    if len(splays) < MIN_SPLAYS:
        raise InputError(
            f"The survey '{survey.title}' has {len(splays)} splays; to hold it against a scan takes "
            f"at least {MIN_SPLAYS}. Shoot some to the walls at each station."
        )
    ends = survey.positions[[splay.end for splay in splays]]
    nodes = graph.node_of[[splay.start for splay in splays]]
    residuals = _to_wall(mesh, start.apply(ends))[0]
    fit = fit_similarity(ends, mesh, start)
    return DriftReport(
        num_stations=len(graph.nodes),
        stations_outside=_names(survey, graph, ~_is_inside(mesh, start.apply(graph.nodes))),
        num_legs=len(graph.legs),
        blocked_legs=_blocked(survey, graph, mesh, start),
        num_splays=len(splays),
        median_residual=float(np.median(residuals)),
        p95_residual=float(np.percentile(residuals, 95)),
        drift_per_100_m=100.0 * _trend(_way_from_entrance(survey, graph), nodes, start.apply(ends), mesh),
        fit=fit,
        median_after_fit=float(np.median(_to_wall(mesh, fit.apply(ends))[0])),
    )


def fit_similarity(points: Array, mesh: Mesh, start: Sim3 = IDENTITY) -> Sim3:
    """Return the similarity that brings (K, 3) points onto a surface best, from a start nearby.

    Iterated closest points, point to plane, all seven numbers at once, with a robust weight for each point.

    Source: Chen and Medioni, Object modelling by registration of multiple range images (1992); weights of Geman and
    McClure (1987) with the spread from the median absolute deviation.
    """
    fit = start
    for _ in range(MAX_ITERATIONS):
        moved = fit.apply(points)
        centre, size = moved.mean(axis=0), max(float(np.ptp(moved, axis=0).max()), 1e-9)
        _, nearest, normals = _to_wall(mesh, moved)
        gap = np.einsum("ki,ki->k", moved - nearest, normals)
        spread = max(1.4826 * float(np.median(np.abs(gap))), MIN_SPREAD)
        weights = 1.0 / (1.0 + (gap / (ROBUST_SPREADS * spread)) ** 2) ** 2
        arm = (moved - centre) / size
        turns = np.cross(arm, normals)
        rows = np.column_stack([turns, normals, np.einsum("ki,ki->k", arm, normals)])
        matrix = rows.T @ (weights[:, None] * rows)
        matrix += DAMPING * np.trace(matrix) / 7.0 * np.eye(7)
        step = np.linalg.solve(matrix, -rows.T @ (weights * gap))
        fit = _moved(fit, step[:3] / size, step[3:6], 1.0 + step[6] / size, centre)
        if np.abs(step).max() < CONVERGED * size:
            break
    return fit


def _moved(fit: Sim3, turn: Array, shift: Array, growth: float, centre: Array) -> Sim3:
    """Return the fit followed by a turn (rotation vector), a growth about a centre, and a shift."""
    from scipy.spatial.transform import Rotation

    rotation = Rotation.from_rotvec(turn).as_matrix()
    translation = growth * rotation @ (fit.translation - centre) + centre + shift
    return Sim3(fit.scale * growth, rotation @ fit.rotation, translation)


def _to_wall(mesh: Mesh, points: Array) -> tuple[Array, Array, Array]:
    """Return the (K,) distance to the surface, the (K, 3) nearest place on it and the (K, 3) normal there."""
    import igl

    squared, faces, nearest = igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces)[:3]
    return np.sqrt(np.asarray(squared)), np.asarray(nearest), mesh.normals[np.asarray(faces)]


def _is_inside(mesh: Mesh, points: Array) -> BoolArray:
    """Return whether points are inside, also where the surface has holes and whichever way round it is wound."""
    import igl

    winding = np.asarray(igl.fast_winding_number(mesh.vertices, mesh.faces, points))
    inside: BoolArray = np.abs(winding) > 0.5
    return inside


def _blocked(survey: Survey, graph: PassageGraph, mesh: Mesh, start: Sim3) -> tuple[tuple[str, str], ...]:
    """Return the names of the stations at both ends of each leg that crosses the surface."""
    ends = start.apply(graph.segments.reshape(-1, 3)).reshape(-1, 2, 3)
    along = ends[:, 1] - ends[:, 0]
    lengths = np.linalg.norm(along, axis=1)
    rays = mesh.to_trimesh().ray
    places, which, _ = rays.intersects_location(ends[:, 0], along / lengths[:, None], multiple_hits=False)
    is_blocked = np.zeros(len(ends), dtype=bool)
    is_blocked[which] = np.linalg.norm(places - ends[which, 0], axis=1) < lengths[which]
    names = _name_of_node(survey, graph)
    return tuple((names[a], names[b]) for a, b in graph.legs[is_blocked].tolist())


def _names(survey: Survey, graph: PassageGraph, chosen: BoolArray) -> tuple[str, ...]:
    names = _name_of_node(survey, graph)
    return tuple(names[node] for node in np.flatnonzero(chosen).tolist())


def _name_of_node(survey: Survey, graph: PassageGraph) -> dict[int, str]:
    names: dict[int, str] = {}
    for station, node in zip(survey.stations, graph.node_of.tolist(), strict=True):
        if node >= 0 and (station.name or node not in names):
            names.setdefault(node, station.name)
            names[node] = names[node] or station.name
    return names


def _way_from_entrance(survey: Survey, graph: PassageGraph) -> Array:
    """Return the (N,) length of the way along the legs from the first entrance, else the first fixed station, m."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import dijkstra

    wanted = [StationFlag.ENTRANCE, StationFlag.FIXED, StationFlag.UNDERGROUND]
    roots = [
        int(node)
        for flag in wanted
        for station, node in zip(survey.stations, graph.node_of, strict=True)
        if node >= 0 and station.flags & flag
    ]
    count = len(graph.nodes)
    links = coo_matrix((graph.lengths, graph.legs.T), shape=(count, count))
    way: Array = dijkstra(links, directed=False, indices=roots[0] if roots else 0)
    return way


def _trend(way: Array, nodes: IntArray, ends: Array, mesh: Mesh) -> float:
    """Return how much the stations' shifts grow per metre of way (Theil-Sen slope)."""
    from scipy.stats import theilslopes

    known = np.flatnonzero(np.bincount(nodes, minlength=len(way)) >= MIN_AT_STATION)
    if len(known) < 3:
        return 0.0
    kept = np.isin(nodes, known)
    shifts = np.linalg.norm(_shifts(np.searchsorted(known, nodes[kept]), ends[kept], mesh), axis=1)
    return float(theilslopes(shifts, way[known])[0])


def _shifts(group: IntArray, points: Array, mesh: Mesh) -> Array:
    """Return the (G, 3) shift of each group of points that brings it onto the surface best, m."""
    count = int(group.max()) + 1
    shifts = np.zeros((count, 3))
    for _ in range(SHIFT_ITERATIONS):
        moved = points + shifts[group]
        _, nearest, normals = _to_wall(mesh, moved)
        gap = np.einsum("ki,ki->k", moved - nearest, normals)
        spread = max(1.4826 * float(np.median(np.abs(gap))), MIN_SPREAD)
        weights = 1.0 / (1.0 + (gap / (ROBUST_SPREADS * spread)) ** 2) ** 2
        matrices, rights = np.zeros((count, 3, 3)), np.zeros((count, 3, 1))
        np.add.at(matrices, group, weights[:, None, None] * normals[:, :, None] * normals[:, None, :])
        np.add.at(rights, group, (weights * gap)[:, None, None] * normals[:, :, None])
        damping = SHIFT_DAMPING / 3.0 * np.trace(matrices, axis1=1, axis2=2)
        matrices += damping[:, None, None] * np.eye(3)
        shifts = shifts - np.linalg.solve(matrices, rights)[:, :, 0]
    return shifts
