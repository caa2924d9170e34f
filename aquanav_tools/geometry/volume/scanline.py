"""Telling water from rock along vertical lines: every wall that a line crosses changes the winding number by one.

For a closed surface this is exact, whatever the shape of its triangles. A line through an edge or a vertex counts as
passing it on one side, the same for all triangles there: it is moved, in thought, by (-e^2, e) with e towards zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import MeshError
from aquanav_tools.types import Array, IntArray


@dataclass(frozen=True, eq=False)
class Crossings:
    """Where the vertical lines through a grid's samples cross a closed surface."""

    starts: IntArray
    """(X * Y + 1,) the crossings of line (i, j) are those from starts[i * Y + j] to starts[i * Y + j + 1]."""
    heights: Array
    """(C,) z of the crossings, rising along each line, in samples."""
    signs: npt.NDArray[np.int8]
    """(C,) +1 where the line enters the water on its way up, -1 where it leaves."""


def find_crossings(grid_triangles: Array, num_x: int, num_y: int) -> Crossings:
    """Return the crossings of the lines x = 0 ... num_x - 1, y = 0 ... num_y - 1 with a closed surface.

    Args:
        grid_triangles: (F, 3, 3) corners in samples, normals out of the water.
        num_x: number of lines along x.
        num_y: number of lines along y.

    Raises:
        MeshError: the surface is not closed.
    """
    counts = np.zeros(num_x * num_y + 1, dtype=np.int64)
    _count(grid_triangles, num_x, num_y, counts)
    starts = np.cumsum(counts)
    heights, signs = np.empty(starts[-1]), np.empty(starts[-1], dtype=np.int8)
    _note(grid_triangles, num_x, num_y, starts[:-1].copy(), heights, signs)
    open_line = _sort(starts, heights, signs)
    if open_line >= 0:
        raise MeshError(
            f"The surface of {len(grid_triangles)} triangles is not closed: a vertical line enters the water more "
            f"often than it leaves it (line {divmod(open_line, num_y)} of the grid). Build the cavity again."
        )
    return Crossings(starts, heights, signs)


@numba.njit(cache=True)
def _count(triangles, num_x, num_y, counts):  # type: ignore[no-untyped-def]
    for triangle in triangles:
        i0, i1, j0, j1 = _lines_through_box(triangle, num_x, num_y)
        for i in range(i0, i1):
            for j in range(j0, j1):
                if _cross(triangle, i, j)[0] != 0:
                    counts[i * num_y + j + 1] += 1


@numba.njit(cache=True)
def _note(triangles, num_x, num_y, ends, heights, signs):  # type: ignore[no-untyped-def]
    for triangle in triangles:
        i0, i1, j0, j1 = _lines_through_box(triangle, num_x, num_y)
        for i in range(i0, i1):
            for j in range(j0, j1):
                sign, height = _cross(triangle, i, j)
                if sign != 0:
                    place = ends[i * num_y + j]
                    heights[place], signs[place] = height, sign
                    ends[i * num_y + j] = place + 1


@numba.njit(cache=True)
def _lines_through_box(triangle, num_x, num_y):  # type: ignore[no-untyped-def]
    """Return the first line and the one after the last, along x and along y, that may meet a triangle."""
    i0, i1 = np.ceil(triangle[:, 0].min()), np.floor(triangle[:, 0].max()) + 1.0
    j0, j1 = np.ceil(triangle[:, 1].min()), np.floor(triangle[:, 1].max()) + 1.0
    return int(max(i0, 0.0)), int(min(i1, num_x)), int(max(j0, 0.0)), int(min(j1, num_y))


@numba.njit(cache=True)
def _cross(triangle, x, y):  # type: ignore[no-untyped-def]
    """Return +1, -1 or 0 as the upward line at (x, y) enters the water, leaves it, or misses; and the height."""
    a, b, c = triangle[0], triangle[1], triangle[2]
    ab, bc, ca = _side(a, b, x, y), _side(b, c, x, y), _side(c, a, x, y)
    left = _is_left(ab, a, b)
    if left != _is_left(bc, b, c) or left != _is_left(ca, c, a):
        return 0, 0.0
    total = ab + bc + ca
    height = (bc * a[2] + ca * b[2] + ab * c[2]) / total if total != 0.0 else (a[2] + b[2] + c[2]) / 3.0
    return -1 if left else 1, height  # seen from above, a face turns left when its normal, out of the water, is up


@numba.njit(cache=True)
def _side(a, b, x, y):  # type: ignore[no-untyped-def]
    """Return twice the area of (point, a, b); swapping a and b turns the sign and changes no bit."""
    return (a[0] - x) * (b[1] - y) - (a[1] - y) * (b[0] - x)


@numba.njit(cache=True)
def _is_left(side, a, b):  # type: ignore[no-untyped-def]
    """Return whether the point lies left of the edge from a to b, the tie broken by the direction alone."""
    if side != 0.0:
        return side > 0.0
    return a[0] < b[0] or (a[0] == b[0] and a[1] < b[1])


@numba.njit(cache=True)
def _sort(starts, heights, signs):  # type: ignore[no-untyped-def]
    """Sort the crossings along each line; return a line that does not end in rock, or -1."""
    open_line = -1
    for line in range(len(starts) - 1):
        total = 0
        for place in range(starts[line], starts[line + 1]):
            total += signs[place]
            height, sign, free = heights[place], signs[place], place
            while free > starts[line] and heights[free - 1] > height:
                heights[free], signs[free] = heights[free - 1], signs[free - 1]
                free -= 1
            heights[free], signs[free] = height, sign
        if total != 0:
            open_line = line
    return open_line


@numba.njit(cache=True)
def mark_water_bricks(starts, heights, signs, num_y, bits, is_kept):  # type: ignore[no-untyped-def]
    """Set is_kept[i >> bits, j >> bits, k >> bits] for every sample (i, j, k) in the water."""
    for line in range(len(starts) - 1):
        i, j, winding = line // num_y, line % num_y, 0
        for place in range(starts[line], starts[line + 1] - 1):
            winding += signs[place]
            if winding > 0:
                first, last = int(np.ceil(heights[place])), int(np.floor(heights[place + 1]))
                if first <= last:
                    for k in range(first >> bits, (last >> bits) + 1):
                        is_kept[i >> bits, j >> bits, k] = True


@numba.njit(cache=True)
def is_water(starts, heights, signs, line, height):  # type: ignore[no-untyped-def]
    """Return whether a line is in the water at a height, in samples."""
    winding = 0
    for place in range(starts[line], starts[line + 1]):
        if heights[place] >= height:
            break
        winding += signs[place]
    return winding > 0
