"""What range rays have met so far, as sparse grids of cells.

A cell keeps evidence, as OctoMap does (Hornung, Wurm, Bennewitz, Stachniss and Burgard, Autonomous Robots 34, 2013): a
ray that goes through it counts for water, one that ends in it for wall, so that a cell which is half rock closes no
narrow passage for good. Around a wall more wall is guessed where nothing is known: rays leave gaps. Cells are kept in
blocks, made where something was met (as in voxel hashing: Niessner, Zollhoefer, Izadi and Stamminger, ACM TOG 2013):
what is kept grows with the passage, not with the space around it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import ResourceError
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
SHY = 0.2
"""A ray's last stretch that frees no cell, m: beside a wall, cells are half rock."""
NO_ECHO = 1.0 - 1e-3
"""Share of a ray's reach from which it met nothing."""
MOST_AHEAD = 96
"""Cells of a way that are kept."""
AROUND_GOAL = 3
"""Steps from the goal within which there is water: where it lies at a wall, a ray may end in its own cell."""
LEAST_AROUND, MOST_AROUND = 2, 5
"""Cells from a wall within which walls are guessed where nothing is known."""
SPREAD = 0.18
"""The same as a share of the ray's length: half of what lies between two of 96 beams all around, 20 degrees apart."""
PASSED, ENDED, GUESSED = -2, 4, 1
"""What a ray that goes through a cell adds to its evidence, one that ends there, and one that ends close by where there
is none: OctoMap's odds, 0.4 and 0.7, in a fifth of their logarithms."""
LOWEST, HIGHEST = -10, 17
"""Between which evidence stays, OctoMap's too: 0.12 and 0.97. Above 0 there is a wall, below 0 water."""
VISITED, ASTERN = -128, 127
"""Evidence that stays: of where the vehicle was and the water around the goal, and of what closes the way back from
where it began."""
ASTERN_DISTANCE, ASTERN_SIZE = 0.9, 3.0
"""Where that is, a vertical square astern, and how far it reaches to each side, up and down, m."""


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
            f"Maps of {num} vehicles reserve {num * RESERVED / 1e9:.1f} GB, which this machine lacks. Take fewer "
            "vehicles at once."
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
def begin(maps, m, place, goal, heading):  # type: ignore[no-untyped-def]
    """Let map `m` begin at (3,) `place` with nothing known but where the vehicle came from and where it goes.

    Around the (3,) goal, m, there is water; from astern of the heading, from x towards y, rad, it has come.
    """
    for b in range(maps.counts[m]):
        maps.numbers[m, maps.places[m, b, 0], maps.places[m, b, 1], maps.places[m, b, 2]] = 0
        maps.blocks[m, b] = 0
    maps.counts[m], maps.lengths[m] = 0, 0
    maps.origins[m] = place
    i, j, k = cell_of(maps, m, goal)
    for a in range(-AROUND_GOAL, AROUND_GOAL + 1):
        for b in range(-AROUND_GOAL, AROUND_GOAL + 1):
            for c in range(-AROUND_GOAL, AROUND_GOAL + 1):
                if abs(a) + abs(b) + abs(c) <= AROUND_GOAL:
                    _visit(maps, m, i + a, j + b, k + c)
    _close_astern(maps, m, place, heading)


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
        _pass(maps, m, place, rays[r], free)
        if has_echo:
            i, j, k = cell_along(maps, m, place, rays[r], ranges[r])
            _add_wall(maps, m, i, j, k, min(MOST_AROUND, max(LEAST_AROUND, int(SPREAD * ranges[r] / CELL))))


@numba.njit(cache=True, nogil=True)
def be_at(maps, m, place):  # type: ignore[no-untyped-def]
    """Note where the vehicle is: to be called at every decision. Who swims back past the start may come back there."""
    i, j, k = cell_of(maps, m, place)
    if is_in(i, j, k) and evidence(maps, m, i, j, k) == ASTERN:
        _open_astern(maps, m)
    _visit(maps, m, i, j, k)


@numba.njit(cache=True, nogil=True)
def _pass(maps, m, place, ray, free):  # type: ignore[no-untyped-def]
    """Count the cells of a ray's first so many metres for water (Amanatides and Woo, Eurographics 1987)."""
    i, j, k = cell_of(maps, m, place)
    i_end, j_end, k_end = cell_along(maps, m, place, ray, free)
    x, x_more = _faces(maps.origins[m, 0], place[0], ray[0], i - NUM_X // 2)
    y, y_more = _faces(maps.origins[m, 1], place[1], ray[1], j - NUM_Y // 2)
    z, z_more = _faces(maps.origins[m, 2], place[2], ray[2], k - NUM_Z // 2)
    block, a, b, c = -1, -1, -1, -1
    for _ in range(abs(i_end - i) + abs(j_end - j) + abs(k_end - k) + 1):
        if i // BLOCK != a or j // BLOCK != b or k // BLOCK != c:
            a, b, c = i // BLOCK, j // BLOCK, k // BLOCK
            block = _block(maps, m, i, j, k)
        if block >= 0:
            n = within(i, j, k)
            known = maps.blocks[m, block, n]
            if known != VISITED and known != ASTERN:
                maps.blocks[m, block, n] = max(LOWEST, known + PASSED)
        if x <= y and x <= z:
            i, x = i + (1 if ray[0] > 0.0 else -1), x + x_more
        elif y <= z:
            j, y = j + (1 if ray[1] > 0.0 else -1), y + y_more
        else:
            k, z = k + (1 if ray[2] > 0.0 else -1), z + z_more


@numba.njit(cache=True, nogil=True)
def _faces(origin, start, along, cell):  # type: ignore[no-untyped-def]
    """Return how far along a ray the next face across an axis is, and how far it is from each to the next, m."""
    if along == 0.0:
        return np.inf, np.inf
    face = origin + (cell + (along > 0.0)) * CELL
    return (face - start) / along, CELL / abs(along)


@numba.njit(cache=True, nogil=True)
def cell_of(maps, m, place):  # type: ignore[no-untyped-def]
    """Return the cell of (3,) `place`, m."""
    return _cell_at(maps, m, place[0], place[1], place[2])


@numba.njit(cache=True, nogil=True)
def cell_along(maps, m, place, way, share):  # type: ignore[no-untyped-def]
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
def is_in(i, j, k):  # type: ignore[no-untyped-def]
    """Return whether a cell is in the map."""
    return 0 <= i < NUM_X and 0 <= j < NUM_Y and 0 <= k < NUM_Z


@numba.njit(cache=True, nogil=True)
def within(i, j, k):  # type: ignore[no-untyped-def]
    """Return which cell of its block a cell is."""
    return ((i % BLOCK) * BLOCK + j % BLOCK) * BLOCK + k % BLOCK


@numba.njit(cache=True, nogil=True)
def evidence(maps, m, i, j, k):  # type: ignore[no-untyped-def]
    """Return what is known of a cell: above 0 a wall, below 0 water."""
    block = maps.numbers[m, i // BLOCK, j // BLOCK, k // BLOCK]
    return 0 if block == 0 else maps.blocks[m, block - 1, within(i, j, k)]


@numba.njit(cache=True, nogil=True)
def _block(maps, m, i, j, k):  # type: ignore[no-untyped-def]
    """Return the block that a cell is in, made where there is none; -1 outside of the map, and where it is full."""
    if not is_in(i, j, k):
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
        maps.blocks[m, block, within(i, j, k)] = VISITED


@numba.njit(cache=True, nogil=True)
def _close_astern(maps, m, place, heading):  # type: ignore[no-untyped-def]
    """Keep ways from leading back past the start: what lies there is unknown, and often nearer to the goal."""
    c, s = np.cos(heading), np.sin(heading)
    num = int(ASTERN_SIZE / (0.5 * CELL))
    for back in (ASTERN_DISTANCE, ASTERN_DISTANCE + CELL):  # so thick that a vehicle is met in it
        for a in range(-num, num):
            left = 0.5 * CELL * (a + 0.5)
            for b in range(-num, num):
                x, y = place[0] - back * c - left * s, place[1] - back * s + left * c
                i, j, k = _cell_at(maps, m, x, y, place[2] + 0.5 * CELL * (b + 0.5))
                block = _block(maps, m, i, j, k)
                if block >= 0 and maps.blocks[m, block, within(i, j, k)] != VISITED:
                    maps.blocks[m, block, within(i, j, k)] = ASTERN


@numba.njit(cache=True, nogil=True)
def _open_astern(maps, m):  # type: ignore[no-untyped-def]
    for b in range(maps.counts[m]):
        for n in range(BLOCK**3):
            if maps.blocks[m, b, n] == ASTERN:
                maps.blocks[m, b, n] = 0


@numba.njit(cache=True, nogil=True)
def _add(maps, m, i, j, k, more):  # type: ignore[no-untyped-def]
    block = _block(maps, m, i, j, k)
    if block >= 0:
        n = within(i, j, k)
        known = maps.blocks[m, block, n]
        if known != VISITED and known != ASTERN and (more != GUESSED or known == 0):
            maps.blocks[m, block, n] = min(HIGHEST, max(LOWEST, known + more))


@numba.njit(cache=True, nogil=True)
def _add_wall(maps, m, i, j, k, around):  # type: ignore[no-untyped-def]
    """Count the end of a ray, and guess once that the wall goes on around there where nothing is known."""
    if not is_in(i, j, k):
        return
    was_wall = evidence(maps, m, i, j, k) >= ENDED
    _add(maps, m, i, j, k, ENDED)
    if was_wall:
        return
    for a in range(-around, around + 1):
        for b in range(-around, around + 1):
            for c in range(-around, around + 1):
                if 0 < a * a + b * b + c * c <= around * around:
                    _add(maps, m, i + a, j + b, k + c, GUESSED)
