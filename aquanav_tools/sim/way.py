"""A short way to the goal by what is known, and where along it a vehicle is to go next.

The way takes what is unknown to be free (Koenig and Likhachev, D* Lite, AAAI 2002: the free-space assumption): it leads
straight to the goal until walls are met, and back out of a dead end when it is known to be one. A way is kept until a
wall is met on it or it comes to its end: of two ways out of a dead end that cost about the same, a vehicle takes one.
"""

from __future__ import annotations

import heapq
from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.sim.occupancy import (
    ASTERN,
    BLOCK,
    BLOCKS,
    CELL,
    ENDED,
    MOST_AHEAD,
    NUM_X,
    NUM_Y,
    NUM_Z,
    cell_along,
    cell_of,
    evidence,
    is_in,
    within,
)
from aquanav_tools.sim.scales import DISTANCE_SCALE
from aquanav_tools.types import IntArray

PLAN_EVERY = 1.0
"""Time after which it is asked whether the way still holds, s. Chosen."""
FREE_COST, UNKNOWN_COST, GUESSED_COST, ASTERN_COST, WALL_COST = 10, 15, 300, 2_000, 10_000
"""Of a step into a cell. Walls are so dear that they are taken only where all ways are. Where a wall is guessed, and
where an unknown cell lies beside one, a step costs as much as 6 m of water: beams that are 20 degrees apart leave holes
in walls, and most are none (docs/decisions/0035)."""
BESIDE = 2
"""Cells from a wall within which what is unknown is most likely wall."""
CLOSE_COST, ROOM = 6, 5
"""What a step into water costs more for each cell by which a wall is nearer than so many: ways lead through the middle
of a passage. Along walls they wind, and show a vehicle up and down where it is to go ahead."""
GREED = 16
"""Of a step that is left: a way costs at most GREED / FREE_COST times the cheapest (weighted A*). More than
UNKNOWN_COST, or in unknown water all ways to a goal on the diagonal would look alike, and A* would look at all."""
MOST_BLOCKS = 4096
"""Blocks of cells that a search comes to: two million cells. Where it has not arrived by then, its way ends nearest to
the goal."""
STRAYED = 1.0
"""Distance from the way at which another is looked for, m."""
LOOKED_ALONG = 21
"""Cells of the way ahead that are looked along for the farthest that is in sight: 4.2 m."""
LEAST_AHEAD = 4
"""Cells ahead of the place that is shown where less is in sight."""
NUM_CELLS = NUM_X * NUM_Y * NUM_Z
"""Of a map: more than any cell's number."""


class Search(NamedTuple):
    """Room for a search: for one at a time."""

    numbers: npt.NDArray[np.int16]
    """(X, Y, Z) which of the blocks lies there, from 1 on; 0 where the search has not come to."""
    places: npt.NDArray[np.int16]
    """(B, 3) where the blocks lie."""
    costs: npt.NDArray[np.int32]
    """(B, C) of the cheapest ways to their cells that were found so far; below 0 where none was."""
    steps: npt.NDArray[np.int8]
    """(B, C) the last step of that way, of six."""
    prices: npt.NDArray[np.int16]
    """(B, C) of a step into their cells; 0 where none was asked for yet. Each is asked for from up to six sides."""
    counts: IntArray
    """(1,) blocks that it has come to."""


def make_search() -> Search:
    """Return room for a search; memory is taken as it is written."""
    return Search(
        np.zeros(BLOCKS, dtype=np.int16),
        np.zeros((MOST_BLOCKS, 3), dtype=np.int16),
        np.zeros((MOST_BLOCKS, BLOCK**3), dtype=np.int32),
        np.zeros((MOST_BLOCKS, BLOCK**3), dtype=np.int8),
        np.zeros((MOST_BLOCKS, BLOCK**3), dtype=np.int16),
        np.zeros(1, dtype=np.int64),
    )


@numba.njit(cache=True, nogil=True)
def plan(maps, search, m, place, goal):  # type: ignore[no-untyped-def]
    """Find a cheap way where the last one does not hold; steps go through faces, not between two walls' edges.

    From outside of the map there is none; to a goal outside it leads to where the map ends before it.
    """
    if holds(maps, m, place):
        return
    i, j, k = cell_of(maps, m, goal)
    end = (min(max(i, 0), NUM_X - 1), min(max(j, 0), NUM_Y - 1), min(max(k, 0), NUM_Z - 1))
    i, j, k = cell_of(maps, m, place)
    if not is_in(i, j, k):
        maps.lengths[m] = 0
        return
    first = _number(i, j, k)
    last = _expand(maps, search, m, first, end)
    _keep(maps, search, m, first, last, _steps_left(last, end))
    for b in range(search.counts[0]):
        search.numbers[search.places[b, 0], search.places[b, 1], search.places[b, 2]] = 0
    search.counts[0] = 0


@numba.njit(cache=True, nogil=True)
def holds(maps, m, place):  # type: ignore[no-untyped-def]
    """Return whether the way that was found last leads on from (3,) `place`: near by, clear and far enough."""
    num = maps.lengths[m, 0]
    if num == 0:
        return False
    here, apart = _nearest(maps, m, place)
    leads_on = num == maps.lengths[m, 1] + 1 or here + LOOKED_ALONG < num
    if apart > STRAYED or not leads_on:
        return False
    for p in range(here, num):
        if evidence(maps, m, maps.ways[m, p, 0], maps.ways[m, p, 1], maps.ways[m, p, 2]) > 0:
            return False
    return True


@numba.njit(cache=True, nogil=True)
def _expand(maps, search, m, first, end):  # type: ignore[no-untyped-def]
    """Search by weighted A* from cell `first`; return the cell nearest to the `end` that it has come to."""
    i, j, k = _unnumbered(first)
    b, c = _make_room(search, i, j, k), within(i, j, k)
    search.costs[b, c], search.steps[b, c] = 0, 0
    last, nearest = first, _steps_left(first, end)
    heap = [_entry(0, nearest, first)]
    while len(heap) > 0 and nearest > 0:
        entry = heapq.heappop(heap)
        n = entry % NUM_CELLS
        i, j, k = _unnumbered(n)
        cost, left = search.costs[_block(search, i, j, k), within(i, j, k)], _steps_left(n, end)
        if entry > _entry(cost, left, n):
            continue  # it was reached at less cost since
        if left < nearest:
            last, nearest = n, left
        for step in range(6):
            a, b, c = _stepped(i, j, k, step)
            if not is_in(a, b, c):
                continue
            block, cell = _make_room(search, a, b, c), within(a, b, c)
            if block < 0:
                return last
            if search.prices[block, cell] == 0:
                search.prices[block, cell] = _step_cost(maps, m, a, b, c)
            reached, so_far = cost + search.prices[block, cell], search.costs[block, cell]
            if so_far < 0 or reached < so_far:
                search.costs[block, cell], search.steps[block, cell] = reached, step
                o = _number(a, b, c)
                heapq.heappush(heap, _entry(reached, _steps_left(o, end), o))
    return last


@numba.njit(cache=True, nogil=True)
def _block(search, i, j, k):  # type: ignore[no-untyped-def]
    """Return which block a cell lies in; -1 where there is none yet."""
    return search.numbers[i // BLOCK, j // BLOCK, k // BLOCK] - 1


@numba.njit(cache=True, nogil=True)
def _make_room(search, i, j, k):  # type: ignore[no-untyped-def]
    """Return which block a cell lies in, made where there was none; -1 where there is no room for it."""
    made = search.counts[0]
    if _block(search, i, j, k) < 0 and made < MOST_BLOCKS:
        a, b, c = i // BLOCK, j // BLOCK, k // BLOCK
        search.numbers[a, b, c], search.counts[0] = made + 1, made + 1
        search.places[made] = a, b, c
        search.costs[made], search.prices[made] = -1, 0
    return _block(search, i, j, k)


@numba.njit(cache=True, nogil=True)
def _stepped(i, j, k, step):  # type: ignore[no-untyped-def]
    side = 1 - 2 * (step % 2)
    return i + side * (step // 2 == 0), j + side * (step // 2 == 1), k + side * (step // 2 == 2)


@numba.njit(cache=True, nogil=True)
def _entry(cost, left, n):  # type: ignore[no-untyped-def]
    """Return cost and cell as one number by which a heap sorts."""
    return np.int64(cost + GREED * left) * NUM_CELLS + n


@numba.njit(cache=True, nogil=True)
def look_along(maps, m, place):  # type: ignore[no-untyped-def]
    """Find the farthest place on the way that is in sight from (3,) `place`.

    Returns:
        The numbers of the way's cell that is nearest and of the one that is ahead, and which share of the next
        LOOKED_ALONG is unknown; the second is -1 where there is no way.
    """
    here, _ = _nearest(maps, m, place)
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
    """Return what a vehicle at (3,) `place`, m, is shown of its way, as (4,) (see `sim.batch.sensors.waypoint`).

    The heading is that of the bow, from x towards y, rad.
    """
    here, ahead, unknown = look_along(maps, m, place)
    num_kept, length = maps.lengths[m]
    offset = goal - place if num_kept == 0 or ahead == length else middle(maps, m, ahead) - place
    to_go = max(0, length - here) * CELL
    azimuth = (np.arctan2(offset[1], offset[0]) - heading + np.pi) % (2.0 * np.pi) - np.pi
    elevation = np.arctan2(offset[2], np.sqrt(offset[0] ** 2 + offset[1] ** 2))
    return np.array([to_go / (to_go + DISTANCE_SCALE), azimuth / np.pi, elevation / (0.5 * np.pi), unknown])


@numba.njit(cache=True, nogil=True)
def middle(maps, m, p):  # type: ignore[no-untyped-def]
    """Return the (3,) middle of cell `p` of the way, m."""
    return np.array([_middle(maps, m, p, 0), _middle(maps, m, p, 1), _middle(maps, m, p, 2)])


@numba.njit(cache=True, nogil=True)
def _nearest(maps, m, place):  # type: ignore[no-untyped-def]
    """Return the number of the way's cell nearest to (3,) `place`, and how far that is, m."""
    here, least = 0, np.inf
    for p in range(maps.lengths[m, 0]):
        apart = 0.0
        for axis in range(3):
            offset = _middle(maps, m, p, axis) - place[axis]
            apart += offset * offset
        if apart < least:
            here, least = p, apart
    return here, np.sqrt(least)


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
def _keep(maps, search, m, first, last, left):  # type: ignore[no-untyped-def]
    """Keep the way's first cells, and its steps with those that are `left` behind its last cell."""
    num, n = 1, last
    while n != first:
        num, n = num + 1, _before(search, n)
    n = last
    for p in range(num - 1, -1, -1):
        if p < MOST_AHEAD:
            maps.ways[m, p] = _unnumbered(n)
        if p > 0:
            n = _before(search, n)
    maps.lengths[m, 0], maps.lengths[m, 1] = min(num, MOST_AHEAD), num - 1 + left


@numba.njit(cache=True, nogil=True)
def _before(search, n):  # type: ignore[no-untyped-def]
    """Return the cell before a cell on the way to it."""
    i, j, k = _unnumbered(n)
    i, j, k = _stepped(i, j, k, search.steps[_block(search, i, j, k), within(i, j, k)] ^ 1)
    return _number(i, j, k)


@numba.njit(cache=True, nogil=True)
def _step_cost(maps, m, i, j, k):  # type: ignore[no-untyped-def]
    known = evidence(maps, m, i, j, k)
    if known < 0:
        return FREE_COST + CLOSE_COST * (ROOM + 1 - _steps_to_wall(maps, m, i, j, k, ROOM))
    if known == 0:
        return GUESSED_COST if _steps_to_wall(maps, m, i, j, k, BESIDE) <= BESIDE else UNKNOWN_COST
    if known == ASTERN:
        return ASTERN_COST
    return GUESSED_COST if known < ENDED else WALL_COST


@numba.njit(cache=True, nogil=True)
def _steps_to_wall(maps, m, i, j, k, most):  # type: ignore[no-untyped-def]
    """Return how many steps straight across one of a cell's faces the nearest wall is; one more than `most` if none."""
    nearest = most + 1
    for step in range(6):
        a, b, c = i, j, k
        for n in range(1, most + 1):
            if n >= nearest:
                break
            a, b, c = _stepped(a, b, c, step)
            if is_in(a, b, c) and 0 < evidence(maps, m, a, b, c) < ASTERN:
                nearest = n
    return nearest


@numba.njit(cache=True, nogil=True)
def _steps_left(n, end):  # type: ignore[no-untyped-def]
    i, j, k = _unnumbered(n)
    return abs(i - end[0]) + abs(j - end[1]) + abs(k - end[2])
