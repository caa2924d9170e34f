"""Pixels in blocks: what is looked up goes pixel by pixel, what is computed from it in vectors.

A block's values lie in rows of BLOCK within one array of floats and one of integers: at constant distances, so that the
compiler knows that rows do not overlap and makes vector instructions of loops along them. Loops that look something up
in a table cannot be vectors, and stand by themselves. All is in 32 bits, which hold places relative to the camera.
"""

from __future__ import annotations

import numba
import numpy as np

BLOCK = 80
"""Pixels; the usual widths of films are multiples."""
FAST = {"contract", "reassoc", "arcp", "afn", "nsz"}
"""Fast arithmetic that still knows infinity."""
X, Y, DEPTH, NORMAL_X, NORMAL_Y, NORMAL_Z, KINDS, U, V, W, GRAIN, EAST, NORTH, UP, FINE, OWN_FLOATS = (
    BLOCK * row for row in range(16)
)
"""Rows of floats: direction in the camera's frame (x, y, 1), depth along its axis, m, normal over the depth, what is
seen, and those of `rock_blocks`; a kernel's own begin at OWN_FLOATS."""
LAYER, ROW, COLUMN, AT, CORNER = (BLOCK * row for row in range(5))
"""Rows of integers: a sample of the rock's texture, a place in a table, and the eight samples around one."""
NUM_INTS = CORNER + 8 * BLOCK
NOTHING = -1
"""Kind of what no triangle is seen in."""
KIND, COLOUR = 9, 10
"""Columns of `triangle_table`, behind the nine of the normal."""
_ONE = np.float32(1.0)


@numba.njit(cache=True, error_model="numpy", nogil=True, fastmath=FAST)
def triangle_table(origins, vertices, normals, colours, faces, kinds, centre, turn):  # type: ignore[no-untyped-def]
    """Return (N + 1, 16) what each triangle in sight is; the last row is NOTHING. Sixteen are a line of the cache.

    A normal between those of the corners is linear in the direction (x, y, 1) of a pixel but for the depth: a row's
    first nine values are that map. Then the triangle's kind and the colour of its first corner.
    """
    table = np.zeros((len(origins) + 1, 16), np.float32)
    table[len(origins), KIND] = NOTHING
    corners = np.empty((3, 3))
    for n in range(len(origins)):
        face = faces[origins[n]]
        for k in range(3):
            vertex = vertices[face[k]]
            x, y, z = vertex[0] - centre[0], vertex[1] - centre[1], vertex[2] - centre[2]
            for axis in range(3):
                corners[k, axis] = turn[axis, 0] * x + turn[axis, 1] * y + turn[axis, 2] * z
        volume = _triple(corners[0], corners[1], corners[2])
        scale = 1.0 / volume if volume != 0.0 else 0.0
        for k in range(3):
            # A corner's share over the depth: the direction times the product of the other two, over the volume.
            p, q, normal = corners[(k + 1) % 3], corners[(k + 2) % 3], normals[face[k]]
            cx, cy, cz = p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]
            for axis in range(3):
                table[n, 3 * axis] += scale * cx * normal[axis]
                table[n, 3 * axis + 1] += scale * cy * normal[axis]
                table[n, 3 * axis + 2] += scale * cz * normal[axis]
            table[n, COLOUR + k] = colours[face[0], k]
        table[n, KIND] = kinds[origins[n]]
    return table


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _triple(a, b, c):  # type: ignore[no-untyped-def]
    """Return the volume that three vectors span."""
    across = a[0] * (b[1] * c[2] - b[2] * c[1])
    return across + a[1] * (b[2] * c[0] - b[0] * c[2]) + a[2] * (b[0] * c[1] - b[1] * c[0])


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def look(floats, seen, nearness, table, focal, start, down):  # type: ignore[no-untyped-def]
    """Fill the rows from X to KINDS for a block of a picture's row; return the lowest and the highest kind in it.

    Args:
        floats: Get the rows; a block that reaches beyond the picture repeats its last pixel.
        seen: (W,) row of `table`, -1 for its last.
        nearness: (W,) one over the depth, 1/m.
        table: Of `triangle_table`.
        focal: px.
        start: Column of the first pixel.
        down: Of the row's middle below the picture's, px.
    """
    num, middle = min(BLOCK, len(seen) - start), np.float32(0.5 * len(seen) - 0.5 - start)
    shrink, y = _ONE / focal, np.float32(down) / focal
    for n in range(BLOCK):
        floats[X + n], floats[Y + n] = shrink * (np.float32(n) - middle), y
    before, lowest, highest = -2, np.float32(np.inf), np.float32(-np.inf)
    a = b = c = d = e = f = g = h = i = kind = np.float32(0.0)
    for n in range(BLOCK):
        column = np.uintp(start + min(n, num - 1))
        triangle, x = seen[column], floats[X + n]
        if triangle != before:  # most have their neighbour's
            before, own = triangle, table[triangle]
            a, b, c, d, e, f, g, h, i = own[0], own[1], own[2], own[3], own[4], own[5], own[6], own[7], own[8]
            kind = own[KIND]
            lowest, highest = min(lowest, kind), max(highest, kind)
        floats[DEPTH + n], floats[KINDS + n] = nearness[column], kind
        floats[NORMAL_X + n] = a * x + b * y + c
        floats[NORMAL_Y + n] = d * x + e * y + f
        floats[NORMAL_Z + n] = g * x + h * y + i
    for n in range(BLOCK):
        floats[DEPTH + n] = _ONE / floats[DEPTH + n]
    return lowest, highest


@numba.njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def wave(turns):  # type: ignore[no-untyped-def]
    """Return the sine of an angle in turns within 0.06, of two parabolas: in an eighth of the time."""
    turns -= np.floor(turns + np.float32(0.5))
    return np.float32(8.0) * turns - np.float32(16.0) * turns * abs(turns)


@numba.njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def faded(depths):  # type: ignore[no-untyped-def]
    """Return exp(-depths) of what is not negative within 1e-4: the series for a sixteenth, to the power of 16."""
    t = min(depths, np.float32(16.0)) * np.float32(1.0 / 16.0)
    t = _ONE - t * (_ONE - t * (np.float32(1.0 / 2.0) - t * (np.float32(1.0 / 6.0) - t * np.float32(1.0 / 24.0))))
    t *= t
    t *= t
    t *= t
    return t * t
