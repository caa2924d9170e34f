"""The planes a search starts with: the triangulation of the sparse points a photo shows."""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.reconstruct.dense.state import FloatArray
from aquanav_tools.types import Array, IntArray

_NO_AREA = 1e-6
"""Twice the area of a triangle below which it tells no slope, square pixels."""


def guess_planes(points: Array, matrix: Array, size: tuple[int, int]) -> tuple[FloatArray, FloatArray]:
    """Return (H, W) inverse depth, 1/m, and (H, W, 2) its change per pixel: planes through triangles of points.

    Outside of all triangles a pixel gets the depth of the nearest point, and no slope.

    Args:
        points: (P, 3) sparse points in the camera's frame, m, before the camera.
        matrix: (3, 3) camera matrix; pixel centres lie at 0.5.
        size: (H, W) of the result.
    """
    from scipy.spatial import cKDTree

    height, width = size
    projected = points @ matrix.T
    at, inverse_depth = projected[:, :2] / projected[:, 2:], 1.0 / points[:, 2]
    pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=-1).reshape(-1, 2)
    corners = _triangles(at)
    triangle = _paint(at, corners, height, width).ravel()
    is_inside = triangle >= 0
    slopes = np.zeros((len(pixels), 2))
    inverse = np.empty(len(pixels))
    first = corners[triangle[is_inside], 0]
    slopes[is_inside] = _slopes(at[corners], inverse_depth[corners])[triangle[is_inside]]
    inverse[is_inside] = inverse_depth[first] + np.sum(slopes[is_inside] * (pixels[is_inside] - at[first]), axis=1)
    inverse[~is_inside] = inverse_depth[cKDTree(at).query(pixels[~is_inside])[1]]
    return inverse.reshape(size).astype(np.float32), slopes.reshape(*size, 2).astype(np.float32)


def _triangles(at: Array) -> IntArray:
    """Return the (T, 3) corners of the triangles between (P, 2) points; none where these lie in a line."""
    from scipy.spatial import Delaunay, QhullError

    try:
        return np.asarray(Delaunay(at).simplices, dtype=np.int64)
    except QhullError:
        return np.zeros((0, 3), np.int64)


# Delaunay.find_simplex tries every triangle for every pixel as soon as one is a sliver: seconds per photo.
@numba.njit(cache=True)
def _paint(at, corners, height, width):  # type: ignore[no-untyped-def]
    """Return the (H, W) triangle that each pixel's centre lies in, -1 for none."""
    painted = np.full((height, width), -1, np.int64)
    for index in range(len(corners)):
        (ax, ay), (bx, by), (cx, cy) = at[corners[index, 0]], at[corners[index, 1]], at[corners[index, 2]]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        if abs(area) <= _NO_AREA:
            continue
        first, last = max(0, int(min(ax, bx, cx) - 0.5)), min(width - 1, int(max(ax, bx, cx)))
        for row in range(max(0, int(min(ay, by, cy) - 0.5)), min(height - 1, int(max(ay, by, cy))) + 1):
            for column in range(first, last + 1):
                x, y = column + 0.5, row + 0.5
                to_b = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
                to_c = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
                if to_b >= 0.0 and to_c >= 0.0 and to_b + to_c <= 1.0:
                    painted[row, column] = index
    return painted


def _slopes(at: Array, values: Array) -> Array:
    """Return the (T, 2) slopes of values at the corners of triangles, 0 for triangles without area."""
    (ax, ay), (bx, by) = (at[:, 1] - at[:, 0]).T, (at[:, 2] - at[:, 0]).T
    a, b = values[:, 1] - values[:, 0], values[:, 2] - values[:, 0]
    area = ax * by - ay * bx
    has_area = np.abs(area) > _NO_AREA
    area = np.where(has_area, area, 1.0)
    return np.stack([(a * by - b * ay) / area, (b * ax - a * bx) / area], axis=1) * has_area[:, None]
