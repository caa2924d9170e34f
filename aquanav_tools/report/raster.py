"""Which triangle a parallel projection shows in each pixel: a depth buffer, faster than rays, no graphics driver."""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.types import Array, IntArray

NO_FACE = -1
BORDER = 1e-9
"""A pixel whose middle is so near to a triangle, px, belongs to it."""


def rasterise(corners: Array, width: int, height: int) -> tuple[IntArray, Array]:
    """Return the face that is in front in each pixel of a picture, and its height in the pixel's middle.

    Args:
        corners: (F, 3, 3) of the triangles: column and row in pixels, the first pixel from 0 to 1, and the height
            towards the viewer, m.
        width: of the picture, pixels.
        height: of the picture, pixels.

    Returns:
        (H, W) faces, NO_FACE for none, and (H, W) heights, m, -inf for none.
    """
    faces = np.full((height, width), NO_FACE, dtype=np.int64)
    heights = np.full((height, width), -np.inf)
    rasterise_rows(corners, faces, heights, 0, height)
    return faces, heights


@numba.njit(cache=True, error_model="numpy", nogil=True)
def rasterise_rows(corners, faces, heights, start, end):  # type: ignore[no-untyped-def]
    """Draw triangles into rows from `start` to before `end` of (H, W) faces and heights; see `rasterise`."""
    for n in range(len(corners)):
        a, b, c = corners[n, 0], corners[n, 1], corners[n, 2]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0.0:  # edge-on
            continue
        # Shares of the corners, each linear along a row.
        slope_a, slope_b = (b[1] - c[1]) / area, (c[1] - a[1]) / area
        slope_c = -slope_a - slope_b
        first_row, last_row = _pixels_between(min(a[1], b[1], c[1]), max(a[1], b[1], c[1]), end)
        for row in range(max(first_row, start), last_row + 1):
            y = row + 0.5
            of_a = (b[0] * (c[1] - y) - (b[1] - y) * c[0]) / area
            of_b = (c[0] * (a[1] - y) - (c[1] - y) * a[0]) / area
            low, high = _above_zero(of_a, slope_a, -np.inf, np.inf)
            low, high = _above_zero(of_b, slope_b, low, high)
            low, high = _above_zero(1.0 - of_a - of_b, slope_c, low, high)
            low, high = max(low, 0.0), min(high, float(faces.shape[1]))
            height = of_a * a[2] + of_b * b[2] + (1.0 - of_a - of_b) * c[2]
            slope = slope_a * a[2] + slope_b * b[2] + slope_c * c[2]
            # Borders belong to both sides, so that no gap is between neighbours.
            first, last = _pixels_between(low - BORDER, high + BORDER, faces.shape[1])
            fronts, owners = heights[row, first : last + 1], faces[row, first : last + 1]
            height += slope * (first + 0.5)
            for k in range(len(fronts)):
                z = height + slope * k
                is_front = z > fronts[k]  # written anyway: without branches these are vectors
                fronts[k] = z if is_front else fronts[k]
                owners[k] = n if is_front else owners[k]


@numba.njit(cache=True, error_model="numpy")
def _above_zero(value, slope, low, high):  # type: ignore[no-untyped-def]
    """Return which part of a row from `low` to `high` is left where a line, `value` at 0, is not below zero."""
    if slope > 0.0:
        return max(low, -value / slope), high
    if slope < 0.0:
        return low, min(high, -value / slope)
    return (low, high) if value >= 0.0 else (np.inf, -np.inf)


@numba.njit(cache=True, error_model="numpy")
def _pixels_between(low, high, count):  # type: ignore[no-untyped-def]
    """Return the first and the last pixel with their middle between two places, of which the first may be beyond."""
    if low > high:
        return 0, -1
    return max(int(np.ceil(low - 0.5)), 0), min(int(np.floor(high - 0.5)), count - 1)
