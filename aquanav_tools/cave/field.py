"""The distance field: clearance sampled on a regular grid, exact at the samples, trilinear between them."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.types import Array


@dataclass(frozen=True, eq=False)
class DistanceField:
    """Clearance (m to the nearest wall or portal, positive in water) on a grid that ends in rock on every side.

    Trilinear interpolation of an exact distance errs by at most the cell diagonal, sqrt(3) * spacing, at a sharp
    edge, and by O(spacing^2 / radius of curvature) along a smooth wall.
    """

    origin: Array
    """(3,) world position of sample [0, 0, 0], m."""
    spacing: float
    """Distance between samples, m."""
    values: npt.NDArray[np.float32]
    """(X, Y, Z) clearance at the samples, m."""

    def clearance(self, points: Array) -> Array:
        """Return the (N,) clearance at (N, 3) world points, m; outside the grid, that of the nearest border."""
        points = np.ascontiguousarray(np.atleast_2d(points), dtype=np.float64)
        return _interpolate_many(self.values, self.origin, self.spacing, points)

    def clearance_at(self, point: Array) -> float:
        """Return the clearance at one (3,) world point, m."""
        return float(interpolate(self.values, self.origin, self.spacing, point[0], point[1], point[2]))

    def positions(self, indices: npt.NDArray[np.int64]) -> Array:
        """Return the (N, 3) world positions of (N, 3) sample indices, m."""
        world: Array = self.origin + self.spacing * indices
        return world

    def nearest_index(self, point: Array) -> tuple[int, int, int]:
        """Return the index of the sample nearest to a (3,) world point, clipped to the grid."""
        index = np.rint((np.asarray(point) - self.origin) / self.spacing).astype(int)
        i, j, k = np.clip(index, 0, np.array(self.values.shape) - 1)
        return int(i), int(j), int(k)


@numba.njit(cache=True)
def interpolate(values, origin, spacing, x, y, z):  # type: ignore[no-untyped-def]
    """Return the clearance at one world point from the arrays of a field, for compiled callers."""
    gx = min(max((x - origin[0]) / spacing, 0.0), values.shape[0] - 1.000001)
    gy = min(max((y - origin[1]) / spacing, 0.0), values.shape[1] - 1.000001)
    gz = min(max((z - origin[2]) / spacing, 0.0), values.shape[2] - 1.000001)
    i, j, k = int(gx), int(gy), int(gz)
    fx, fy, fz = gx - i, gy - j, gz - k
    low = (values[i, j, k] * (1 - fx) + values[i + 1, j, k] * fx) * (1 - fy) + (
        values[i, j + 1, k] * (1 - fx) + values[i + 1, j + 1, k] * fx
    ) * fy
    high = (values[i, j, k + 1] * (1 - fx) + values[i + 1, j, k + 1] * fx) * (1 - fy) + (
        values[i, j + 1, k + 1] * (1 - fx) + values[i + 1, j + 1, k + 1] * fx
    ) * fy
    return low * (1 - fz) + high * fz


@numba.njit(cache=True)
def _interpolate_many(values, origin, spacing, points):  # type: ignore[no-untyped-def]
    result = np.empty(len(points))
    for n in range(len(points)):
        result[n] = interpolate(values, origin, spacing, points[n, 0], points[n, 1], points[n, 2])
    return result
