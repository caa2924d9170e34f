"""What a survey says of the walls: ends of splays, and left, right, up, down at stations, as points of the wall.

How far a point is from the passage is measured from the leg next to it, not from the station it was shot from. A long
shot down the passage is therefore no long spike: it ends on the wall beside a leg farther on and tells how wide the
passage is there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.survey.model import Passage, Survey
from aquanav_tools.survey.passage_graph import PassageGraph
from aquanav_tools.types import Array, IntArray

REACH_HOPS = 3
"""A shot tells of legs up to this many legs away from its station; farther ones belong to other passages."""
ENOUGH_SPLAYS = 4
"""With this many splays at a station its left, right, up, down adds nothing: it was often read off them."""


@dataclass(frozen=True, eq=False)
class WallPoints:
    """Points of the wall, each seen from a node of the passage graph."""

    points: Array
    """(K, 3) m."""
    seen_from: IntArray
    """(K,) nodes."""


@dataclass(frozen=True, eq=False)
class WallPairs:
    """Each wall point beside each leg that it may belong to."""

    point: IntArray
    """(P,) index of the wall point."""
    leg: IntArray
    """(P,) index of the leg."""
    foot: Array
    """(P,) how far along the leg the point is, m; outside 0 to its length beyond its ends."""
    distance: Array
    """(P,) from the leg, its ends included, m."""


def wall_points(survey: Survey, graph: PassageGraph) -> WallPoints:
    """Return all that a survey measured of the walls of the passages in the graph."""
    positions = survey.positions
    shots = [(graph.node_of[splay.start], positions[splay.end]) for splay in survey.splays]
    shots = [(node, point) for node, point in shots if node >= 0]
    num_splays = np.bincount([node for node, _ in shots], minlength=len(graph.nodes))
    for passage in survey.passages:
        for row, station in enumerate(passage.stations.tolist()):
            node = int(graph.node_of[station])
            if node >= 0 and num_splays[node] < ENOUGH_SPLAYS:
                shots += [(node, point) for point in _side_points(positions, passage, row, graph, node)]
    nodes = np.array([node for node, _ in shots], dtype=np.int64)
    return WallPoints(np.array([point for _, point in shots]).reshape(-1, 3), nodes)


def _side_points(positions: Array, passage: Passage, row: int, graph: PassageGraph, node: int) -> list[Array]:
    """Return the points left, right, up and down of a station; none where all are zero, which means not measured."""
    sides = passage.lrud[row]
    if not np.nansum(np.abs(sides)) > 0.0:
        return []
    before, after = passage.stations[max(row - 1, 0)], passage.stations[min(row + 1, len(passage.stations) - 1)]
    ahead = positions[after] - positions[before]
    if not np.hypot(*ahead[:2]) > 0.0:
        ahead = (graph.neighbours(node) - graph.nodes[node])[0]
    level = np.hypot(*ahead[:2])
    left = np.array([-ahead[1], ahead[0], 0.0]) / level if level > 0.0 else np.array([-1.0, 0.0, 0.0])
    directions = (left, -left, np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0]))
    return [graph.nodes[node] + s * d for s, d in zip(sides, directions, strict=True) if np.isfinite(s)]


def pair_with_legs(walls: WallPoints, graph: PassageGraph) -> WallPairs:
    """Return every wall point beside every leg within REACH_HOPS of the node it was seen from."""
    from scipy.sparse import coo_matrix, identity

    count = len(graph.nodes)
    ends = np.concatenate([graph.legs, graph.legs[:, ::-1]])
    step = coo_matrix((np.ones(len(ends)), ends.T), shape=(count, count)).tocsr() + identity(count, format="csr")
    reach = step
    for _ in range(REACH_HOPS - 1):
        reach = (reach @ step).sign()
    legs_at = coo_matrix(
        (np.ones(2 * len(graph.legs)), (graph.legs.ravel(), np.repeat(np.arange(len(graph.legs)), 2))),
        shape=(count, len(graph.legs)),
    ).tocsr()
    near = (reach @ legs_at)[walls.seen_from].tocoo()
    point, leg = near.row.astype(np.int64), near.col.astype(np.int64)
    ends_of = graph.segments[leg]
    along = (ends_of[:, 1] - ends_of[:, 0]) / graph.lengths[leg][:, None]
    foot = np.einsum("pi,pi->p", walls.points[point] - ends_of[:, 0], along)
    nearest = ends_of[:, 0] + np.clip(foot, 0.0, graph.lengths[leg])[:, None] * along
    return WallPairs(point, leg, foot, np.linalg.norm(walls.points[point] - nearest, axis=1))


def nearest_pairs(pairs: WallPairs, num_points: int) -> IntArray:
    """Return for each wall point the index of its pair with the nearest leg."""
    order = np.lexsort([pairs.distance, pairs.point])
    first = np.searchsorted(pairs.point[order], np.arange(num_points))
    indices: IntArray = order[first]
    return indices
