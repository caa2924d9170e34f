"""The bottleneck path, or widest way, between two places: the one whose narrowest point is as roomy as can be.

Its narrowest clearance is the radius of the largest ball that gets from one place to the other.
"""

from __future__ import annotations

import heapq
from dataclasses import dataclass

import numba
import numpy as np

from aquanav_tools.geometry.mesh.contact import Surface
from aquanav_tools.geometry.volume.field import BRICK, BRICK_BITS, DistanceField
from aquanav_tools.types import Array, IntArray

HERE = 13
"""Number of the offset (0, 0, 0) among the 27 around a sample."""
AROUND = np.arange(27)
SIDES = np.array([4, 10, 12, 14, 16, 22])
"""Numbers of the offsets along the axes."""
UNSEEN = -1
HALF_WINDOW = 3
"""A way on a lattice turns at every sample; its direction is taken over this many to either side."""
NUM_HALVINGS = 6
"""Of the first move, half a sample: the last is 1 % of a sample."""
NUM_DIRECTIONS = 8


@dataclass(frozen=True, eq=False)
class BottleneckPath:
    """The way between two places whose narrowest point is as wide as can be."""

    points: Array
    """(N, 3) from start to end, m."""
    clearance: Array
    """(N,) exact distance to the nearest wall; lids of portals are no walls, m."""

    @property
    def width(self) -> float:
        """Diameter of the largest sphere that gets from start to end, m."""
        return 2.0 * float(self.clearance.min())

    @property
    def tightest(self) -> Array:
        """(3,) where that sphere has no room to spare, m."""
        tightest: Array = self.points[int(np.argmin(self.clearance))]
        return tightest


def bottleneck_path(
    walls: Surface, field: DistanceField, start: Array, end: Array, enough: float = np.inf
) -> BottleneckPath | None:
    """Return the widest way between two places, or None when there is no way at all.

    The way is found on the field's samples, which miss the middle of a narrow place by up to 0.87 of a spacing; there
    its points are moved sideways to where the exact distance to the wall is largest. Both ends are moved likewise.

    Args:
        walls: Exact distances from the walls; lids of portals are not among them.
        field: Clearance of the water; it counts lids as walls.
        start: (3,) m; the nearest water counts.
        end: (3,) m; the nearest water counts.
        enough: clearance beyond which more is of no interest, m; the search is then several times as fast.
    """
    first, last = _water_samples(field, np.stack([start, end]))
    came_by = np.full((len(field.samples), BRICK, BRICK, BRICK), UNSEEN, dtype=np.int8)
    # The field also counts the lids of portals. The way is all the same the widest between any two of its samples, so
    # that an end beside a lid does not make it narrower elsewhere.
    if not _spread_roomiest(first, last, field.bricks, field.samples, came_by, enough):
        return None
    path = field.positions(_trace_back(first, last, field.bricks, came_by))
    clearance = walls.distance(path)
    narrow = np.flatnonzero(clearance <= clearance.min() + field.spacing)
    path[narrow], clearance[narrow] = _centred(walls, path, narrow, field.spacing)
    return BottleneckPath(path, clearance)


def _water_samples(field: DistanceField, points: Array) -> IntArray:
    """Return the (N, 3) indices of the water's samples nearest to points."""
    indices, _ = field.water()
    places = field.positions(indices)
    return indices[[int(np.argmin(((places - point) ** 2).sum(axis=1))) for point in points]]


def _centred(walls: Surface, path: Array, narrow: IntArray, spacing: float) -> tuple[Array, Array]:
    """Return some points of a path moved across it to where there is most room, and their clearance, m."""
    ahead = path[np.minimum(narrow + HALF_WINDOW, len(path) - 1)] - path[np.maximum(narrow - HALF_WINDOW, 0)]
    across, over = _sideways(ahead)
    points = path[narrow]
    best = walls.distance(points)
    for halving in range(NUM_HALVINGS):
        for angle in 2.0 * np.pi * np.arange(NUM_DIRECTIONS) / NUM_DIRECTIONS:
            moved = points + 0.5**halving * 0.5 * spacing * (np.cos(angle) * across + np.sin(angle) * over)
            clearance = walls.distance(moved)
            is_better = clearance > best
            points, best = np.where(is_better[:, None], moved, points), np.maximum(best, clearance)
    return points, best


def _sideways(ahead: Array) -> tuple[Array, Array]:
    """Return two (N, 3) unit vectors perpendicular to (N, 3) directions and to each other."""
    least = np.eye(3)[np.argmin(np.abs(ahead), axis=1)]
    across = np.cross(ahead, least)
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    over = np.cross(ahead, across)
    over /= np.maximum(np.linalg.norm(over, axis=1, keepdims=True), 1e-12)
    return across, over


@numba.njit(cache=True)
def _spread_roomiest(first, last, bricks, samples, came_by, enough):  # type: ignore[no-untyped-def]
    """Visit the water from the roomiest sample seen so far until `last` is; note where each was come from.

    Samples with `enough` clearance are all alike: they wait in a queue, the others in a heap. In such roomy water a
    sample's six neighbours lead as far as all 26.
    """
    ny, nz = BRICK * bricks.shape[1], BRICK * bricks.shape[2]
    goal = (last[0] * ny + last[1]) * nz + last[2]
    start = (first[0] * ny + first[1]) * nz + first[2]
    _set(came_by, bricks, first[0], first[1], first[2], HERE)
    queue, later = [start], [start]
    later.pop()
    heap = [(-_get(samples, bricks, first[0], first[1], first[2]), start)]
    heap.pop()
    while queue or later or heap:
        if not queue:
            queue, later = later, queue
        is_roomy = len(queue) > 0
        place = queue.pop() if is_roomy else heapq.heappop(heap)[1]
        if place == goal:
            return True
        i, j, k = place // (ny * nz), (place // nz) % ny, place % nz
        for offset in SIDES if is_roomy else AROUND:
            x, y, z = i + offset // 9 - 1, j + (offset // 3) % 3 - 1, k + offset % 3 - 1
            if min(x, y, z) < 0 or x >= BRICK * bricks.shape[0] or y >= ny or z >= nz:
                continue
            clearance = _get(samples, bricks, x, y, z)
            if clearance > 0.0 and _get(came_by, bricks, x, y, z) == UNSEEN:
                _set(came_by, bricks, x, y, z, offset)
                index = (x * ny + y) * nz + z
                if clearance >= enough:
                    later.append(index)
                else:
                    heapq.heappush(heap, (-clearance, index))
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
