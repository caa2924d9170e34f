"""The nearest of many triangles: a tree of boxes that compiled code searches from a first guess.

Deep in a passage much of the wall is about equally far, so to prove which triangle is nearest costs far more than to
guess it. Neighbouring points share the search: it gathers all that can be nearest to any of them.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from aquanav_tools.geometry.mesh.box_tree import morton_codes
from aquanav_tools.geometry.mesh.rasterise import squared_distance
from aquanav_tools.types import Array

LEAF = 4
"""Triangles per leaf; 2 and 8 are slower."""
STACK = 64
"""Deeper than any tree of 2^31 triangles."""


class TriangleTree(NamedTuple):
    """A complete binary tree over triangles in Morton order; node n has the children 2 n + 1 and 2 n + 2."""

    triangles: Array
    """(L * LEAF, 3, 3) corners, m, leaf after leaf; the last is repeated to fill the tree."""
    boxes: Array
    """(2 L - 1, 2, 3) lowest and highest corner of all below a node, m."""
    balls: Array
    """(L * LEAF, 7) middle of each triangle, distance from there to its farthest corner, m, and unit normal."""


def build_tree(triangles: Array) -> TriangleTree:
    """Return the tree over (F, 3, 3) triangles, F >= 1."""
    in_order = triangles[np.argsort(morton_codes(triangles.mean(axis=1)), kind="stable")]
    num_leaves = 1 << max(0, int(np.ceil(np.log2(len(triangles) / LEAF))))
    # Spread evenly, so that no part of the tree is only filling.
    spread = np.arange(num_leaves * LEAF) * len(triangles) // (num_leaves * LEAF)
    filled = np.ascontiguousarray(in_order[spread])
    leaves = filled.reshape(num_leaves, 3 * LEAF, 3)
    boxes = np.empty((2 * num_leaves - 1, 2, 3))
    boxes[num_leaves - 1 :, 0], boxes[num_leaves - 1 :, 1] = leaves.min(axis=1), leaves.max(axis=1)
    width = num_leaves // 2
    while width:
        below = boxes[2 * width - 1 : 4 * width - 1].reshape(width, 2, 2, 3)
        boxes[width - 1 : 2 * width - 1, 0] = below[:, :, 0].min(axis=1)
        boxes[width - 1 : 2 * width - 1, 1] = below[:, :, 1].max(axis=1)
        width //= 2
    middles = filled.mean(axis=1)
    sizes = np.linalg.norm(filled - middles[:, None], axis=2).max(axis=1) * (1.0 + 1e-9)
    normals = np.cross(filled[:, 1] - filled[:, 0], filled[:, 2] - filled[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    # The normal of a sliver is mostly rounding; without one, only the ball around the triangle is looked at.
    is_clear = lengths > 1e-6 * sizes[:, None] ** 2
    normals = np.where(is_clear, (1.0 - 1e-9) * normals / np.where(is_clear, lengths, 1.0), 0.0)
    return TriangleTree(filled, boxes, np.column_stack([middles, sizes, normals]))


@numba.njit(cache=True)
def gather(triangles, boxes, balls, x, y, z, radius, guess, rows, stack):  # type: ignore[no-untyped-def]
    """Collect the triangles that can be nearest to some point of a small ball.

    From the ball's middle they are at most two radii farther than the nearest one.

    Args:
        triangles: Of a TriangleTree.
        boxes: Of a TriangleTree.
        balls: Of a TriangleTree.
        x: The ball's middle, m.
        y: The ball's middle, m.
        z: The ball's middle, m.
        radius: Of the ball, m.
        guess: Row of a triangle that may be near.
        rows: Receives the rows of the triangles; a longer array is made when they are too many.
        stack: (STACK,) integers to work in.

    Returns:
        The array of rows, how many of them are filled, and the row of the triangle nearest to the middle.
    """
    first_leaf = len(boxes) // 2
    nearest, best = guess, np.sqrt(squared_distance(triangles, guess, x, y, z))
    count = 0
    stack[0], height = 0, 1
    while height:
        height -= 1
        node = stack[height]
        if _squared_to_box(boxes, node, x, y, z) > (best + 2.0 * radius) ** 2:
            continue
        if node < first_leaf:
            left = _squared_to_box(boxes, 2 * node + 1, x, y, z)
            right = _squared_to_box(boxes, 2 * node + 2, x, y, z)
            near = 1 if left <= right else 2
            stack[height], stack[height + 1] = 2 * node + 3 - near, 2 * node + near
            height += 2
            continue
        for row in range((node - first_leaf) * LEAF, (node - first_leaf + 1) * LEAF):
            apart = _to_middle(balls, row, x, y, z) - balls[row, 3]
            if apart <= best + 2.0 * radius:
                if count == len(rows):
                    rows = np.concatenate((rows, np.empty_like(rows)))
                rows[count] = row
                count += 1
                if apart < best:
                    distance = np.sqrt(squared_distance(triangles, row, x, y, z))
                    if distance < best:
                        nearest, best = row, distance
    return rows, _keep_near(balls, rows, count, x, y, z, best + 2.0 * radius), nearest


@numba.njit(cache=True)
def _keep_near(balls, rows, count, x, y, z, limit):  # type: ignore[no-untyped-def]
    """Move the rows of triangles that may lie within a limit (m) of a point to the front; return how many they are."""
    kept = 0
    for n in range(count):
        if _to_middle(balls, rows[n], x, y, z) - balls[rows[n], 3] <= limit:
            rows[kept] = rows[n]
            kept += 1
    return kept


@numba.njit(cache=True)
def keep_nearest(near, rows, count, x, y, z, radius, fewer, kept, apart):  # type: ignore[no-untyped-def]
    """Choose those of some triangles that can be nearest to some point of a small ball.

    The middle of a triangle is on it, so none of them is nearer than the nearest middle and a radius allow.

    Args:
        near: (7, N) balls of the triangles, as in a TriangleTree.
        rows: (N,) the triangles.
        count: How many of them there are.
        x: The ball's middle, m.
        y: The ball's middle, m.
        z: The ball's middle, m.
        radius: Of the ball, m.
        fewer: (7, N) receives the balls of those that are chosen.
        kept: (N,) receives the triangles that are chosen.
        apart: (N,) to work in.

    Returns:
        How many are chosen, and the triangle whose middle is nearest.
    """
    _to_middles(near, count, x, y, z, apart)
    best = 0
    for n in range(count):
        if apart[n] < apart[best]:
            best = n
    limit, chosen = apart[best] + 2.0 * radius, 0
    for n in range(count):
        if apart[n] - near[3, n] <= limit:
            kept[chosen] = rows[n]
            for m in range(7):
                fewer[m, chosen] = near[m, n]
            chosen += 1
    return chosen, rows[best]


@numba.njit(cache=True)
def distance_to_nearest(triangles, near, rows, count, x, y, z, guess, apart):  # type: ignore[no-untyped-def]
    """Return the distance from a point to the nearest of some triangles, m.

    Args:
        triangles: Of a TriangleTree.
        near: (7, N) balls of the triangles to look at, as in a TriangleTree.
        rows: (N,) the triangles to look at.
        count: How many of them.
        x: The point, m.
        y: The point, m.
        z: The point, m.
        guess: Row of a triangle that may be near.
        apart: (N,) to work in.
    """
    _to_middles(near, count, x, y, z, apart)
    best = np.sqrt(squared_distance(triangles, guess, x, y, z))
    for n in range(count):
        size = near[3, n]
        if apart[n] - size < best:
            # The triangle lies in a disc of this size: what is beside the disc and what is above it add up.
            above = (x - near[0, n]) * near[4, n] + (y - near[1, n]) * near[5, n] + (z - near[2, n]) * near[6, n]
            beside = max(0.0, np.sqrt(max(0.0, apart[n] * apart[n] - above * above)) - size)
            if above * above + beside * beside < best * best:
                best = min(best, np.sqrt(squared_distance(triangles, rows[n], x, y, z)))
    return best


@numba.njit(cache=True)
def _to_middles(near, count, x, y, z, apart):  # type: ignore[no-untyped-def]
    """Write the distances from a point to the middles of some triangles, several at a time, m."""
    for n in range(count):
        dx, dy, dz = x - near[0, n], y - near[1, n], z - near[2, n]
        apart[n] = np.sqrt(dx * dx + dy * dy + dz * dz)


@numba.njit(cache=True)
def _to_middle(balls, row, x, y, z):  # type: ignore[no-untyped-def]
    dx, dy, dz = x - balls[row, 0], y - balls[row, 1], z - balls[row, 2]
    return np.sqrt(dx * dx + dy * dy + dz * dz)


@numba.njit(cache=True)
def _squared_to_box(boxes, node, x, y, z):  # type: ignore[no-untyped-def]
    dx = max(boxes[node, 0, 0] - x, 0.0, x - boxes[node, 1, 0])
    dy = max(boxes[node, 0, 1] - y, 0.0, y - boxes[node, 1, 1])
    dz = max(boxes[node, 0, 2] - z, 0.0, z - boxes[node, 1, 2])
    return dx * dx + dy * dy + dz * dz
