"""The shortest way between two points in the water: a grid path pulled tight."""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.route import WaterGraph, Ways
from aquanav_tools.types import Array


def shortest_length(ways: Ways, point: Array) -> float:
    """Return the length of the shortest way from where `ways` begin to a (3,) point, m; inf when there is none.

    The 26-neighbour path overestimates by up to 12 %; pulling it tight between mutually visible points brings it
    within about a grid step per bend.
    """
    path = ways.path_to(point)
    if path is None:
        return float("inf")
    tight = pull_tight(np.vstack([path, point]), ways.graph)
    return float(np.linalg.norm(np.diff(tight, axis=0), axis=1).sum())


def pull_tight(path: Array, graph: WaterGraph) -> Array:
    """Return the corners of a path after replacing every stretch whose ends see each other by a straight line."""
    corners = [0]
    while corners[-1] < len(path) - 1:
        low, high = corners[-1] + 1, len(path) - 1
        while low < high:  # visibility is not quite monotone along a path; bisection finds one far visible point
            middle = (low + high + 1) // 2
            low, high = (middle, high) if _sees(path[corners[-1]], path[middle], graph) else (low, middle - 1)
        corners.append(low)
    return path[corners]


def _sees(a: Array, b: Array, graph: WaterGraph) -> bool:
    count = max(2, int(np.ceil(2.0 * np.linalg.norm(b - a) / graph.field.spacing)))
    line = a + np.linspace(0.0, 1.0, count)[:, None] * (b - a)
    return bool((graph.field.clearance(line) >= graph.min_clearance).all())
