"""Exact distances in a band around triangles: each triangle is spread over the samples near it, the nearest one stays.

The work grows with the wall, not with the box around it. Samples are shared out in blocks that visit their triangles
in order, so the result is the same for any number of threads.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.geometry.mesh.box_tree import boxes_of
from aquanav_tools.types import Array, IntArray

SLAB = 8
"""Samples along the first axis of a slab, the share of one thread."""
NO_TRIANGLE = -1
SLIVER = 1e-14
"""Squared sine of an angle below which a triangle is its edges: rounding then outweighs its area."""


def band_distances(
    triangles: Array, origin: Array, spacing: float, shape: tuple[int, int, int], reach: float
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int32]]:
    """Return the unsigned distance to the nearest triangle on a dense grid, and which triangle that is.

    Distances up to `reach` are exact to float32; farther samples are clipped.

    Args:
        triangles: (F, 3, 3) corners, world, m. Degenerate ones count as the segment or point that they are.
        origin: (3,) world position of sample [0, 0, 0], m.
        spacing: distance between samples, m.
        shape: number of samples per axis.
        reach: width of the band on either side of the triangles, m.

    Returns:
        (X, Y, Z) distances, m, at most `reach`; (X, Y, Z) index of the nearest triangle, NO_TRIANGLE beyond `reach`.
    """
    triangles = np.ascontiguousarray(triangles, dtype=np.float64)
    origin = np.ascontiguousarray(origin, dtype=np.float64)
    distances = np.full(shape, reach, dtype=np.float32)
    nearest = np.full(shape, NO_TRIANGLE, dtype=np.int32)
    if len(triangles):
        starts, members = _slab_members(triangles, origin, spacing, shape, reach)
        _fill_slabs(triangles, starts, members, origin, spacing, reach, distances, nearest)
    return distances, nearest


def _slab_members(
    triangles: Array, origin: Array, spacing: float, shape: tuple[int, int, int], reach: float
) -> tuple[IntArray, IntArray]:
    """Return which triangles reach into each slab: those of slab s are members[starts[s]:starts[s + 1]], in order."""
    grid = (triangles - origin) / spacing
    low, high = boxes_of(grid)
    low, high = low - reach / spacing, high + reach / spacing
    is_near = ((high >= 0) & (low <= np.array(shape) - 1)).all(axis=1)
    num_slabs = -(-shape[0] // SLAB)
    first = np.clip(np.floor(low[:, 0] / SLAB), 0, num_slabs - 1).astype(np.int64)
    last = np.clip(np.floor(high[:, 0] / SLAB), 0, num_slabs - 1).astype(np.int64)
    counts = np.where(is_near, last - first + 1, 0)
    members = np.repeat(np.arange(len(triangles)), counts)
    slabs = np.repeat(first, counts) + np.arange(len(members)) - np.repeat(np.cumsum(counts) - counts, counts)
    order = np.argsort(slabs, kind="stable")
    return np.searchsorted(slabs[order], np.arange(num_slabs + 1)), members[order]


@numba.njit(cache=True, parallel=True)
def _fill_slabs(triangles, starts, members, origin, spacing, reach, distances, nearest):  # type: ignore[no-untyped-def]
    for slab in numba.prange(len(starts) - 1):
        first, end = slab * SLAB, min((slab + 1) * SLAB, distances.shape[0])
        for m in range(starts[slab], starts[slab + 1]):
            spread(
                triangles,
                members[m],
                origin[0] + first * spacing,
                origin[1],
                origin[2],
                spacing,
                reach,
                distances[first:end],
                nearest[first:end],
            )


@numba.njit(cache=True)
def spread(triangles, index, x0, y0, z0, spacing, reach, distances, nearest):  # type: ignore[no-untyped-def]
    """Lower the distances of a block of samples to one triangle's where that is nearer, in place.

    Args:
        triangles: (F, 3, 3) corners, m.
        index: Which of them.
        x0: Position of the block's first sample, m.
        y0: Position of the block's first sample, m.
        z0: Position of the block's first sample, m.
        spacing: Distance between samples, m.
        reach: Samples farther than this from the triangle may be left alone, m.
        distances: (X, Y, Z) m.
        nearest: (X, Y, Z) index of the triangle they belong to.
    """
    i0, i1 = _range(triangles, index, 0, x0, spacing, reach, distances.shape[0])
    j0, j1 = _range(triangles, index, 1, y0, spacing, reach, distances.shape[1])
    k0, k1 = _range(triangles, index, 2, z0, spacing, reach, distances.shape[2])
    a = triangles[index, 0]
    nx, ny, nz = _unit_normal(a, triangles[index, 1], triangles[index, 2])
    mx, my, mz, size = _bounding_ball(a, triangles[index, 1], triangles[index, 2])
    for i in range(i0, i1):
        x = x0 + i * spacing
        for j in range(j0, j1):
            y = y0 + j * spacing
            # Only the part of the row between the planes at `reach` from the triangle's own can be near.
            height = nx * (x - a[0]) + ny * (y - a[1]) + nz * (z0 - a[2])
            low, high = _between_planes(height, nz * spacing, reach, k0, k1)
            beside = (x - mx) ** 2 + (y - my) ** 2
            for k in range(low, high):
                z = z0 + k * spacing
                # The triangle lies within `size` of its middle: most samples know a nearer one already.
                if beside + (z - mz) ** 2 < (distances[i, j, k] + size) ** 2:
                    square = squared_distance(triangles, index, x, y, z)
                    if square < distances[i, j, k] ** 2:
                        distances[i, j, k] = math.sqrt(square)
                        nearest[i, j, k] = index


@numba.njit(cache=True)
def _range(triangles, index, axis, start, spacing, reach, count):  # type: ignore[no-untyped-def]
    """Return the first sample within `reach` of a triangle along one axis, and the one after the last."""
    a, b, c = triangles[index, 0, axis], triangles[index, 1, axis], triangles[index, 2, axis]
    first = math.ceil((min(a, b, c) - reach - start) / spacing)
    last = math.floor((max(a, b, c) + reach - start) / spacing)
    return int(min(max(first, 0), count)), int(min(max(last + 1, 0), count))


@numba.njit(cache=True)
def _between_planes(height, slope, reach, first, end):  # type: ignore[no-untyped-def]
    """Return the part of first ... end - 1 where |height + slope * k| <= reach, with a sample to spare."""
    if abs(slope) < 1e-9 * reach:
        return (first, end) if abs(height) <= reach * (1.0 + 1e-6) else (first, first)
    one, other = (-reach - height) / slope, (reach - height) / slope
    low, high = max(min(one, other), first - 1.0), min(max(one, other), end + 1.0)
    return (max(first, int(low) - 1), min(end, int(high) + 2)) if low <= high else (first, first)


@numba.njit(cache=True)
def _unit_normal(a, b, c):  # type: ignore[no-untyped-def]
    """Return the unit normal of a triangle; zero for a degenerate one."""
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    length = math.sqrt(nx * nx + ny * ny + nz * nz)
    # A sliver's normal is mostly rounding and would cut off samples that are near.
    if length <= 1e-9 * (ux * ux + uy * uy + uz * uz + vx * vx + vy * vy + vz * vz):
        return 0.0, 0.0, 0.0
    return nx / length, ny / length, nz / length


@numba.njit(cache=True)
def _bounding_ball(a, b, c):  # type: ignore[no-untyped-def]
    """Return the middle of a triangle's corners and the distance to the farthest of them, rounded up."""
    x, y, z = (a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0, (a[2] + b[2] + c[2]) / 3.0
    square = 0.0
    for corner in (a, b, c):
        square = max(square, (corner[0] - x) ** 2 + (corner[1] - y) ** 2 + (corner[2] - z) ** 2)
    return x, y, z, math.sqrt(square) * (1.0 + 1e-6)


@numba.njit(cache=True)
def squared_distance(triangles, index, x, y, z):  # type: ignore[no-untyped-def]
    """Return the squared distance from a point to triangles[index], m^2.

    Takes the whole array: a slice made per call would cost more than the distance.

    Source: Ericson, Real-Time Collision Detection (2005), section 5.1.5; a degenerate triangle is its edges.
    """
    ax, ay, az = triangles[index, 0, 0], triangles[index, 0, 1], triangles[index, 0, 2]
    ux, uy, uz = triangles[index, 1, 0] - ax, triangles[index, 1, 1] - ay, triangles[index, 1, 2] - az
    vx, vy, vz = triangles[index, 2, 0] - ax, triangles[index, 2, 1] - ay, triangles[index, 2, 2] - az
    px, py, pz = x - ax, y - ay, z - az
    uu, uv, vv = ux * ux + uy * uy + uz * uz, ux * vx + uy * vy + uz * vz, vx * vx + vy * vy + vz * vz
    up, vp = ux * px + uy * py + uz * pz, vx * px + vy * py + vz * pz
    area = uu * vv - uv * uv
    s, t = vv * up - uv * vp, uu * vp - uv * up
    if area > SLIVER * uu * vv and s >= 0.0 and t >= 0.0 and s + t <= area:
        s, t = s / area, t / area
        dx, dy, dz = px - s * ux - t * vx, py - s * uy - t * vy, pz - s * uz - t * vz
        return dx * dx + dy * dy + dz * dz
    beyond = _to_segment(px - ux, py - uy, pz - uz, vx - ux, vy - uy, vz - uz)
    return min(_to_segment(px, py, pz, ux, uy, uz), _to_segment(px, py, pz, vx, vy, vz), beyond)


@numba.njit(cache=True)
def _to_segment(px, py, pz, ux, uy, uz):  # type: ignore[no-untyped-def]
    """Return the squared distance from a point p to the segment from the origin to u."""
    square = ux * ux + uy * uy + uz * uz
    share = min(max((ux * px + uy * py + uz * pz) / square, 0.0), 1.0) if square > 0.0 else 0.0
    dx, dy, dz = px - share * ux, py - share * uy, pz - share * uz
    return dx * dx + dy * dy + dz * dz
