"""The widest way between two places: the one whose narrowest point is as roomy as can be.

Its narrowest clearance is the radius of the largest ball that gets from one place to the other.
"""

from __future__ import annotations

import heapq

import numba
import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.water.field import BRICK, BRICK_BITS, DistanceField
from aquanav_tools.types import Array, IntArray

HERE = 13
"""Number of the offset (0, 0, 0) among the 27 around a sample."""
UNSEEN = -1
HALF_WINDOW = 3
"""A way on a lattice turns at every sample; its direction is taken over this many to either side."""
NUM_HALVINGS = 6
"""Of the first move, half a sample: the last is 1 % of a sample."""
NUM_DIRECTIONS = 8


def widest_path(cavity: Cavity, field: DistanceField, start: Array, end: Array) -> tuple[Array, float] | None:
    """Return the widest way between two places and its narrowest clearance, or None when there is no way at all.

    The way is found on the field's samples, which miss the middle of a narrow place by up to 0.87 of a spacing; there
    its points are moved sideways to where the exact distance to the wall is largest.

    Args:
        cavity: gives the exact distances.
        field: of the cavity.
        start: (3,) m; the nearest water counts.
        end: (3,) m; the nearest water counts.

    Returns:
        (N, 3) points from start to end, m, and the least clearance along them, m.
    """
    first, last = _water_samples(field, np.stack([start, end]))
    came_by = np.full((len(field.samples), BRICK, BRICK, BRICK), UNSEEN, dtype=np.int8)
    if not _spread_widest(first, last, field.bricks, field.samples, came_by):
        return None
    path = field.positions(_trace_back(first, last, field.bricks, came_by))
    inner = field.clearance(path)[1:-1]
    narrow = 1 + np.flatnonzero(inner <= inner.min(initial=np.inf) + field.spacing)
    path[narrow] = _centred(cavity, path, narrow, field.spacing)
    return path, float(_exact_clearance(cavity, path).min())


def _water_samples(field: DistanceField, points: Array) -> IntArray:
    """Return the (N, 3) indices of the water's samples nearest to points."""
    from scipy.spatial import cKDTree

    indices, _ = field.water()
    nearest: IntArray = indices[cKDTree(field.positions(indices)).query(points)[1]]
    return nearest


def _exact_clearance(cavity: Cavity, points: Array) -> Array:
    """Return the (N,) distances from (N, 3) points in the water to the wall, m."""
    import igl

    mesh = cavity.mesh
    distances: Array = np.sqrt(igl.point_mesh_squared_distance(points, mesh.vertices, mesh.faces)[0])
    return distances


def _centred(cavity: Cavity, path: Array, narrow: IntArray, spacing: float) -> Array:
    """Return some points of a path moved across it to where there is most room, m."""
    ahead = path[np.minimum(narrow + HALF_WINDOW, len(path) - 1)] - path[np.maximum(narrow - HALF_WINDOW, 0)]
    across, over = _sideways(ahead)
    points = path[narrow]
    best = _exact_clearance(cavity, points)
    for halving in range(NUM_HALVINGS):
        for angle in 2.0 * np.pi * np.arange(NUM_DIRECTIONS) / NUM_DIRECTIONS:
            moved = points + 0.5**halving * 0.5 * spacing * (np.cos(angle) * across + np.sin(angle) * over)
            clearance = _exact_clearance(cavity, moved)
            is_better = clearance > best
            points, best = np.where(is_better[:, None], moved, points), np.maximum(best, clearance)
    return points


def _sideways(ahead: Array) -> tuple[Array, Array]:
    """Return two (N, 3) unit vectors perpendicular to (N, 3) directions and to each other."""
    least = np.eye(3)[np.argmin(np.abs(ahead), axis=1)]
    across = np.cross(ahead, least)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    over = np.cross(ahead, across)
    over /= np.maximum(np.linalg.norm(over, axis=1, keepdims=True), 1e-12)
    return across, over


@numba.njit(cache=True)
def _spread_widest(first, last, bricks, samples, came_by):  # type: ignore[no-untyped-def]
    """Visit the water from the roomiest sample seen so far until `last` is; note where each was come from."""
    ny, nz = BRICK * bricks.shape[1], BRICK * bricks.shape[2]
    goal = (last[0] * ny + last[1]) * nz + last[2]
    start = (first[0] * ny + first[1]) * nz + first[2]
    _set(came_by, bricks, first[0], first[1], first[2], HERE)
    heap = [(-_get(samples, bricks, first[0], first[1], first[2]), start)]
    while heap:
        _, place = heapq.heappop(heap)
        if place == goal:
            return True
        i, j, k = place // (ny * nz), (place // nz) % ny, place % nz
        for offset in range(27):
            x, y, z = i + offset // 9 - 1, j + (offset // 3) % 3 - 1, k + offset % 3 - 1
            if min(x, y, z) < 0 or x >= BRICK * bricks.shape[0] or y >= ny or z >= nz:
                continue
            clearance = _get(samples, bricks, x, y, z)
            if clearance > 0.0 and _get(came_by, bricks, x, y, z) == UNSEEN:
                _set(came_by, bricks, x, y, z, offset)
                heapq.heappush(heap, (-clearance, (x * ny + y) * nz + z))
    return False


@numba.njit(cache=True)
def _trace_back(first, last, bricks, came_by):  # type: ignore[no-untyped-def]
    """Return the (N, 3) indices from first to last."""
    i, j, k = last[0], last[1], last[2]
    path = [(i, j, k)]
    while (i, j, k) != (first[0], first[1], first[2]):
        offset = _get(came_by, bricks, i, j, k)
        i, j, k = i - (offset // 9 - 1), j - ((offset // 3) % 3 - 1), k - (offset % 3 - 1)
        path.append((i, j, k))
    return np.array(path[::-1])


@numba.njit(cache=True)
def _get(values, bricks, i, j, k):  # type: ignore[no-untyped-def]
    brick = bricks[i >> BRICK_BITS, j >> BRICK_BITS, k >> BRICK_BITS]
    return values[brick, i & (BRICK - 1), j & (BRICK - 1), k & (BRICK - 1)]


@numba.njit(cache=True)
def _set(values, bricks, i, j, k, value):  # type: ignore[no-untyped-def]
    brick = bricks[i >> BRICK_BITS, j >> BRICK_BITS, k >> BRICK_BITS]
    values[brick, i & (BRICK - 1), j & (BRICK - 1), k & (BRICK - 1)] = value
