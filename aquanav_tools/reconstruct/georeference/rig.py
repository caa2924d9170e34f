"""Two cameras on one bar: every pair of photos repeats the same known distance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.georeference.clues import Lengths
from aquanav_tools.reconstruct.mapping import SparseModel

BAR_ERROR = 0.005
"""Standard deviation of the distance between two cameras' entrance pupils measured from outside, relative; chosen:
1.5 mm of 30 cm. All pairs share it."""


@dataclass(frozen=True)
class RigPairs:
    """Photos taken at the same time by two cameras."""

    pairs: tuple[tuple[str, str], ...]
    baseline: float
    """Between the cameras, m."""

    def clue(self, sparse: SparseModel) -> Lengths:
        """Return the distance of the pair's cameras in the model beside the true one.

        The pairs are one observation: their median, with its scatter and the error that they share.

        Raises:
            InputError: fewer than three pairs registered.
        """
        place_of = dict(zip(sparse.names, sparse.centres, strict=True))
        registered = [(a, b) for a, b in self.pairs if a in place_of and b in place_of]
        if len(registered) < 3:
            raise InputError(
                f"Only {len(registered)} of {len(self.pairs)} pairs of photos registered with both photos; three are "
                "needed. Photograph rock that both cameras see, or give another source of scale."
            )
        lengths = np.array([np.linalg.norm(place_of[a] - place_of[b]) for a, b in registered])
        middle = float(np.median(lengths))
        scatter = 1.4826 * float(np.median(np.abs(lengths - middle))) / middle
        # A median scatters 1.25 times as much as a mean.
        error = np.hypot(1.2533 * scatter / np.sqrt(len(lengths)), BAR_ERROR)
        label = (f"{len(registered)} pairs",)
        return Lengths("camera pairs", label, np.array([middle]), np.array([self.baseline]), np.array([error]))


def read_rig(first: str, second: str, baseline: float, names: Sequence[str]) -> RigPairs:
    """Return the pairs of photos whose names differ as two patterns with one * each do.

    Raises:
        InputError: a pattern has no *, or no photo has a partner.
    """
    for pattern in (first, second):
        if pattern.count("*") != 1:
            raise InputError(f"The name pattern '{pattern}' needs one * for what a pair shares, as in left_*.jpg.")
    ones, others = _shared(first, names), _shared(second, names)
    pairs = tuple((ones[key], others[key]) for key in ones if key in others)
    if not pairs:
        raise InputError(
            f"{len(ones)} photos are named {first} and {len(others)} {second}, but none of them is a pair: what stands "
            "for the * must be the same in both. Rename the photos of one camera."
        )
    return RigPairs(pairs, baseline)


def _shared(pattern: str, names: Sequence[str]) -> dict[str, str]:
    head, tail = pattern.split("*")
    length = len(head) + len(tail)
    fitting = [name for name in names if name.startswith(head) and name.endswith(tail) and len(name) > length]
    return {name[len(head) : len(name) - len(tail)]: name for name in fitting}
