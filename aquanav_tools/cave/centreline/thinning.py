"""Thinning: taking water away sample by sample, outermost first, without changing how it hangs together."""

from __future__ import annotations

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.centreline.lattice import FACE_OFFSETS, OFFSETS, Lattice
from aquanav_tools.types import BoolArray, IntArray

LEVELS_PER_SAMPLE = 4
"""Samples are taken away by layers of clearance this much thinner than a spacing: thin enough to keep the order,
thick enough that noise in the clearance does not decide it."""


def thin(lattice: Lattice, anchors: IntArray) -> BoolArray:
    """Return (N,) which samples are left when no more can be taken away around the anchors (sample numbers).

    Samples go in the order of their clearance and only when simple (Bertrand): taking them changes neither the parts
    nor the handles of the water (26 neighbours) or of the rock (6 neighbours). What is left is a curve skeleton that
    joins the anchors along the roomiest way, turns around every pillar once, and has no other ends.
    """
    level = np.floor(LEVELS_PER_SAMPLE * lattice.clearance / lattice.spacing).astype(np.int32)
    order = np.argsort(level, kind="stable")
    is_kept = np.zeros(len(level), dtype=bool)
    is_kept[anchors] = True
    return _thin(lattice.neighbours, level, order, is_kept, _touching(3), _touching(1), _FACES, _EDGES)


def _touching(most: int) -> npt.NDArray[np.int64]:
    """Return for each of the 26 offsets the bits of those at most `most` unit steps from it, within one cell."""
    apart = np.abs(OFFSETS[:, None] - OFFSETS[None])
    is_near = (apart.max(axis=2) == 1) & (apart.sum(axis=2) <= most)
    return (is_near.astype(np.int64) << np.arange(26)).sum(axis=1)


_FACES = int(sum(1 << int(n) for n in FACE_OFFSETS))
"""Bits of the 6 neighbours that share a face."""
_EDGES = int(sum(1 << n for n in range(26) if np.abs(OFFSETS[n]).sum() <= 2))
"""Bits of the 18 neighbours that share a face or an edge."""


@numba.njit(cache=True)
def _thin(neighbours, level, order, is_kept, touching, facing, faces, edges):  # type: ignore[no-untyped-def]
    is_left = np.ones(len(level), np.bool_)
    is_queued = np.zeros(len(level), np.bool_)
    queue = np.empty(len(level), np.int64)
    first = 0
    while first < len(order):
        current, size = level[order[first]], 0
        while first < len(order) and level[order[first]] == current:
            if is_left[order[first]] and not is_queued[order[first]]:
                queue[size] = order[first]
                is_queued[order[first]] = True
                size += 1
            first += 1
        _peel(neighbours, level, queue, size, current, is_left, is_queued, is_kept, touching, facing, faces, edges)
    return is_left


@numba.njit(cache=True)
def _peel(neighbours, level, queue, size, current, is_left, is_queued, is_kept, touching, facing, faces, edges):  # type: ignore[no-untyped-def]
    """Take away the queued samples that are simple, and lower ones that thereby become simple."""
    head, capacity = 0, len(queue)
    while size > 0:
        sample = queue[head]
        head, size = (head + 1) % capacity, size - 1
        is_queued[sample] = False
        if is_kept[sample] or not _is_simple(_around(neighbours, is_left, sample), touching, facing, faces, edges):
            continue
        is_left[sample] = False
        for other in neighbours[sample]:
            if other >= 0 and is_left[other] and not is_queued[other] and level[other] <= current:
                queue[(head + size) % capacity] = other
                is_queued[other] = True
                size += 1


@numba.njit(cache=True)
def _around(neighbours, is_left, sample):  # type: ignore[no-untyped-def]
    """Return the bits of the neighbours that are still there."""
    bits = 0
    for n in range(26):
        other = neighbours[sample, n]
        if other >= 0 and is_left[other]:
            bits |= 1 << n
    return bits


@numba.njit(cache=True)
def _is_simple(water, touching, facing, faces, edges):  # type: ignore[no-untyped-def]
    """Return whether the water among the 26 neighbours is one piece, and the rock among the 18 that meets a face."""
    rock = ~water & edges
    if water == 0 or rock & faces == 0:
        return False
    if _piece(water, touching, water & -water) != water:
        return False
    seed = rock & faces
    return (rock & faces) & ~_piece(rock, facing, seed & -seed) == 0


@numba.njit(cache=True)
def _piece(bits, adjacency, seed):  # type: ignore[no-untyped-def]
    """Return the bits that can be reached from a seed bit."""
    reached, fresh = seed, seed
    while fresh:
        grown = 0
        for n in range(26):
            if fresh >> n & 1:
                grown |= adjacency[n]
        fresh = grown & bits & ~reached
        reached |= fresh
    return reached
