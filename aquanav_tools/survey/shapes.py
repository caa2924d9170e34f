"""The pieces a surveyed cave is made of: a tube along each leg, a bell at each station.

Around a leg, the wall's distance at each angle and place is the mean of the logarithms of the distances measured near
there, with Gaussian weights over angle and along the leg. Where nothing was measured it tends to the width at the two
stations. A bell is the same over directions from a station: it closes dead ends and fills bends.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from aquanav_tools.survey.passage_graph import PassageGraph
from aquanav_tools.survey.walls import WallPairs, WallPoints, nearest_pairs
from aquanav_tools.types import Array, BoolArray

MIN_RADIUS = 0.3
"""Least distance from a leg to the wall, m: surveyed passages were passed by people, who need about 0.6 m."""
DEFAULT_RADIUS = 1.0
"""Where nothing at all was measured, m: the width of an ordinary passage; always comes with a warning."""
LONG_SHOT = 3.0
"""A wall point is believed up to this multiple of the upper quartile of the distances seen from its station."""
ANGLE_SPREAD = float(np.radians(20.0))
"""Width of the Gaussian over angles: shots around a station are some 25 degrees apart (14 of them, median in Tatra)."""
ALONG_SHARE = 0.35
"""Width of the Gaussian along a leg, as a share of its length: each end decides its third."""
MIN_ALONG = 0.5
"""Least width of the Gaussian along a leg, m."""
PRIOR_WEIGHT = 0.1
"""Weight of the width at the station against one wall point straight at hand."""
RING_SPACING = 0.5
"""Distance between sections of a tube, m."""
RING_POINTS = 36
BESIDE = 1.5
"""A wall point counts for legs up to this many times farther than its nearest one, so that tubes blend."""


class Shape(Protocol):
    """A piece of water."""

    @property
    def low(self) -> Array:
        """(3,) lower corner of a box around it, m."""

    @property
    def high(self) -> Array:
        """(3,) upper corner of a box around it, m."""

    def distance(self, points: Array) -> Array:
        """Return about how far (K, 3) points are from its surface, (K,) m, negative inside."""


@dataclass(frozen=True, eq=False)
class Tube:
    """Water around one leg."""

    start: Array
    end: Array
    radius: Array
    """(R, RING_POINTS) distance of the wall, by place along the leg and angle, m."""

    @property
    def low(self) -> Array:
        """Lower corner of a box around it."""
        corner: Array = np.minimum(self.start, self.end) - self.radius.max()
        return corner

    @property
    def high(self) -> Array:
        """Upper corner of a box around it."""
        corner: Array = np.maximum(self.start, self.end) + self.radius.max()
        return corner

    def distance(self, points: Array) -> Array:
        """Return about how far points are from the wall, negative inside; flat beyond the ends."""
        along, across, angle = _cylindrical(points, self.start, self.end)
        length = float(np.linalg.norm(self.end - self.start))
        row = np.clip(along / length, 0.0, 1.0) * (len(self.radius) - 1)
        column = angle / (2.0 * np.pi) * RING_POINTS
        beyond = np.maximum(-along, along - length)
        return np.maximum(across - _at(self.radius, row, column), beyond)


@dataclass(frozen=True, eq=False)
class Bell:
    """Water around one station."""

    centre: Array
    directions: Array
    """(D, 3) unit vectors."""
    radius: Array
    """(D,) distance of the wall in each direction, m."""

    @property
    def low(self) -> Array:
        """Lower corner of a box around it."""
        corner: Array = self.centre - self.radius.max()
        return corner

    @property
    def high(self) -> Array:
        """Upper corner of a box around it."""
        corner: Array = self.centre + self.radius.max()
        return corner

    def distance(self, points: Array) -> Array:
        """Return about how far points are from the wall, negative inside."""
        from scipy.spatial import cKDTree

        offset = points - self.centre
        size = np.linalg.norm(offset, axis=1)
        low, high = self.radius.min(), self.radius.max()
        distance = np.where(size < low, size - low, size - high)
        unsure = np.flatnonzero((size >= low) & (size <= high))
        directions = offset[unsure] / np.maximum(size[unsure], 1e-9)[:, None]
        gap, near = cKDTree(self.directions).query(directions, k=3)
        weights = 1.0 / np.maximum(gap, 1e-3)
        radius: Array = (weights * self.radius[near]).sum(axis=1) / weights.sum(axis=1)
        distance[unsure] = size[unsure] - radius
        return distance


@dataclass(frozen=True, eq=False)
class Core:
    """The least water around a leg: all within a distance of it."""

    start: Array
    end: Array
    radius: float = MIN_RADIUS

    @property
    def low(self) -> Array:
        """Lower corner of a box around it."""
        corner: Array = np.minimum(self.start, self.end) - self.radius
        return corner

    @property
    def high(self) -> Array:
        """Upper corner of a box around it."""
        corner: Array = np.maximum(self.start, self.end) + self.radius
        return corner

    def distance(self, points: Array) -> Array:
        """Return how far points are from its surface, negative inside."""
        leg = self.end - self.start
        share = np.clip(
            (points - self.start) @ leg / max(float(leg @ leg), 1e-12), 0.0, 1.0
        )  # a leg of no length is a ball
        return np.linalg.norm(points - self.start - share[:, None] * leg, axis=1) - self.radius


def widths(walls: WallPoints, pairs: WallPairs, graph: PassageGraph) -> tuple[Array, Array, BoolArray]:
    """Return how wide the passage is at each node.

    Returns:
        (N,) mean of the wall's distance, m, taken over logarithms; between measured nodes it runs evenly along the
        graph. (N,) longest distance believed, m. (N,) whether walls were measured from the node.
    """
    count = len(graph.nodes)
    mean, longest = np.full(count, np.nan), np.full(count, np.nan)
    if len(walls.points):
        distance = np.maximum(pairs.distance[nearest_pairs(pairs, len(walls.points))], MIN_RADIUS)
        order = np.argsort(walls.seen_from, kind="stable")
        starts = np.searchsorted(walls.seen_from[order], np.arange(count + 1))
        for node in np.flatnonzero(np.diff(starts)):
            mine = distance[order[starts[node] : starts[node + 1]]]
            mean[node] = np.exp(np.log(mine).mean())
            longest[node] = LONG_SHOT * np.percentile(mine, 75)
    is_measured = np.isfinite(mean)
    mean = np.exp(_even(graph, np.log(mean), np.log(DEFAULT_RADIUS)))
    return mean, np.where(is_measured, longest, LONG_SHOT * mean), is_measured


def _even(graph: PassageGraph, values: Array, default: float) -> Array:
    """Return the (N,) values with the unknown ones filled in evenly along the legs (the discrete Laplace equation)."""
    from scipy.sparse import coo_matrix
    from scipy.sparse.csgraph import laplacian
    from scipy.sparse.linalg import spsolve

    is_known = np.isfinite(values)
    if not is_known.any():
        return np.full(len(values), default)
    if is_known.all():
        return values
    count = len(graph.nodes)
    links = coo_matrix((1.0 / graph.lengths, graph.legs.T), shape=(count, count)).tocsr()
    matrix = laplacian(links + links.T).tocsr()
    filled = values.copy()
    right = -matrix[~is_known][:, is_known] @ values[is_known]
    filled[~is_known] = np.atleast_1d(spsolve(matrix[~is_known][:, ~is_known].tocsc(), right))
    return filled


def tubes(walls: WallPoints, pairs: WallPairs, graph: PassageGraph, mean: Array, longest: Array) -> list[Tube]:
    """Return the tube around each leg of the graph."""
    nearest = pairs.distance[nearest_pairs(pairs, len(walls.points))] if len(walls.points) else np.empty(0)
    beside = np.flatnonzero(pairs.distance <= BESIDE * nearest[pairs.point])
    order = beside[np.argsort(pairs.leg[beside], kind="stable")]
    starts = np.searchsorted(pairs.leg[order], np.arange(len(graph.legs) + 1))
    made = []
    for leg, (start, end) in enumerate(graph.segments):
        mine = pairs.point[order[starts[leg] : starts[leg + 1]]]
        limits = longest[walls.seen_from[mine]]
        made.append(Tube(start, end, _rings(start, end, walls.points[mine], limits, mean[graph.legs[leg]])))
    return made


def _rings(start: Array, end: Array, points: Array, limits: Array, widths_at_ends: Array) -> Array:
    """Return the (R, RING_POINTS) distances of the wall around a leg, m."""
    length = float(np.linalg.norm(end - start))
    foot, across, angle = _cylindrical(points, start, end)
    spread = max(ALONG_SHARE * length, MIN_ALONG)
    is_near = (foot > -spread) & (foot < length + spread)
    foot, angle = foot[is_near], angle[is_near]
    distance = np.clip(across[is_near], MIN_RADIUS, limits[is_near])
    along = np.linspace(0.0, length, max(int(np.ceil(length / RING_SPACING)), 1) + 1)
    angles = np.linspace(0.0, 2.0 * np.pi, RING_POINTS, endpoint=False)
    turn = np.angle(np.exp(1j * (angles[:, None] - angle)))
    over_angle = np.exp(-0.5 * (turn / ANGLE_SPREAD) ** 2)
    over_length = np.exp(-0.5 * ((along[:, None] - foot) / spread) ** 2)
    share = (along / length)[:, None]
    prior = (1.0 - share) * np.log(widths_at_ends[0]) + share * np.log(widths_at_ends[1])
    return _mean_radius(over_length[:, None, :] * over_angle[None], distance, prior)


def bells(walls: WallPoints, pairs: WallPairs, graph: PassageGraph, pieces: list[Tube], longest: Array) -> list[Bell]:
    """Return the bell at each node; where no wall was seen it is as wide as the narrowest tube that ends there."""
    import trimesh

    directions = np.asarray(trimesh.creation.icosphere(subdivisions=3).vertices)
    prior = np.full((len(graph.nodes), len(directions)), np.inf)
    for (a, b), piece in zip(graph.legs.tolist(), pieces, strict=True):
        prior[a] = np.minimum(prior[a], _rounded_end(piece, piece.radius[0], directions))
        prior[b] = np.minimum(prior[b], _rounded_end(piece, piece.radius[-1], directions))
    node = _node_beside(walls, pairs, graph)
    made = []
    for index, centre in enumerate(graph.nodes):
        points = walls.points[node == index] - centre
        size = np.linalg.norm(points, axis=1)
        turn = np.arccos(np.clip(directions @ (points / np.maximum(size, 1e-9)[:, None]).T, -1.0, 1.0))
        distance = np.clip(size, MIN_RADIUS, longest[index])
        weights = np.exp(-0.5 * (turn / ANGLE_SPREAD) ** 2)
        made.append(Bell(centre, directions, _mean_radius(weights, distance, prior[index])))
    return made


def _rounded_end(piece: Tube, ring: Array, directions: Array) -> Array:
    """Return the (D,) logarithms of distances rounding off a tube: its section across, its least width ahead."""
    axis = piece.end - piece.start
    _, across, angle = _cylindrical(directions, np.zeros(3), axis)
    column = angle / (2.0 * np.pi) * RING_POINTS
    section = np.log(_at(ring[None].repeat(2, axis=0), np.zeros(len(directions)), column))
    return across * section + (1.0 - across) * float(np.log(ring.min()))


def _node_beside(walls: WallPoints, pairs: WallPairs, graph: PassageGraph) -> Array:
    """Return for each wall point the node that it lies beyond, off the end of the nearest leg; -1 for none.

    Points beside a leg make its tube. In a bell, which knows directions only, they would swell it.
    """
    if not len(walls.points):
        return np.empty(0)
    best = nearest_pairs(pairs, len(walls.points))
    leg, foot = pairs.leg[best], pairs.foot[best]
    is_second = foot >= graph.lengths[leg]
    node = graph.legs[leg, is_second.astype(int)]
    return np.where(is_second | (foot <= 0.0), node, -1)


def _mean_radius(weights: Array, distance: Array, prior: Array | float) -> Array:
    """Return the weighted mean of distances, of their logarithms, drawn to the prior where little is near."""
    logarithm = (weights @ np.log(distance) + PRIOR_WEIGHT * prior) / (weights.sum(axis=-1) + PRIOR_WEIGHT)
    return np.maximum(np.exp(logarithm), MIN_RADIUS)


def axes_across(axis: Array) -> tuple[Array, Array]:
    """Return two unit vectors at right angles to an axis and to each other, the second as steep as can be."""
    reference = np.array([0.0, 0.0, 1.0]) if abs(axis[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
    side = np.cross(axis, reference)
    side /= np.linalg.norm(side)
    return side, np.cross(side, axis)


def _cylindrical(points: Array, start: Array, end: Array) -> tuple[Array, Array, Array]:
    """Return the (K,) places along a line, distances from it, m, and angles about it in [0, 2 pi)."""
    axis = (end - start) / np.linalg.norm(end - start)
    side, up = axes_across(axis)
    offset = points - start
    x, y = offset @ side, offset @ up
    return offset @ axis, np.hypot(x, y), np.arctan2(y, x) % (2.0 * np.pi)


def _at(table: Array, row: Array, column: Array) -> Array:
    """Return the table's values between its entries; columns go round."""
    i = np.minimum(row.astype(np.int64), len(table) - 2)
    j = column.astype(np.int64)
    u, v = row - i, column - j
    j, k = j % RING_POINTS, (j + 1) % RING_POINTS
    values: Array = (1 - u) * ((1 - v) * table[i, j] + v * table[i, k]) + u * (
        (1 - v) * table[i + 1, j] + v * table[i + 1, k]
    )
    return values
