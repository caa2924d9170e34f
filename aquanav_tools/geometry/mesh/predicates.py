"""Exact signs: on which side of a plane or a line a point lies, never wrong by rounding.

The determinant is first computed as it is; only where its rounding error could exceed its value is it summed again as
a list of floats that do not overlap, without any error (Shewchuk 1997, "Adaptive precision floating-point arithmetic").
"""

from __future__ import annotations

import numba
import numpy as np

_HALF_ULP = 2.0**-53
_ERROR_3D = (7.0 + 56.0 * _HALF_ULP) * _HALF_ULP
_ERROR_2D = (3.0 + 16.0 * _HALF_ULP) * _HALF_ULP
"""Bounds on the determinants' rounding error, relative to the sum of absolute terms (Shewchuk 1997, section 4)."""
_SPLITTER = 2.0**27 + 1.0
_MAX_PRODUCTS = 24
"""Triple products, 6 for each of 4 minors, of which the determinant consists without differences."""
_TERMS_3D = 4 * _MAX_PRODUCTS
"""Each product is at most 4 floats."""
_TURNS = ((0, 1, 2), (1, 2, 0), (2, 0, 1))
_TERMS_2D = 12
"""6 products, each 2 floats."""


@numba.njit(cache=True)
def side_of_plane(points, a, b, c, d):  # type: ignore[no-untyped-def]
    """Return the exact sign of det(b - a, c - a, d - a) for rows a, b, c, d of (N, 3) points.

    Positive where d lies on the side that sees a, b, c counter-clockwise; 0 where all four lie in one plane. No value
    may be beyond 1e100, nor nonzero and below 1e-100: products of three stay within the range of floats.
    """
    ux, uy, uz = points[b, 0] - points[a, 0], points[b, 1] - points[a, 1], points[b, 2] - points[a, 2]
    vx, vy, vz = points[c, 0] - points[a, 0], points[c, 1] - points[a, 1], points[c, 2] - points[a, 2]
    wx, wy, wz = points[d, 0] - points[a, 0], points[d, 1] - points[a, 1], points[d, 2] - points[a, 2]
    determinant = wx * (uy * vz - uz * vy) + wy * (uz * vx - ux * vz) + wz * (ux * vy - uy * vx)
    terms = (
        abs(wx) * (abs(uy * vz) + abs(uz * vy))
        + abs(wy) * (abs(uz * vx) + abs(ux * vz))
        + abs(wz) * (abs(ux * vy) + abs(uy * vx))
    )
    if abs(determinant) > _ERROR_3D * terms:
        return 1 if determinant > 0.0 else -1
    if _same(points, a, d) or _same(points, b, d) or _same(points, c, d):
        return 0
    return _exact_side_of_plane(points, a, b, c, d)


@numba.njit(cache=True)
def side_of_line(points, a, b, c, x, y):  # type: ignore[no-untyped-def]
    """Return the exact sign of the turn a, b, c in the plane of the coordinates `x` and `y` (columns of points)."""
    left = (points[a, x] - points[c, x]) * (points[b, y] - points[c, y])
    right = (points[a, y] - points[c, y]) * (points[b, x] - points[c, x])
    turn = left - right
    if abs(turn) > _ERROR_2D * (abs(left) + abs(right)):
        return 1 if turn > 0.0 else -1
    total, count = np.zeros(_TERMS_2D), 0
    for i, j in ((a, b), (b, c), (c, a)):
        for sign, one, other in ((1.0, points[i, x], points[j, y]), (-1.0, points[i, y], points[j, x])):
            high, low = _product(sign * one, other)
            count = _add(total, _add(total, count, low), high)
    return _sign(total, count)


@numba.njit(cache=True)
def _exact_side_of_plane(points, a, b, c, d):  # type: ignore[no-untyped-def]
    """Return the sign of the determinant from differences that are exact as one or two floats, or from none of them.

    Of flat walls along the axes, and of coordinates that fit into 32 bits, most differences are one float, or zero.
    """
    parts, counts = np.empty((3, 3, 2)), np.zeros((3, 3), np.int64)
    for row, corner in enumerate((b, c, d)):
        for axis in range(3):
            for part in _sum(points[corner, axis], -points[a, axis]):
                if part != 0.0:
                    parts[row, axis, counts[row, axis]] = part
                    counts[row, axis] += 1
    num_products = 0
    for x, y, z in _TURNS:
        num_products += counts[0, x] * (counts[1, y] * counts[2, z] + counts[1, z] * counts[2, y])
    total, count = np.zeros(_TERMS_3D), 0
    if num_products > _MAX_PRODUCTS:
        return _sign_of_coordinates(points, a, b, c, d, total)
    for x, y, z in _TURNS:
        for u in parts[0, x, : counts[0, x]]:
            for v in parts[1, y, : counts[1, y]]:
                for w in parts[2, z, : counts[2, z]]:
                    count = _add_triple(total, count, u, v, w)
            for v in parts[1, z, : counts[1, z]]:
                for w in parts[2, y, : counts[2, y]]:
                    count = _add_triple(total, count, -u, v, w)
    return _sign(total, count)


@numba.njit(cache=True)
def _sign_of_coordinates(points, a, b, c, d, total):  # type: ignore[no-untyped-def]
    """Return the sign of the determinant with a row of ones, from the coordinates as they are."""
    count = 0
    for sign, i, j, k in ((1.0, b, c, d), (-1.0, a, c, d), (1.0, a, b, d), (-1.0, a, b, c)):
        for x, y, z in _TURNS:
            count = _add_triple(total, count, sign * points[i, x], points[j, y], points[k, z])
            count = _add_triple(total, count, -sign * points[i, x], points[j, z], points[k, y])
    return _sign(total, count)


@numba.njit(cache=True)
def _add_triple(total, count, x, y, z):  # type: ignore[no-untyped-def]
    high, low = _product(x, y)
    for part in (low, high):
        part_high, part_low = _product(part, z)
        count = _add(total, _add(total, count, part_low), part_high)
    return count


@numba.njit(cache=True)
def _add(total, count, value):  # type: ignore[no-untyped-def]
    """Add a float to the first `count` of the floats in total, exactly; return how many floats they are now."""
    kept = 0
    for i in range(count):
        value, rest = _sum(value, total[i])
        if rest != 0.0:
            total[kept] = rest
            kept += 1
    if value != 0.0:
        total[kept] = value
        kept += 1
    return kept


@numba.njit(cache=True)
def _sign(total, count):  # type: ignore[no-untyped-def]
    """Return the sign of floats that do not overlap: that of the largest, which comes last."""
    if count == 0:
        return 0
    return 1 if total[count - 1] > 0.0 else -1


@numba.njit(cache=True)
def _sum(a, b):  # type: ignore[no-untyped-def]
    """Return a + b as (rounded, rest), exact together."""
    total = a + b
    b_part = total - a
    return total, (a - (total - b_part)) + (b - b_part)


@numba.njit(cache=True)
def _product(a, b):  # type: ignore[no-untyped-def]
    """Return a * b as (rounded, rest), exact together."""
    product = a * b
    a_scaled, b_scaled = _SPLITTER * a, _SPLITTER * b
    a_high, b_high = a_scaled - (a_scaled - a), b_scaled - (b_scaled - b)
    a_low, b_low = a - a_high, b - b_high
    return product, a_low * b_low - (((product - a_high * b_high) - a_low * b_high) - a_high * b_low)


@numba.njit(cache=True)
def _same(points, a, b):  # type: ignore[no-untyped-def]
    return points[a, 0] == points[b, 0] and points[a, 1] == points[b, 1] and points[a, 2] == points[b, 2]
