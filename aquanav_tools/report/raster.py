"""Which triangle a parallel projection shows in each pixel: a depth buffer, faster than rays, no graphics driver."""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.types import Array, IntArray

NO_FACE = -1


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
    _rasterise(corners, faces, heights)
    return faces, heights


@numba.njit(cache=True)
def _rasterise(corners, faces, heights):  # type: ignore[no-untyped-def]
    for n in range(len(corners)):
        a, b, c = corners[n, 0], corners[n, 1], corners[n, 2]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
        if area == 0.0:  # edge-on
            continue
        first_row, last_row = _pixels_between(min(a[1], b[1], c[1]), max(a[1], b[1], c[1]), faces.shape[0])
        first_column, last_column = _pixels_between(min(a[0], b[0], c[0]), max(a[0], b[0], c[0]), faces.shape[1])
        for row in range(first_row, last_row + 1):
            y = row + 0.5
            for column in range(first_column, last_column + 1):
                x = column + 0.5
                # Shares of the corners; borders belong to both sides, so that no gap is between neighbours.
                of_a = ((b[0] - x) * (c[1] - y) - (b[1] - y) * (c[0] - x)) / area
                of_b = ((c[0] - x) * (a[1] - y) - (c[1] - y) * (a[0] - x)) / area
                of_c = 1.0 - of_a - of_b
                if of_a >= 0.0 and of_b >= 0.0 and of_c >= 0.0:
                    z = of_a * a[2] + of_b * b[2] + of_c * c[2]
                    if z > heights[row, column]:
                        heights[row, column], faces[row, column] = z, n


@numba.njit(cache=True)
def _pixels_between(low, high, count):  # type: ignore[no-untyped-def]
    """Return the first and the last pixel with their middle between two places."""
    return max(int(np.ceil(low - 0.5)), 0), min(int(np.floor(high - 0.5)), count - 1)
