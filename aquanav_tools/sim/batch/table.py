"""Arrays of structures on a device, with a row for each cave of a batch, which others may take the place of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import warp as wp


class StructTable:
    """Structures and the array of them that kernels read.

    Both are kept: the array does not keep alive what structures point to.
    """

    def __init__(self, kind: Any, rows: Sequence[Any], device: Any) -> None:
        """Bring structures of one kind to a device."""
        self._kind, self._device = kind, device
        self.rows = list(rows)
        self.array = wp.array(self.rows, dtype=kind, device=device)
        """(C,) on the device, always in the same memory: launches may be recorded with it."""

    def put(self, row: int, value: Any) -> None:
        """Put a structure in the place of another one, of which no kernel that runs may know."""
        rows = [*self.rows[:row], value, *self.rows[row + 1 :]]
        self.array.assign(wp.array(rows, dtype=self._kind, device=self._device))
        self.rows = rows
