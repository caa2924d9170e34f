"""The planes a search starts with: the triangulation of the sparse points a photo shows."""

from __future__ import annotations

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
    corners, triangle = _triangulate(at, pixels)
    is_inside = triangle >= 0
    slopes = np.zeros((len(pixels), 2))
    inverse = np.empty(len(pixels))
    first = corners[triangle[is_inside], 0]
    slopes[is_inside] = _slopes(at[corners], inverse_depth[corners])[triangle[is_inside]]
    inverse[is_inside] = inverse_depth[first] + np.sum(slopes[is_inside] * (pixels[is_inside] - at[first]), axis=1)
    inverse[~is_inside] = inverse_depth[cKDTree(at).query(pixels[~is_inside])[1]]
    return inverse.reshape(size).astype(np.float32), slopes.reshape(*size, 2).astype(np.float32)


def _triangulate(at: Array, pixels: Array) -> tuple[IntArray, IntArray]:
    """Return the (T, 3) corners of triangles and the one of each pixel, -1 for none; none of points in a line."""
    from scipy.spatial import Delaunay, QhullError

    try:
        mesh = Delaunay(at)
    except QhullError:
        return np.zeros((0, 3), np.int64), np.full(len(pixels), -1)
    return mesh.simplices.astype(np.int64), mesh.find_simplex(pixels).astype(np.int64)


def _slopes(at: Array, values: Array) -> Array:
    """Return the (T, 2) slopes of values at the corners of triangles, 0 for triangles without area."""
    (ax, ay), (bx, by) = (at[:, 1] - at[:, 0]).T, (at[:, 2] - at[:, 0]).T
    a, b = values[:, 1] - values[:, 0], values[:, 2] - values[:, 0]
    area = ax * by - ay * bx
    has_area = np.abs(area) > _NO_AREA
    area = np.where(has_area, area, 1.0)
    return np.stack([(a * by - b * ay) / area, (b * ax - a * bx) / area], axis=1) * has_area[:, None]
