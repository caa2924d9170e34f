"""Places of cameras that something else measured: a list, a satellite receiver, a depth sensor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.reconstruct.georeference.clues import Anchors
from aquanav_tools.reconstruct.georeference.rows import read_rows
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.types import Array

MIN_POSITIONS = 3
EVEN = (1.0, 1.0, 1.0)


@dataclass(frozen=True, eq=False)
class CameraPositions:
    """Where some photos were taken."""

    source: str
    """In the plural, as messages call them."""
    positions: Mapping[str, Array]
    """(3,) m by photo, in the order they were taken."""
    spread: tuple[float, float, float] = EVEN
    """Errors of the axes relative to each other; infinite where unknown."""

    def clue(self, sparse: SparseModel) -> Anchors:
        """Return the positions of registered photos.

        Raises:
            InputError: fewer than MIN_POSITIONS registered photos have one.
        """
        place_of = dict(zip(sparse.names, sparse.centres, strict=True))
        known = tuple(name for name in self.positions if name in place_of)
        if len(known) < MIN_POSITIONS:
            raise InputError(
                f"Only {len(known)} of the {len(place_of)} registered photos have one of the {self.source}; "
                f"{MIN_POSITIONS} are needed, spread over the passage. Add some for photos that registered."
            )
        sfm = np.array([place_of[name] for name in known])
        world = np.array([self.positions[name] for name in known])
        return Anchors(self.source, known, sfm, world, np.array(self.spread))


def read_positions(path: Path, names: Sequence[str]) -> CameraPositions:
    """Return the camera positions listed in a CSV file with columns name, x, y, z (m, z up).

    Raises:
        InputError: the file cannot be read, lacks a column, holds something else than finite numbers, names a photo
            twice or one that is not among `names`.
    """
    positions: dict[str, Array] = {}
    for row in read_rows(path, ("name", "x", "y", "z"), "positions file"):
        name = row.cells["name"]
        if name not in names:
            raise InputError(f"{row.place}: no photo is called '{name}'.{did_you_mean(name, names)}")
        if name in positions:
            raise InputError(f"{row.place}: '{name}' is listed twice. Keep one of the two lines.")
        positions[name] = row.numbers("x y z")
    order = {name: index for index, name in enumerate(names)}
    return CameraPositions("camera positions", dict(sorted(positions.items(), key=lambda item: order[item[0]])))
