"""The water as a sparse set of grid samples that know their neighbours."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.types import Array, IntArray

OFFSETS: IntArray = np.delete(np.stack(np.unravel_index(np.arange(27), (3, 3, 3)), axis=1) - 1, 13, axis=0)
"""(26, 3) the neighbours of a sample; OFFSETS[25 - n] is opposite to OFFSETS[n]."""
FACE_OFFSETS = np.flatnonzero(np.abs(OFFSETS).sum(axis=1) == 1)
"""Which of them share a face."""
SAFE_CLEARANCE = 0.5 * np.sqrt(3.0)
"""Least clearance of a sample, in spacings: two neighbours are at most sqrt(3) apart, so that their balls then cover
the way between them and no two samples are joined through rock."""
MIN_SHARE = 0.01
"""Smaller parts than this share of the water are pockets behind squeezes too tight to sample; they are left out."""


Table = npt.NDArray[np.int32]
"""(N, K) row of each sample's neighbours, -1 where there is none."""


@dataclass(frozen=True, eq=False)
class Lattice:
    """Samples of water on a regular grid, in lexicographic order."""

    origin: Array
    """(3,) world position of index (0, 0, 0), m."""
    spacing: float
    """m."""
    indices: IntArray
    """(N, 3)."""
    clearance: Array
    """(N,) m."""
    neighbours: Table
    """(N, 26) sample in the direction of OFFSETS, -1 where there is none."""
    part: npt.NDArray[np.int32]
    """(N,) number of the connected part a sample is in, from 0."""

    @property
    def points(self) -> Array:
        """(N, 3) world, m."""
        world: Array = self.origin + self.spacing * self.indices
        return world

    def nearest(self, point: Array) -> int:
        """Return the sample nearest to a (3,) world point."""
        return int(np.argmin(((self.indices - (np.asarray(point) - self.origin) / self.spacing) ** 2).sum(axis=1)))


def sample_water(field: DistanceField, max_samples: int) -> Lattice:
    """Return every n-th sample of a field per axis that is wide enough, n as small as `max_samples` allows.

    Rock that floats in the water, attached by less than a sample shows, is drowned: nothing can turn around it that
    could not pass through its attachment.

    Raises:
        MeshError: no water is wide enough for the samples; the message says how wide, how far apart.
    """
    indices, clearance = field.water()
    stride = max(1, int(np.ceil(np.cbrt(len(indices) / max_samples))))
    spacing = stride * field.spacing
    kept = np.all(indices % stride == 0, axis=1) & (clearance >= SAFE_CLEARANCE * spacing)
    if not kept.any():
        raise MeshError(
            f"No water is wide enough for a centreline: the roomiest place has {field.max_clearance:.2f} m of "
            f"clearance, the samples are {spacing:.2f} m apart. Check --unit, or choose a smaller vehicle."
        )
    indices, clearance = _in_order(indices[kept] // stride, clearance[kept])
    indices, clearance, table = _without_small_parts(indices, clearance)
    indices, clearance, table = _drowned(indices, clearance, table)
    return Lattice(field.origin, spacing, indices, clearance, table, _parts(table))


def neighbour_table(indices: IntArray, offsets: IntArray) -> Table:
    """Return the (N, K) rows of the neighbours at (K, 3) offsets among lexicographic (N, 3) indices, -1 for none.

    The offsets must be symmetric: offsets[K - 1 - n] is opposite to offsets[n].
    """
    low = indices.min(axis=0) - 1
    shape = indices.max(axis=0) - low + 2
    stride = np.array([shape[1] * shape[2], shape[2], 1])
    keys = (indices - low) @ stride
    table = np.full((len(indices), len(offsets)), -1, dtype=np.int32)
    _note_neighbours(keys, (offsets @ stride)[: len(offsets) // 2], table)
    return table


@numba.njit(cache=True)
def _note_neighbours(keys, steps, table):  # type: ignore[no-untyped-def]
    """Note for each of the rising keys where the one that lies a step further is, and the way back."""
    for column in range(len(steps)):
        place = 0
        for row in range(len(keys)):
            while place < len(keys) - 1 and keys[place] < keys[row] + steps[column]:
                place += 1
            if keys[place] == keys[row] + steps[column]:
                table[row, column] = place
                table[place, -1 - column] = row


@numba.njit(cache=True)
def _parts(table):  # type: ignore[no-untyped-def]
    """Return the (N,) number of the connected part each row of a neighbour table is in, from 0."""
    part = np.full(len(table), -1, np.int32)
    todo = np.empty(len(table), np.int64)
    number = 0
    for first in range(len(table)):
        if part[first] >= 0:
            continue
        part[first], todo[0], size = number, first, 1
        while size > 0:
            size -= 1
            for other in table[todo[size]]:
                if other >= 0 and part[other] < 0:
                    part[other], todo[size] = number, other
                    size += 1
        number += 1
    return part


def _without_small_parts(indices: IntArray, clearance: Array) -> tuple[IntArray, Array, Table]:
    """Return the samples of large parts, and the table of their neighbours, who are all in the same part."""
    table = neighbour_table(indices, OFFSETS)
    part = _parts(table)
    kept = (np.bincount(part) >= MIN_SHARE * len(indices))[part]
    if not kept.all():
        table = _renumbered(table, kept, np.cumsum(kept, dtype=np.int32) - 1)
    return indices[kept], clearance[kept], table


@numba.njit(cache=True)
def _renumbered(table, kept, number):  # type: ignore[no-untyped-def]
    """Return the rows of a table that are kept, with their new numbers; neighbours are kept together."""
    fewer = np.empty((number[-1] + 1, table.shape[1]), np.int32)
    for row in range(len(table)):
        if kept[row]:
            for n in range(table.shape[1]):
                other = table[row, n]
                fewer[number[row], n] = number[other] if other >= 0 else -1
    return fewer


def _drowned(indices: IntArray, clearance: Array, table: Table) -> tuple[IntArray, Array, Table]:
    """Return the samples with those in floating rock added, layer by layer, and the table of their neighbours."""
    while True:
        rock = _shore(indices, table)
        shore = _parts(neighbour_table(rock, OFFSETS[FACE_OFFSETS]))
        # West of a part's first sample in order lies the rock around that part.
        firsts = indices[np.unique(_parts(table), return_index=True)[1]]
        around = [shore[np.flatnonzero((rock == first - [1, 0, 0]).all(axis=1))[0]] for first in firsts]
        floating = ~np.isin(shore, around)
        if not floating.any():
            return indices, clearance, table
        drowned = np.zeros(int(floating.sum()))
        indices, clearance = _in_order(np.concatenate([indices, rock[floating]]), np.append(clearance, drowned))
        table = neighbour_table(indices, OFFSETS)


def _shore(indices: IntArray, table: Table) -> IntArray:
    """Return the (R, 3) samples of rock beside water, in lexicographic order."""
    rows, columns = np.nonzero(table < 0)
    rock = indices[rows] + OFFSETS[columns]
    low = rock.min(axis=0)
    shape = np.ptp(rock, axis=0) + 1
    keys = np.sort((rock - low) @ np.array([shape[1] * shape[2], shape[2], 1]))
    keys = keys[np.diff(keys, prepend=-1) > 0]
    return np.stack(np.unravel_index(keys, tuple(int(n) for n in shape)), axis=1) + low


def _in_order(indices: IntArray, clearance: Array) -> tuple[IntArray, Array]:
    order = np.lexsort(indices.T[::-1])
    return indices[order], clearance[order]
