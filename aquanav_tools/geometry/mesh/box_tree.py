"""A tree of boxes that finds pairs of boxes that overlap, whatever their sizes."""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from aquanav_tools.types import Array, IntArray

_MORTON_BITS = 21
"""Three times this fits 64 bits."""


class BoxTree(NamedTuple):
    """A complete binary tree in one array: the children of node k are 2 k and 2 k + 1, the root is 1."""

    low: Array
    """(2 S, 3) lower corners; S is a power of two; leaf i is node S + i; nodes without leaves are empty boxes."""
    high: Array
    """(2 S, 3) upper corners."""


def boxes_of(triangles: Array) -> tuple[Array, Array]:
    """Return the (F, 3) lowest and highest corners of the boxes around (F, 3, 3) triangles."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]  # many times faster than to reduce along an axis of 3
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def build_tree(low: Array, high: Array) -> tuple[BoxTree, IntArray]:
    """Return the tree over (N, 3) boxes, N > 0, and the (N,) box behind each of its leaves."""
    order = np.argsort(morton_codes(0.5 * (low + high)), kind="stable")
    size = 1 << int(len(low) - 1).bit_length()
    lows, highs = np.full((2 * size, 3), np.inf), np.full((2 * size, 3), -np.inf)
    lows[size : size + len(low)], highs[size : size + len(low)] = low[order], high[order]
    while size > 1:
        size //= 2
        np.minimum(lows[2 * size : 4 * size : 2], lows[2 * size + 1 : 4 * size : 2], out=lows[size : 2 * size])
        np.maximum(highs[2 * size : 4 * size : 2], highs[2 * size + 1 : 4 * size : 2], out=highs[size : 2 * size])
    return BoxTree(lows, highs), order.astype(np.int64)


@numba.njit(cache=True)
def next_leaf(tree, leaf, after):  # type: ignore[no-untyped-def]
    """Return the first leaf behind leaf `after` whose box meets that of `leaf`, touching included; -1 if none."""
    size = len(tree.low) // 2
    box = size + leaf
    node = size + after
    while True:
        while node & 1:  # up past all nodes that end here
            node >>= 1
        if node == 0:
            return -1
        node += 1
        while _meet(tree, box, node):
            if node >= size:
                return node - size
            node *= 2


@numba.njit(cache=True)
def _meet(tree, a, b):  # type: ignore[no-untyped-def]
    for axis in range(3):
        if tree.low[a, axis] > tree.high[b, axis] or tree.low[b, axis] > tree.high[a, axis]:
            return False
    return True


def morton_codes(points: Array) -> IntArray:
    """Return the (N,) places of (N, 3) points along a curve through space that keeps neighbours together."""
    low = points.min(axis=0)
    scale = (2**_MORTON_BITS - 1) / max(float((points.max(axis=0) - low).max()), 1e-300)
    cells = ((points - low) * scale).astype(np.int64)
    return _spread(cells[:, 0]) | _spread(cells[:, 1]) << 1 | _spread(cells[:, 2]) << 2


def _spread(numbers: IntArray) -> IntArray:
    """Return numbers of 21 bits with two zeros between neighbouring bits."""
    spread = numbers.copy()
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        spread = (spread | spread << shift) & mask
    return spread
