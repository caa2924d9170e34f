"""Ways through the water: the shortest from one place to all others, and one that keeps away from the walls.

The search runs on samples of the distance field (SciPy's Dijkstra, 26 neighbours), whose ways are up to 13 % too long
since they only turn by 45 degrees. The shortest ways are then drawn taut: each sample looks past its neighbours to the
corner that their way comes from (as in Theta*, Nash et al. 2007). What remains is below 1 %.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.volume.field import BRICK, BRICK_BITS, DistanceField, interpolate
from aquanav_tools.types import Array, BoolArray, IntArray

MAX_NODES = 300_000
"""Samples that are searched at most: about 0.3 GB and some seconds. More water is searched on every second or n-th."""
WALL_AVERSION = 2.0
"""Exponent of the cost of being near a wall: (largest clearance / clearance) ** WALL_AVERSION."""
NUM_NEAR = 8
"""Nodes around a point that are asked for their way: the corners of its cell."""
HALF_NEIGHBOURS = np.array([offset for offset in product((-1, 0, 1), repeat=3) if offset > (0, 0, 0)])
NO_NODE = -1

Ints = npt.NDArray[np.int32]


class WaterGraph:
    """The samples of the water with a least clearance, each joined to its 26 neighbours."""

    def __init__(self, field: DistanceField, min_clearance: float, max_nodes: int = MAX_NODES) -> None:
        indices, clearance = field.water()
        is_open = clearance >= min_clearance
        if not is_open.any():
            raise MeshError(
                f"No place in the water is wide enough: {min_clearance:.2f} m of clearance are needed, the widest "
                f"place has {field.max_clearance:.2f} m. Check --unit, or choose a smaller vehicle with --vehicle."
            )
        indices, clearance = indices[is_open], clearance[is_open]
        step = 1
        while (is_node := (indices % step == 0).all(axis=1)).sum() > max_nodes:
            step += 1
        self.field = field
        self.min_clearance = min_clearance
        self.spacing = field.spacing * step
        self.points: Array = field.positions(indices[is_node])
        """(N, 3) m."""
        self.clearance: Array = clearance[is_node]
        """(N,) m."""
        self.starts, self.neighbours, self.lengths = self._links(indices[is_node], step)
        """The neighbours of node n, rising, are neighbours[starts[n]:starts[n + 1]], so many m away."""

    def ways_from(self, point: Array) -> Ways:
        """Return the shortest ways from a (3,) point to everywhere."""
        from scipy.sparse.csgraph import dijkstra

        source = self.nearest_open(point)
        lengths = dijkstra(self._matrix(self.lengths), indices=source)
        order = np.argsort(lengths, kind="stable")
        order = order[: np.isfinite(lengths).sum()]
        taut, corners = _draw_taut(
            order, self.starts, self.neighbours, self.points, self.min_clearance, *self.field.grid
        )
        return Ways(self, source, taut, corners)

    def roomy_path(self, start: Array, end: Array) -> Array | None:
        """Return the (N, 3) samples of the wall-averse way between two points, or None when there is none."""
        first, last = self.nearest_open(start), self.nearest_open(end)
        costs, before = self.roomy_ways(first)
        if not np.isfinite(costs[last]):
            return None
        path = [last]
        while path[-1] != first:
            path.append(int(before[path[-1]]))
        return self.points[path[::-1]]

    def roomy_ways(self, source: int) -> tuple[Array, Ints]:
        """Return what the wall-averse ways from a node cost, (N,), and the node before each on its way, (N,).

        Where there is no way the cost is inf; the source and the nodes without a way come before themselves.
        """
        from scipy.sparse.csgraph import dijkstra

        aversion = (self.clearance.max() / np.maximum(self.clearance, 1e-6)) ** WALL_AVERSION
        costs = self.lengths * 0.5 * (np.repeat(aversion, np.diff(self.starts)) + aversion[self.neighbours])
        reached, before = dijkstra(self._matrix(costs), indices=source, return_predecessors=True)
        return reached, np.where(before < 0, np.arange(len(before), dtype=np.int32), before)

    def parts(self, sides: BoolArray) -> IntArray:
        """Return the (N,) part of the water each node is in when no way leads between (N,) nodes of unlike sides."""
        parts: IntArray = _parts(self.starts, self.neighbours, sides)
        return parts

    def nearest_open(self, point: Array) -> int:
        """Return the number of the node nearest to a (3,) point."""
        return int(self.tree.query(point)[1])

    @cached_property
    def tree(self) -> Any:
        """The cKDTree over the nodes."""
        from scipy.spatial import cKDTree

        return cKDTree(self.points)

    def _matrix(self, costs: Array) -> Any:
        from scipy.sparse import csr_matrix

        return csr_matrix((costs, self.neighbours, self.starts), shape=(len(self.points),) * 2)

    def _links(self, indices: IntArray, step: int) -> tuple[Ints, Ints, Array]:
        """Return which nodes are neighbours, and their distances; those of a coarse graph must see each other."""
        numbers = np.full((len(self.field.samples), BRICK, BRICK, BRICK), NO_NODE, dtype=np.int32)
        ahead = np.full((len(indices), len(HALF_NEIGHBOURS)), NO_NODE, dtype=np.int32)
        starts = np.zeros(len(indices) + 1, dtype=np.int32)
        grid = self.field.grid
        _find_neighbours(indices, step, HALF_NEIGHBOURS, self.points, self.min_clearance, *grid, numbers, ahead, starts)
        starts = np.cumsum(starts, dtype=np.int32)
        neighbours, lengths = np.empty(starts[-1], dtype=np.int32), np.empty(starts[-1])
        _list_neighbours(ahead, starts, self.points, neighbours, lengths)
        return starts, neighbours, lengths


@dataclass(frozen=True, eq=False)
class Ways:
    """The shortest ways from one place to every node of a graph, and from there to any point."""

    graph: WaterGraph
    source: int
    lengths: Array
    """(N,) m, inf where there is no way."""
    corners: IntArray
    """(N,) the node where the way to a node turns last."""

    def lengths_to(self, points: Array) -> Array:
        """Return the (M,) lengths of the shortest ways to (M, 3) points, m; inf where there is none."""
        return self._reach(points)[0]

    def path_to(self, point: Array) -> Array | None:
        """Return the (C, 3) corners of the shortest way to a (3,) point, both ends included, or None."""
        lengths, last = self._reach(point)
        if not np.isfinite(lengths[0]):
            return None
        nodes = [int(last[0])]
        while nodes[-1] != self.source:
            nodes.append(int(self.corners[nodes[-1]]))
        return np.vstack([self.graph.points[nodes[::-1]], point])

    def _reach(self, points: Array) -> tuple[Array, IntArray]:
        """Return the lengths of the ways to points, and the node where each turns last."""
        points = np.ascontiguousarray(np.atleast_2d(points), dtype=np.float64)
        graph = self.graph
        count = min(NUM_NEAR, len(graph.points))
        near = graph.tree.query(points, k=count)[1].reshape(len(points), count)
        lengths, last = _reach(
            points, near, graph.points, self.lengths, self.corners, graph.min_clearance, *graph.field.grid
        )
        return lengths, last


def shortest_length(ways: Ways, point: Array) -> float:
    """Return the length of the shortest way from where `ways` begin to a (3,) point, m; inf when there is none."""
    return float(ways.lengths_to(point)[0])


def distance_to(field: DistanceField, goal: Array, min_clearance: float) -> Ways:
    """Return the geodesic distance to a (3,) goal through water with a least clearance; ask its `lengths_to`."""
    return WaterGraph(field, min_clearance).ways_from(goal)


@numba.njit(cache=True)
def _find_neighbours(  # type: ignore[no-untyped-def]
    indices, step, offsets, points, least, bricks, samples, origin, spacing, numbers, ahead, counts
):
    """Note the neighbours at half of the offsets in `ahead`, and how many each node has in all in counts[n + 1]."""
    for n in range(len(indices)):
        i, j, k = indices[n]
        numbers[bricks[i >> BRICK_BITS, j >> BRICK_BITS, k >> BRICK_BITS], i % BRICK, j % BRICK, k % BRICK] = n
    limits = (BRICK * bricks.shape[0], BRICK * bricks.shape[1], BRICK * bricks.shape[2])
    for n in range(len(indices)):
        for m in range(len(offsets)):
            i, j, k = indices[n] + step * offsets[m]
            if min(i, j, k) < 0 or i >= limits[0] or j >= limits[1] or k >= limits[2]:
                continue
            brick = bricks[i >> BRICK_BITS, j >> BRICK_BITS, k >> BRICK_BITS]
            other = numbers[brick, i % BRICK, j % BRICK, k % BRICK]
            if other == NO_NODE:
                continue
            if step == 1 or sees(points[n], points[other], least, bricks, samples, origin, spacing):
                ahead[n, m] = other
                counts[n + 1] += 1
                counts[other + 1] += 1


@numba.njit(cache=True)
def _list_neighbours(ahead, starts, points, neighbours, lengths):  # type: ignore[no-untyped-def]
    """Write the neighbours of each node in rising order, and how far away they are."""
    ends = starts[:-1].copy()
    for n in range(len(ahead)):
        for other in ahead[n]:
            if other != NO_NODE:
                neighbours[ends[n]], neighbours[ends[other]] = other, n
                ends[n] += 1
                ends[other] += 1
    for n in range(len(ahead)):
        neighbours[starts[n] : starts[n + 1]].sort()
        for m in range(starts[n], starts[n + 1]):
            lengths[m] = _apart(points, neighbours[m], points[n])


@numba.njit(cache=True)
def _parts(starts, neighbours, sides):  # type: ignore[no-untyped-def]
    """Return the part that each node is in, called by its first node; neighbours of unlike sides are not joined."""
    first = np.arange(len(sides))
    for n in range(len(sides)):
        for m in range(starts[n], starts[n + 1]):
            a, b = n, neighbours[m]
            if b > a or sides[a] != sides[b]:
                continue
            while first[a] != a:
                first[a] = first[first[a]]  # halves the chain for the next search
                a = first[a]
            while first[b] != b:
                first[b] = first[first[b]]
                b = first[b]
            if a < b:
                first[b] = a
            elif b < a:
                first[a] = b
    for n in range(len(first)):  # each leads to an earlier node, whose part is known
        first[n] = first[first[n]]
    return first


@numba.njit(cache=True)
def sees(a, b, min_clearance, bricks, samples, origin, spacing):  # type: ignore[no-untyped-def]
    """Return whether the straight line between two points keeps its clearance.

    Where there is room to spare, the line is followed in steps that cannot miss a wall.
    """
    dx, dy, dz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    length = np.sqrt(dx * dx + dy * dy + dz * dz)
    along = 0.0
    while along < length:
        share = along / length
        room = interpolate(bricks, samples, origin, spacing, a[0] + share * dx, a[1] + share * dy, a[2] + share * dz)
        if room < min_clearance:
            return False
        along += max(room - min_clearance, 0.5 * spacing)
    return interpolate(bricks, samples, origin, spacing, b[0], b[1], b[2]) >= min_clearance


@numba.njit(cache=True)
def _draw_taut(order, starts, neighbours, points, min_clearance, bricks, samples, origin, spacing):  # type: ignore[no-untyped-def]
    """Return the lengths of the ways to all nodes, and where each turns last; `order` rises from the source."""
    lengths, corners = np.full(len(points), np.inf), np.full(len(points), NO_NODE)
    lengths[order[0]], corners[order[0]] = 0.0, order[0]
    for node in order[1:]:
        for n in range(starts[node], starts[node + 1]):
            other = neighbours[n]
            length = lengths[other] + _apart(points, other, points[node])
            if length < lengths[node]:
                lengths[node], corners[node] = length, other
        hidden = NO_NODE
        for n in range(starts[node], starts[node + 1]):
            corner = corners[neighbours[n]]
            if corner == NO_NODE or corner == hidden:
                continue
            length = lengths[corner] + _apart(points, corner, points[node])
            if length < lengths[node] - 1e-9:
                if sees(points[corner], points[node], min_clearance, bricks, samples, origin, spacing):
                    lengths[node], corners[node] = length, corner
                else:
                    hidden = corner
    return lengths, corners


@numba.njit(cache=True)
def _reach(points, near, nodes, lengths, corners, min_clearance, bricks, samples, origin, spacing):  # type: ignore[no-untyped-def]
    """Return the length of the way to each point over one of the nodes near it, and where it turns last."""
    best, last = np.full(len(points), np.inf), np.full(len(points), NO_NODE)
    for p in range(len(points)):
        for n in range(near.shape[1]):
            node = near[p, n]
            if not np.isfinite(lengths[node]):
                continue
            for turn in (node, corners[node]):
                length = lengths[turn] + _apart(nodes, turn, points[p])
                # The point itself may be nearer to a wall than the ways keep; its nearest node is then its neighbour.
                if length < best[p] and (
                    (n == 0 and turn == node)
                    or sees(nodes[turn], points[p], min_clearance, bricks, samples, origin, spacing)
                ):
                    best[p], last[p] = length, turn
    return best, last


@numba.njit(cache=True)
def _apart(points, n, point):  # type: ignore[no-untyped-def]
    dx, dy, dz = points[n, 0] - point[0], points[n, 1] - point[1], points[n, 2] - point[2]
    return np.sqrt(dx * dx + dy * dy + dz * dz)
