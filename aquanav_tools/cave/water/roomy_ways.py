"""Where the roomiest way to a goal leads from every place in the water of a cave: a map for who looks ahead.

The ways are the geodesics whose cost rises near walls (`geodesic.WaterGraph.roomy_ways`), as a tree that leads from
each sample of the water to the goal, moved to the middle of narrow places. Places are looked up by their cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.geometry.volume.geodesic import WaterGraph
from aquanav_tools.types import Array, BoolArray, IntArray

REACH = 0.7
"""Distance along the way to the place that is aimed at, m: about one and a half lengths of a BlueROV2."""
STRETCH = 1.2
"""Way ahead over which the least room is looked for, m."""
ENOUGH = 0.15
"""Clearance of a hull, m, beyond which a way is not moved farther from the walls."""
CENTRINGS = 20
"""Steps, each of up to half the spacing of the field, in which a way is moved away from walls."""
MAX_NODES = 80_000
"""Samples of the water: a second of work."""
BLOCK = 8
"""Cells along a block's edge."""
NO_NODE = -1
Ints = npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class RoomyWays:
    """Of each of N samples of the water, where its way leads; and which sample each cell of the water goes by."""

    aims: Array
    """(N, 3) the place REACH ahead on the way, m."""
    heights: Array
    """(N,) z half as far ahead, m."""
    beyond: Array
    """(N,) length of the way from the place aimed at to the goal, m."""
    rooms: Array
    """(N,) least clearance of a hull on the way within STRETCH ahead, m."""
    origin: Array
    """(3,) middle of the first cell, m."""
    spacing: float
    """Of the cells, m."""
    blocks: Ints
    """(X, Y, Z) number of each block of cells; NO_NODE where no water is near."""
    cells: Ints
    """(B, BLOCK ** 3) sample of each cell, the nearest; NO_NODE where none is near."""


def roomy_ways(field: DistanceField, goal: Array, radius: float, max_nodes: int = MAX_NODES) -> RoomyWays:
    """Return the roomiest ways of a hull to a goal.

    Args:
        field: The cave's clearance.
        goal: (3,) m.
        radius: Of the hull, m.
        max_nodes: Samples of the water at most.

    Raises:
        MeshError: no place is wide enough for the hull.
    """
    graph = WaterGraph(field, radius, max_nodes)
    costs, after = graph.roomy_ways(graph.nearest_open(goal))
    has_way = np.isfinite(costs)
    if not has_way.any():
        raise MeshError(f"No way as wide as a hull of {radius:.2f} m in radius leads to the goal.")
    tree = _Tree(after, graph.points, costs)
    middle = _in_the_middle(graph.points, graph.points[after] - graph.points, field, radius + ENOUGH)
    smooth = (middle + middle[after] + middle[after[after]]) / 3.0
    ahead, half_ahead = tree.ahead(REACH), tree.ahead(0.5 * REACH)
    aims = smooth[ahead]
    aims[after[ahead] == ahead] = goal
    rooms = tree.least_ahead(field.clearance(middle) - radius, STRETCH)
    blocks, cells = _cells(graph.points, graph.spacing, has_way)
    heights, origin = smooth[half_ahead, 2], graph.points.min(axis=0)
    return RoomyWays(aims, heights, tree.lengths[ahead], rooms, origin, graph.spacing, blocks, cells)


class _Tree:
    """Nodes, each of which another one comes after on its way to the goal."""

    def __init__(self, after: Ints, points: Array, costs: Array) -> None:
        self._after, self._steps = after, np.linalg.norm(points[after] - points, axis=1)
        self.lengths = np.zeros(len(points))
        """(N,) of the ways, m."""
        for node in np.argsort(costs, kind="stable").tolist():  # who comes after is cheaper, and there already
            self.lengths[node] = self.lengths[after[node]] + self._steps[node]

    def ahead(self, distance: float) -> Ints:
        """Return the (N,) nodes that are so far ahead on each node's way, m, or the goal."""
        found = np.arange(len(self._after), dtype=np.int32)
        for going, reached in self._walk(distance):
            found[going] = reached
        return found

    def least_ahead(self, values: Array, distance: float) -> Array:
        """Return the (N,) least of values on each node's way so far ahead, m."""
        least = values.copy()
        for going, reached in self._walk(distance):
            least[going] = np.minimum(least[going], values[reached])
        return least

    def _walk(self, distance: float):  # type: ignore[no-untyped-def]
        """Yield, step by step, the nodes whose way goes on and where it comes to."""
        at, come, going = np.arange(len(self._after)), np.zeros(len(self._after)), np.arange(len(self._after))
        while len(going := going[(come[going] < distance) & (self._after[at[going]] != at[going])]):
            come[going] += self._steps[at[going]]
            at[going] = self._after[at[going]]
            yield going, at[going]


def towards_middle(points: Array, along: Array, field: DistanceField, enough: float) -> Array:
    """Return (N, 3) points, moved by up to half a spacing across ways where the clearance there is greater.

    Args:
        points: m.
        along: (N, 3) unit vectors along the ways.
        field: The cave's clearance.
        enough: Clearance that is not made greater, m.
    """
    step, room = 0.5 * field.spacing, field.clearance(points)
    rises = [field.clearance(points + shift) - field.clearance(points - shift) for shift in step * np.eye(3)]
    rise = np.stack(rises, axis=1) / (2.0 * step)
    rise -= (rise * along).sum(axis=1, keepdims=True) * along
    tried = points + step * rise
    is_better = (room < enough) & (field.clearance(tried) > room)
    return np.where(is_better[:, None], tried, points)


def _in_the_middle(points: Array, along: Array, field: DistanceField, enough: float) -> Array:
    """Return (N, 3) points moved across ways until they have enough clearance, or no more is to be had."""
    moved, moving = points.copy(), np.arange(len(points))
    along = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-9)
    for _ in range(CENTRINGS):
        moving = moving[field.clearance(moved[moving]) < enough]
        if not len(moving):
            break
        before = moved[moving]
        moved[moving] = towards_middle(before, along[moving], field, enough)
        moving = moving[(moved[moving] != before).any(axis=1)]
    return moved


def _cells(points: Array, spacing: float, has_way: BoolArray) -> tuple[Ints, Ints]:
    """Return the blocks and cells of `RoomyWays`, in blocks that hold points."""
    from scipy.spatial import cKDTree

    origin = points.min(axis=0)
    places: IntArray = np.rint((points - origin) / spacing).astype(np.int64) // BLOCK
    shape = tuple(int(size) for size in places.max(axis=0) + 1)
    used = np.unique(np.ravel_multi_index(tuple(places.T), shape))
    blocks = np.full(shape, NO_NODE, dtype=np.int32)
    blocks.ravel()[used] = np.arange(len(used))
    corners = np.stack(np.unravel_index(used, shape), axis=1) * BLOCK
    within = np.stack(np.unravel_index(np.arange(BLOCK**3), (BLOCK,) * 3), axis=1)
    middles = origin + spacing * (corners[:, None] + within).reshape(-1, 3)
    nodes = np.flatnonzero(has_way)
    away, near = cKDTree(points[nodes]).query(middles, distance_upper_bound=0.5 * BLOCK * spacing)
    cells = np.full(len(middles), NO_NODE, dtype=np.int32)
    is_near = np.isfinite(away)
    cells[is_near] = nodes[near[is_near]]
    return blocks, cells.reshape(-1, BLOCK**3)
