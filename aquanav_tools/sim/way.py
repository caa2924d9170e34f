"""A short way to the goal by what is known, and where along it a vehicle is to go next.

The way takes what is unknown to be free (Koenig and Likhachev, D* Lite, AAAI 2002: the free-space assumption): it leads
straight to the goal until walls are met, and back out of a dead end when it is known to be one. It is found anew each
time, not repaired.
"""

from __future__ import annotations

import heapq

import numba
import numpy as np

from aquanav_tools.sim.occupancy import CELL, MOST_AHEAD, NUM_X, NUM_Y, NUM_Z, cell_along, cell_of, evidence, is_in
from aquanav_tools.sim.scales import DISTANCE_SCALE

PLAN_EVERY = 1.0
"""Time between two plans, s. Chosen."""
UNKNOWN_COST, WALL_COST = 1.5, 1000.0
"""Of a step into a cell, in steps into a free one: walls are so dear that they are taken only where all ways are."""
GREED = 1.6
"""How far from the shortest a way may be, as a factor (weighted A*): more than UNKNOWN_COST, or in unknown water all
ways to a goal on the diagonal would look alike, and A* would look at all of them."""
MOST_EXPANDED = 30_000
"""Cells from which a search goes on: where it has not arrived by then, its way ends nearest to the goal."""
LOOKED_ALONG = 21
"""Cells of the way ahead that are looked along for the farthest that is in sight: 4.2 m."""
LEAST_AHEAD = 4
"""Cells ahead of the place that is shown where less is in sight."""


@numba.njit(cache=True, nogil=True)
def plan(maps, m, place, goal):  # type: ignore[no-untyped-def]
    """Find a cheap way by weighted A*; steps go through faces, not between two walls' edges.

    From outside of the map there is none; to a goal outside it leads to where the map ends before it.
    """
    start, (i, j, k) = cell_of(maps, m, place), cell_of(maps, m, goal)
    end = (min(max(i, 0), NUM_X - 1), min(max(j, 0), NUM_Y - 1), min(max(k, 0), NUM_Z - 1))
    if not is_in(start[0], start[1], start[2]):
        maps.lengths[m] = 0
        return
    first = _number(start[0], start[1], start[2])
    cost, before = {first: np.float32(0.0)}, {first: first}
    heap = [(_left(first, end), first)]
    nearest, last, expanded = heap[0][0], first, 0
    while len(heap) > 0 and expanded < MOST_EXPANDED:
        least, n = heapq.heappop(heap)
        left = _left(n, end)
        if least > cost[n] + left + 1e-3:
            continue  # it was reached at less cost since
        expanded += 1
        if left < nearest:
            nearest, last = left, n
            if left == 0.0:
                break
        i, j, k = _unnumbered(n)
        for step in range(6):
            side = 1 - 2 * (step % 2)
            a, b, c = i + side * (step // 2 == 0), j + side * (step // 2 == 1), k + side * (step // 2 == 2)
            if not is_in(a, b, c):
                continue
            o = _number(a, b, c)
            reached = cost[n] + _step_cost(evidence(maps, m, a, b, c))
            if o not in cost or reached < cost[o]:
                cost[o], before[o] = reached, n
                heapq.heappush(heap, (np.float32(reached + _left(o, end)), o))
    _keep(maps, m, before, first, last, int(nearest / GREED + 0.5))


@numba.njit(cache=True, nogil=True)
def look_along(maps, m, place):  # type: ignore[no-untyped-def]
    """Find the farthest place on the way that is in sight from (3,) `place`.

    Returns:
        The numbers of the way's cell that is nearest and of the one that is ahead, and which share of the next
        LOOKED_ALONG is unknown; the second is -1 where there is no way.
    """
    here, least = 0, np.inf
    for p in range(maps.lengths[m, 0]):
        apart = 0.0
        for axis in range(3):
            offset = _middle(maps, m, p, axis) - place[axis]
            apart += offset * offset
        if apart < least:
            here, least = p, apart
    last = maps.lengths[m, 0] - 1
    ahead, end = min(here + LEAST_AHEAD, last), min(here + LOOKED_ALONG, last)
    num_unknown, is_hidden = 0, False
    for p in range(here + 1, end + 1):
        num_unknown += evidence(maps, m, maps.ways[m, p, 0], maps.ways[m, p, 1], maps.ways[m, p, 2]) == 0
        if not is_hidden and _is_clear(maps, m, place, middle(maps, m, p)):
            ahead = max(ahead, p)
        elif p > here + LEAST_AHEAD:
            is_hidden = True
    return here, ahead, num_unknown / max(1, end - here)


@numba.njit(cache=True, nogil=True)
def reading(maps, m, place, heading, goal):  # type: ignore[no-untyped-def]
    """Return what a vehicle at (3,) `place`, m, is shown of its way, as (5,) (see `sim.batch.sensors.waypoint`).

    The heading is that of the bow, from x towards y, rad.
    """
    here, ahead, unknown = look_along(maps, m, place)
    num_kept, length = maps.lengths[m]
    offset = goal - place if num_kept == 0 or ahead == length else middle(maps, m, ahead) - place
    c, s = np.cos(heading), np.sin(heading)
    apart = max(1e-9, np.sqrt((offset * offset).sum()))
    shown = np.empty(5)
    shown[0] = (c * offset[0] + s * offset[1]) / apart
    shown[1] = (c * offset[1] - s * offset[0]) / apart
    shown[2] = offset[2] / apart
    to_go = max(0, length - here) * CELL
    shown[3] = to_go / (to_go + DISTANCE_SCALE)
    shown[4] = unknown
    return shown


@numba.njit(cache=True, nogil=True)
def middle(maps, m, p):  # type: ignore[no-untyped-def]
    """Return the (3,) middle of cell `p` of the way, m."""
    return np.array([_middle(maps, m, p, 0), _middle(maps, m, p, 1), _middle(maps, m, p, 2)])


@numba.njit(cache=True, nogil=True)
def _middle(maps, m, p, axis):  # type: ignore[no-untyped-def]
    """Return a coordinate of `middle`; arrays would take most of the time."""
    num = (NUM_X, NUM_Y, NUM_Z)[axis]
    return maps.origins[m, axis] + (maps.ways[m, p, axis] + 0.5) * CELL - 0.5 * CELL * num


@numba.njit(cache=True, nogil=True)
def _number(i, j, k):  # type: ignore[no-untyped-def]
    return np.int64((i * NUM_Y + j) * NUM_Z + k)


@numba.njit(cache=True, nogil=True)
def _unnumbered(n):  # type: ignore[no-untyped-def]
    return n // (NUM_Y * NUM_Z), n // NUM_Z % NUM_Y, n % NUM_Z


@numba.njit(cache=True, nogil=True)
def _is_clear(maps, m, place, point):  # type: ignore[no-untyped-def]
    """Return whether no known or guessed wall is on a straight line, m."""
    way = point - place
    num = int(np.sqrt((way * way).sum()) / (0.5 * CELL)) + 1
    for n in range(num + 1):
        i, j, k = cell_along(maps, m, place, way, n / num)
        if not is_in(i, j, k):
            return False
        if evidence(maps, m, i, j, k) > 0:
            return False
    return True


@numba.njit(cache=True, nogil=True)
def _keep(maps, m, before, first, last, left):  # type: ignore[no-untyped-def]
    """Keep the way's first cells, and its steps with those that are `left` behind its last cell."""
    num, n = 1, last
    while n != first:
        num, n = num + 1, before[n]
    n = last
    for p in range(num - 1, -1, -1):
        if p < MOST_AHEAD:
            maps.ways[m, p] = _unnumbered(n)
        n = before[n]
    maps.lengths[m, 0], maps.lengths[m, 1] = min(num, MOST_AHEAD), num - 1 + left


@numba.njit(cache=True, nogil=True)
def _step_cost(known):  # type: ignore[no-untyped-def]
    if known == 0:
        return np.float32(UNKNOWN_COST)
    return np.float32(WALL_COST if known > 0 else 1.0)


@numba.njit(cache=True, nogil=True)
def _left(n, goal):  # type: ignore[no-untyped-def]
    """Return about what the way from a cell to the goal costs: at most GREED times the least."""
    i, j, k = _unnumbered(n)
    return np.float32(GREED * (abs(i - goal[0]) + abs(j - goal[1]) + abs(k - goal[2])))
