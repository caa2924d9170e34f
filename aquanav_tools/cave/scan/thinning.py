"""Thinning point clouds evenly while they are read: the first point of each cell of a grid stays."""

from __future__ import annotations

import numpy as np

from aquanav_tools.types import Array, IntArray

MAX_POINTS = 3_000_000
"""A cloud is thinned to this many: a point every 3 cm along 300 m of passage, half the finest voxel."""
CELL_GROWTH = np.sqrt(2.0)
"""A wall occupies half as many cells that are larger by this."""
NUM_SAMPLES = 100_000
"""Points that the size of the first cells is taken from."""
COARSE_CELLS = 64
KEY_BITS = 21
"""Of a cell's place along each axis in its key. Places farther apart share keys, but those are stray points."""


class EvenThinner:
    """Takes tables of points one after the other and keeps an even choice of at most `max_points`."""

    def __init__(self, max_points: int = MAX_POINTS) -> None:
        self.cell = 0.0
        """Edge of the cells, in the points' unit; 0 while everything is kept."""
        self.num_seen = 0
        self._max_points = max_points
        self._tables: list[Array] = []

    def add(self, table: Array) -> None:
        """Take an (N, C) table, x y z in its first columns."""
        self.num_seen += len(table)
        self._tables.append(self._thin(table) if self.cell else table)
        if sum(map(len, self._tables)) > 2 * self._max_points:
            self._tables = [self._all()]

    def result(self) -> Array:
        """Return the (K, C) rows that were kept, in the order they came."""
        return self._all()

    def _all(self) -> Array:
        table = np.concatenate(self._tables)
        if self.cell:
            table = self._thin(table)
        elif len(table) > self._max_points:
            self.cell = _first_cell(table[:, :3], self._max_points)
            table = self._thin(table)
        while len(table) > self._max_points:
            self.cell *= CELL_GROWTH
            table = self._thin(table)
        return table

    def _thin(self, table: Array) -> Array:
        _, first = np.unique(_keys(table[:, :3], self.cell), return_index=True)
        return table[np.sort(first)]


def thinned_caution(name: str, thinner: EvenThinner, num_kept: int) -> tuple[tuple[str, str], ...]:
    """Return the caution that a cloud was thinned, if it was."""
    if not thinner.cell:
        return ()
    sentence = (
        f"{name} has {thinner.num_seen / 1e6:.0f} million points; one was kept in each cell of {thinner.cell:.2g} (in "
        f"the file's unit), {num_kept / 1e6:.1f} million in all. Finer cells would not change the cave."
    )
    return (("thinned", sentence),)


def _first_cell(points: Array, wanted: int) -> float:
    """Return the edge of the cells of which a wall through the (N, 3) points occupies about as many as wanted."""
    spread = np.percentile(points[:: max(1, len(points) // NUM_SAMPLES)], [0.5, 99.5], axis=0)
    coarse = max(float(np.ptp(spread, axis=0).max()), 1e-9) / COARSE_CELLS
    return coarse * float(np.sqrt(len(np.unique(_keys(points, coarse))) / wanted))


def _keys(points: Array, cell: float) -> IntArray:
    """Return one number per point that tells its cell."""
    keys = np.zeros(len(points), dtype=np.int64)
    for axis in range(3):
        places = np.floor(points[:, axis] / cell).astype(np.int64)
        keys = (keys << KEY_BITS) | (places & (2**KEY_BITS - 1))
    return keys
