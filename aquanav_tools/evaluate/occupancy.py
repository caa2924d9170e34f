"""What range rays have met so far, as a grid of cells, and a short way through it by what is known.

A cell is free where a ray went through it, wall where one ended in it, and else unknown. Between the ends of two
neighbouring rays that met walls close to each other, walls are guessed, until a ray goes through there. The way takes
unknown cells to be free (Koenig and Likhachev, D* Lite, AAAI 2002: the free-space assumption): it leads straight to the
goal until walls are met, and back out of a dead end when it is known to be one. It is found anew each time, not
repaired: that takes about a millisecond.
"""

from __future__ import annotations

import heapq

import numba
import numpy as np

from aquanav_tools.types import Array, BoolArray, IntArray

CELL = 0.3
"""Edge of a cell, m: about a small vehicle's length, half the width of the narrowest passages. Chosen."""
MARGIN = (18.0, 18.0, 10.0)
"""How far the grid reaches beyond vehicle and goal, m. Chosen; a way that needs more room is not planned."""
SHY = 0.35
"""A ray's last stretch that frees no cell, m: beside a wall, cells are half rock."""
UNKNOWN_COST, WALL_COST = 1.5, 1000.0
"""Of a step into a cell, in steps into a free one: walls are so dear that they are taken only where all ways are."""
MOST_BETWEEN = 0.8
"""Ends of neighbouring rays that are farther apart guess no wall between them, m: a passage may lead on there."""
GREED = 1.5
"""How far from the shortest a way may be, as a factor: so greedy, A* looks at a tenth of the cells (weighted A*)."""
_UNKNOWN, _FREE, _WALL, _GUESSED, _VISITED = range(5)


class Occupancy:
    """The grid of one vehicle."""

    def __init__(self, place: Array, goal: Array, directions: Array) -> None:
        """Begin with nothing known.

        Args:
            place: (3,) where the vehicle begins, m.
            goal: (3,) m, in the same frame.
            directions: (R, 3) unit vectors of the rays, body frame.
        """
        size = np.ceil((np.abs(goal - place) + 2.0 * np.array(MARGIN)) / CELL).astype(np.int64)
        self._low = 0.5 * (place + goal) - 0.5 * CELL * size
        self._cells = np.zeros(size, dtype=np.int8)
        self._goal = self._index(goal)
        self._num_rays, self._pairs = len(directions), neighbours(directions)

    def see(self, place: Array, ends: Array, has_echo: BoolArray) -> None:
        """Note what rays from (3,) have met: (R, 3) ends, m, and whether each met a wall there.

        Raises:
            ValueError: these are not as many rays as there are directions.
        """
        if len(ends) != self._num_rays or len(has_echo) != self._num_rays:
            raise ValueError(f"there are {self._num_rays} rays, and {len(ends)} ends and {len(has_echo)} echoes")
        _see(self._cells, self._low, place, ends, has_echo, self._pairs)

    def way(self, place: Array) -> Array | None:
        """Return the (P, 3) middles of the cells on the way to the goal; None from outside of the grid."""
        start = self._index(place)
        if (start < 0).any() or (start >= self._cells.shape).any():
            return None
        return (_way(self._cells, start, self._goal) + 0.5) * CELL + self._low

    def is_clear(self, place: Array, point: Array) -> bool:
        """Return whether no known or guessed wall is on a straight line."""
        return bool(_is_clear(self._cells, self._low, place, point))

    def _index(self, point: Array) -> IntArray:
        return np.floor((point - self._low) / CELL).astype(np.int64)


def neighbours(directions: Array) -> IntArray:
    """Return the (N, 2) pairs of rays that are at most 36 degrees apart: each with those beside it in its fan."""
    cosines = directions @ directions.T
    return np.argwhere(np.triu(cosines > np.cos(np.radians(36.0)), 1))


@numba.njit(cache=True)
def _see(cells, low, place, ends, has_echo, pairs):  # type: ignore[no-untyped-def]
    for r in range(len(ends)):
        way = ends[r] - place
        length = np.sqrt((way * way).sum())
        reach = max(0.0, length - SHY) if has_echo[r] else length
        for n in range(int(reach / (0.5 * CELL)) + 1):
            _free(cells, low, place + way * (min(n * 0.5 * CELL, reach) / max(length, 1e-9)))
        if has_echo[r]:
            _put(cells, low, ends[r], _WALL)
    for n in range(len(pairs)):
        a, b = pairs[n, 0], pairs[n, 1]
        way = ends[b] - ends[a]
        length = np.sqrt((way * way).sum())
        if has_echo[a] and has_echo[b] and length < MOST_BETWEEN:
            num = int(length / (0.5 * CELL)) + 1
            for k in range(1, num):
                _put(cells, low, ends[a] + way * (k / num), _GUESSED)
    _put(cells, low, place, _VISITED)


@numba.njit(cache=True)
def _free(cells, low, point):  # type: ignore[no-untyped-def]
    i, j, k = _cell(low, point)
    if _is_in(cells, i, j, k) and (cells[i, j, k] == _UNKNOWN or cells[i, j, k] == _GUESSED):
        cells[i, j, k] = _FREE


@numba.njit(cache=True)
def _put(cells, low, point, value):  # type: ignore[no-untyped-def]
    """Let a cell be what is known better: where the vehicle was is no wall, and a guess is for unknown cells alone."""
    i, j, k = _cell(low, point)
    if not _is_in(cells, i, j, k) or cells[i, j, k] == _VISITED:
        return
    if value != _GUESSED or cells[i, j, k] == _UNKNOWN:
        cells[i, j, k] = value


@numba.njit(cache=True)
def _cell(low, point):  # type: ignore[no-untyped-def]
    return (
        int(np.floor((point[0] - low[0]) / CELL)),
        int(np.floor((point[1] - low[1]) / CELL)),
        int(np.floor((point[2] - low[2]) / CELL)),
    )


@numba.njit(cache=True)
def _is_in(cells, i, j, k):  # type: ignore[no-untyped-def]
    return 0 <= i < cells.shape[0] and 0 <= j < cells.shape[1] and 0 <= k < cells.shape[2]


@numba.njit(cache=True)
def _is_clear(cells, low, place, point):  # type: ignore[no-untyped-def]
    way = point - place
    num = int(np.sqrt((way * way).sum()) / (0.5 * CELL)) + 1
    for n in range(num + 1):
        i, j, k = _cell(low, place + way * (n / num))
        if not _is_in(cells, i, j, k) or cells[i, j, k] == _WALL or cells[i, j, k] == _GUESSED:
            return False
    return True


@numba.njit(cache=True)
def _way(cells, start, goal):  # type: ignore[no-untyped-def]
    """Return the (P, 3) cells of a cheap way, by weighted A*; steps go through faces, not between two walls' edges."""
    _, num_y, num_z = cells.shape
    cost = np.full(cells.size, np.float32(np.inf))
    before = np.full(cells.size, -1, np.int32)
    first, last = (start[0] * num_y + start[1]) * num_z + start[2], (goal[0] * num_y + goal[1]) * num_z + goal[2]
    cost[first] = 0.0
    heap = [(np.float32(0.0), np.int64(first))]
    while len(heap) > 0:
        least, n = heapq.heappop(heap)
        if n == last:
            break
        i, j, k = n // (num_y * num_z), n // num_z % num_y, n % num_z
        if least > cost[n] + _left(i, j, k, goal) + 1e-3:
            continue  # it was reached at less cost since
        for step in range(6):
            side = 1 - 2 * (step % 2)
            a, b, c = i + side * (step // 2 == 0), j + side * (step // 2 == 1), k + side * (step // 2 == 2)
            if not _is_in(cells, a, b, c):
                continue
            m = (a * num_y + b) * num_z + c
            reached = cost[n] + _step_cost(cells[a, b, c])
            if reached < cost[m]:
                cost[m], before[m] = reached, n
                heapq.heappush(heap, (np.float32(reached + _left(a, b, c, goal)), np.int64(m)))
    num, n = 1, last
    while n != first:
        num, n = num + 1, before[n]
    way, n = np.zeros((num, 3)), last
    for p in range(num - 1, -1, -1):
        way[p, 0], way[p, 1], way[p, 2] = n // (num_y * num_z), n // num_z % num_y, n % num_z
        n = before[n]
    return way


@numba.njit(cache=True)
def _step_cost(kind):  # type: ignore[no-untyped-def]
    if kind == _UNKNOWN:
        return np.float32(UNKNOWN_COST)
    return np.float32(WALL_COST if kind == _WALL or kind == _GUESSED else 1.0)


@numba.njit(cache=True)
def _left(i, j, k, goal):  # type: ignore[no-untyped-def]
    """Return about what the way from a cell to the goal costs: at most GREED times the least."""
    return np.float32(GREED * (abs(i - goal[0]) + abs(j - goal[1]) + abs(k - goal[2])))
