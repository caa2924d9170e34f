"""What range rays have met so far, as sparse grids of cells, and a short way to the goal by what is known.

A cell keeps evidence, as OctoMap does (Hornung, Wurm, Bennewitz, Stachniss and Burgard, Autonomous Robots 34, 2013): a
ray that goes through it counts for water, one that ends in it for wall, so that a cell which is half rock closes no
narrow passage for good. Around a wall more wall is guessed where nothing is known: rays leave gaps. The way takes what
is unknown to be free (Koenig and Likhachev, D* Lite, AAAI 2002: the free-space assumption): it leads straight to the
goal until walls are met, and back out of a dead end when it is known to be one. It is found anew each time, not
repaired. Cells are kept in blocks, made where something was met (as in voxel hashing: Niessner, Zollhoefer, Izadi and
Stamminger, ACM TOG 2013): what is kept grows with the passage, not with the space around it.
"""

from __future__ import annotations

import heapq
from typing import Any, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import ResourceError
from aquanav_tools.sim.scales import DISTANCE_SCALE
from aquanav_tools.types import IntArray

CELL = 0.2
"""Edge of a cell, m: with 0.3 m, narrow fissures are closed on the map (docs/decisions/0034)."""
BLOCK = 8
"""Cells along a block's edge."""
BLOCKS = (128, 128, 64)
"""Blocks along each axis around the place where a map begins: 205 by 205 by 102 m. What lies beyond stays unknown."""
NUM_X, NUM_Y, NUM_Z = (BLOCK * blocks for blocks in BLOCKS)
"""Cells along each axis."""
MOST_BLOCKS = 4096
"""That a map keeps: with more, what is met stays unknown."""
RESERVED = 2 * BLOCKS[0] * BLOCKS[1] * BLOCKS[2] + MOST_BLOCKS * BLOCK**3
"""Bytes that a map reserves, but for some thousands."""
PLAN_EVERY = 1.0
"""Time between two plans, s. Chosen."""
SHY = 0.2
"""A ray's last stretch that frees no cell, m: beside a wall, cells are half rock."""
NO_ECHO = 1.0 - 1e-3
"""Share of a ray's reach from which it met nothing."""
UNKNOWN_COST, WALL_COST = 1.5, 1000.0
"""Of a step into a cell, in steps into a free one: walls are so dear that they are taken only where all ways are."""
GREED = 1.6
"""How far from the shortest a way may be, as a factor (weighted A*): more than UNKNOWN_COST, or in unknown water all
ways to a goal on the diagonal would look alike, and A* would look at all of them."""
MOST_EXPANDED = 30_000
"""Cells from which a search goes on: where it has not arrived by then, its way ends nearest to the goal."""
MOST_AHEAD = 96
"""Cells of a way that are kept."""
LOOKED_ALONG = 21
"""Cells of the way ahead that are looked along for the farthest that is in sight: 4.2 m."""
LEAST_AHEAD = 4
"""Cells ahead of the place that is shown where less is in sight."""
AROUND_GOAL = 3
"""Steps from the goal within which there is water: where it lies at a wall, a ray may end in its own cell."""
AROUND_WALL = 2
"""Cells from a wall within which walls are guessed where nothing is known."""
PASSED, ENDED, GUESSED = -2, 4, 1
"""What a ray that goes through a cell adds to its evidence, one that ends there, and one that ends close by where there
is none: OctoMap's odds, 0.4 and 0.7, in a fifth of their logarithms."""
LOWEST, HIGHEST = -10, 17
"""Between which evidence stays, OctoMap's too: 0.12 and 0.97. Above 0 there is a wall, below 0 water."""
VISITED = -128
"""Evidence of where the vehicle was, and of the water around the goal; it stays."""


class Maps(NamedTuple):
    """N maps, each of what one vehicle has met in its episode; places are counted from where it began, m."""

    origins: npt.NDArray[np.float64]
    """(N, 3) where that was, m."""
    numbers: npt.NDArray[np.int16]
    """(N, X, Y, Z) which of the blocks lies there, from 1 on; 0 where there is none yet."""
    blocks: npt.NDArray[np.int8]
    """(N, B, C) evidence of the blocks' cells: 0 where nothing is known."""
    places: npt.NDArray[np.int16]
    """(N, B, 3) where the blocks lie."""
    counts: IntArray
    """(N,) blocks that there are."""
    ways: IntArray
    """(N, P, 3) first cells of the way that was found last."""
    lengths: IntArray
    """(N, 2) how many these are, and steps of the whole way."""


def make_maps(num: int) -> Maps:
    """Return maps in which nothing is known; memory is reserved, and taken as it is written.

    Raises:
        ResourceError: the machine does not reserve as much.
    """
    try:
        return Maps(
            np.zeros((num, 3)),
            np.zeros((num, *BLOCKS), dtype=np.int16),
            np.zeros((num, MOST_BLOCKS, BLOCK**3), dtype=np.int8),
            np.zeros((num, MOST_BLOCKS, 3), dtype=np.int16),
            np.zeros(num, dtype=np.int64),
            np.zeros((num, MOST_AHEAD, 3), dtype=np.int64),
            np.zeros((num, 2), dtype=np.int64),
        )
    except MemoryError as cause:
        raise ResourceError(
            f"Maps of {num} vehicles reserve {num * RESERVED / 1e9:.1f} GB, 4.2 MB each, and this machine does not have "
            "them. Take fewer vehicles at once."
        ) from cause


_KEPT = ("origins", "counts", "ways", "lengths")


def packed(maps: Maps) -> dict[str, npt.NDArray[Any]]:
    """Return copies of what is known, without the empty space."""
    is_made = np.arange(MOST_BLOCKS) < maps.counts[:, None]
    kept = {name: np.array(getattr(maps, name)) for name in _KEPT}
    return kept | {"blocks": maps.blocks[is_made], "places": maps.places[is_made]}


def unpacked(kept: dict[str, npt.NDArray[Any]]) -> Maps:
    """Return the maps of which `packed` made copies."""
    maps = make_maps(len(kept["counts"]))
    is_made = np.arange(MOST_BLOCKS) < kept["counts"][:, None]
    for name in _KEPT:
        getattr(maps, name)[:] = kept[name]
    maps.blocks[is_made], maps.places[is_made] = kept["blocks"], kept["places"]
    rows, which = np.nonzero(is_made)
    maps.numbers[(rows, *kept["places"].T)] = which + 1
    return maps


@numba.njit(cache=True, nogil=True)
def begin(maps, m, place, goal):  # type: ignore[no-untyped-def]
    """Let map `m` begin at (3,) `place` with nothing known but that there is water around the (3,) goal, m."""
    for b in range(maps.counts[m]):
        maps.numbers[m, maps.places[m, b, 0], maps.places[m, b, 1], maps.places[m, b, 2]] = 0
        maps.blocks[m, b] = 0
    maps.counts[m] = 0
    maps.origins[m] = place
    i, j, k = _cell(maps, m, goal)
    for a in range(-AROUND_GOAL, AROUND_GOAL + 1):
        for b in range(-AROUND_GOAL, AROUND_GOAL + 1):
            for c in range(-AROUND_GOAL, AROUND_GOAL + 1):
                if abs(a) + abs(b) + abs(c) <= AROUND_GOAL:
                    _visit(maps, m, i + a, j + b, k + c)


@numba.njit(cache=True, nogil=True)
def see(maps, m, place, rays, ranges, reaches):  # type: ignore[no-untyped-def]
    """Note what rays have met.

    Args:
        maps: The maps.
        m: Which of them.
        place: (3,) where the rays begin, m.
        rays: (R, 3) unit vectors.
        ranges: (R,) m.
        reaches: (R,) of the rays, m.
    """
    for r in range(len(ranges)):
        has_echo = ranges[r] < NO_ECHO * reaches[r]
        free = max(0.0, ranges[r] - SHY) if has_echo else ranges[r]
        last = (-1, -1, -1)
        for n in range(int(free / (0.5 * CELL)) + 1):
            cell = _along(maps, m, place, rays[r], min(n * 0.5 * CELL, free))
            if cell != last:
                _add(maps, m, cell[0], cell[1], cell[2], PASSED)
                last = cell
        if has_echo:
            i, j, k = _along(maps, m, place, rays[r], ranges[r])
            _add_wall(maps, m, i, j, k)
    i, j, k = _cell(maps, m, place)
    _visit(maps, m, i, j, k)


@numba.njit(cache=True, nogil=True)
def plan(maps, m, place, goal):  # type: ignore[no-untyped-def]
    """Find a cheap way by weighted A*; steps go through faces, not between two walls' edges.

    From outside of the map there is none; to a goal outside it leads to where the map ends before it.
    """
    start, (i, j, k) = _cell(maps, m, place), _cell(maps, m, goal)
    end = (min(max(i, 0), NUM_X - 1), min(max(j, 0), NUM_Y - 1), min(max(k, 0), NUM_Z - 1))
    if not _is_in(start[0], start[1], start[2]):
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
            if not _is_in(a, b, c):
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
def _cell(maps, m, place):  # type: ignore[no-untyped-def]
    return _cell_at(maps, m, place[0], place[1], place[2])


@numba.njit(cache=True, nogil=True)
def _along(maps, m, place, way, share):  # type: ignore[no-untyped-def]
    """Return the cell of `place` and a share of a way, without arrays, which would take most of the time."""
    return _cell_at(maps, m, place[0] + way[0] * share, place[1] + way[1] * share, place[2] + way[2] * share)


@numba.njit(cache=True, nogil=True)
def _cell_at(maps, m, x, y, z):  # type: ignore[no-untyped-def]
    return (
        int(np.floor((x - maps.origins[m, 0]) / CELL)) + NUM_X // 2,
        int(np.floor((y - maps.origins[m, 1]) / CELL)) + NUM_Y // 2,
        int(np.floor((z - maps.origins[m, 2]) / CELL)) + NUM_Z // 2,
    )


@numba.njit(cache=True, nogil=True)
def _is_in(i, j, k):  # type: ignore[no-untyped-def]
    return 0 <= i < NUM_X and 0 <= j < NUM_Y and 0 <= k < NUM_Z


@numba.njit(cache=True, nogil=True)
def _number(i, j, k):  # type: ignore[no-untyped-def]
    return np.int64((i * NUM_Y + j) * NUM_Z + k)


@numba.njit(cache=True, nogil=True)
def _unnumbered(n):  # type: ignore[no-untyped-def]
    return n // (NUM_Y * NUM_Z), n // NUM_Z % NUM_Y, n % NUM_Z


@numba.njit(cache=True, nogil=True)
def _within(i, j, k):  # type: ignore[no-untyped-def]
    return ((i % BLOCK) * BLOCK + j % BLOCK) * BLOCK + k % BLOCK


@numba.njit(cache=True, nogil=True)
def evidence(maps, m, i, j, k):  # type: ignore[no-untyped-def]
    """Return what is known of a cell: above 0 a wall, below 0 water."""
    block = maps.numbers[m, i // BLOCK, j // BLOCK, k // BLOCK]
    return 0 if block == 0 else maps.blocks[m, block - 1, _within(i, j, k)]


@numba.njit(cache=True, nogil=True)
def _block(maps, m, i, j, k):  # type: ignore[no-untyped-def]
    """Return the block that a cell is in, made where there is none; -1 outside of the map, and where it is full."""
    if not _is_in(i, j, k):
        return -1
    a, b, c = i // BLOCK, j // BLOCK, k // BLOCK
    if maps.numbers[m, a, b, c] == 0:
        if maps.counts[m] == MOST_BLOCKS:
            return -1
        maps.places[m, maps.counts[m]] = a, b, c
        maps.counts[m] += 1
        maps.numbers[m, a, b, c] = maps.counts[m]
    return maps.numbers[m, a, b, c] - 1


@numba.njit(cache=True, nogil=True)
def _visit(maps, m, i, j, k):  # type: ignore[no-untyped-def]
    block = _block(maps, m, i, j, k)
    if block >= 0:
        maps.blocks[m, block, _within(i, j, k)] = VISITED


@numba.njit(cache=True, nogil=True)
def _add(maps, m, i, j, k, more):  # type: ignore[no-untyped-def]
    block = _block(maps, m, i, j, k)
    if block >= 0:
        n = _within(i, j, k)
        known = maps.blocks[m, block, n]
        if known != VISITED and (more != GUESSED or known == 0):
            maps.blocks[m, block, n] = min(HIGHEST, max(LOWEST, known + more))


@numba.njit(cache=True, nogil=True)
def _add_wall(maps, m, i, j, k):  # type: ignore[no-untyped-def]
    """Count the end of a ray, and guess that the wall goes on around there where nothing is known."""
    _add(maps, m, i, j, k, ENDED)
    for a in range(-AROUND_WALL, AROUND_WALL + 1):
        for b in range(-AROUND_WALL, AROUND_WALL + 1):
            for c in range(-AROUND_WALL, AROUND_WALL + 1):
                if 0 < a * a + b * b + c * c <= AROUND_WALL * AROUND_WALL:
                    _add(maps, m, i + a, j + b, k + c, GUESSED)


@numba.njit(cache=True, nogil=True)
def _is_clear(maps, m, place, point):  # type: ignore[no-untyped-def]
    """Return whether no known or guessed wall is on a straight line, m."""
    way = point - place
    num = int(np.sqrt((way * way).sum()) / (0.5 * CELL)) + 1
    for n in range(num + 1):
        i, j, k = _along(maps, m, place, way, n / num)
        if not _is_in(i, j, k):
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
