"""Whether points lie within a distance of a surface: a search that ends at the first triangle that is near enough."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from aquanav_tools.geometry.mesh.box_tree import BoxTree, boxes_of, build_tree
from aquanav_tools.geometry.mesh.rasterise import squared_distance
from aquanav_tools.types import Array, BoolArray, Mesh

STACK = 64
"""Deeper than any tree of 2^31 triangles."""


class SurfaceTree(NamedTuple):
    """The triangles of a surface under a tree of boxes, built once for many questions."""

    tree: BoxTree
    triangles: Array
    """(F, 3, 3) corners in the order of the tree's leaves, m."""


def surface_tree(mesh: Mesh) -> SurfaceTree:
    """Return the tree over a mesh's triangles; empty where it has none."""
    corners = mesh.triangles
    if not len(corners):
        return SurfaceTree(BoxTree(np.full((2, 3), np.inf), np.full((2, 3), -np.inf)), corners)
    tree, order = build_tree(*boxes_of(corners))
    return SurfaceTree(tree, np.ascontiguousarray(corners[order]))


def are_within(surface: SurfaceTree, points: Array, distance: float) -> BoolArray:
    """Return the (N,) flags of (N, 3) points at most `distance` (m) from a surface."""
    flags = np.zeros(len(points), dtype=np.bool_)
    _search(surface.tree, surface.triangles, np.ascontiguousarray(points, dtype=np.float64), distance**2, flags)
    return flags


@numba.njit(cache=True, parallel=True)
def _search(tree, triangles, points, squared, flags):  # type: ignore[no-untyped-def]
    for n in numba.prange(len(points)):
        flags[n] = _is_within(tree, triangles, points[n, 0], points[n, 1], points[n, 2], squared)


@numba.njit(cache=True)
def _is_within(tree, triangles, x, y, z, squared):  # type: ignore[no-untyped-def]
    stack = np.empty(STACK, np.int64)
    size = len(tree.low) // 2
    stack[0], height = 1, 1
    if _squared_to_box(tree, 1, x, y, z) > squared:
        return False
    while height:
        height -= 1
        node = stack[height]
        if node >= size:
            if squared_distance(triangles, node - size, x, y, z) <= squared:
                return True
            continue
        left, right = _squared_to_box(tree, 2 * node, x, y, z), _squared_to_box(tree, 2 * node + 1, x, y, z)
        first, second = 2 * node, 2 * node + 1
        if right < left:
            left, right, first, second = right, left, second, first
        if right <= squared:  # the farther one waits
            stack[height] = second
            height += 1
        if left <= squared:
            stack[height] = first
            height += 1
    return False


@numba.njit(cache=True)
def _squared_to_box(tree, node, x, y, z):  # type: ignore[no-untyped-def]
    dx = max(tree.low[node, 0] - x, 0.0, x - tree.high[node, 0])
    dy = max(tree.low[node, 1] - y, 0.0, y - tree.high[node, 1])
    dz = max(tree.low[node, 2] - z, 0.0, z - tree.high[node, 2])
    return dx * dx + dy * dy + dz * dz
