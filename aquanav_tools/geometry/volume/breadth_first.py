"""Which of several places is nearest by way of the water: a breadth-first search from a point."""

from __future__ import annotations

import numpy as np

from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.types import Array, BoolArray, IntArray

SAFE_CLEARANCE = float(0.5 * np.sqrt(3.0))
"""Least clearance of a sample that is searched, spacings: the balls of two neighbours then cover the way between them,
so that no search leaks through rock that is thinner than the spacing."""
BITS = 20
"""A sample's index takes this many bits per axis in its key: a million samples."""
AXES: IntArray = np.array([1 << 2 * BITS, 1 << BITS, 1])
CORNERS: IntArray = np.indices((2, 2, 2)).reshape(3, 8).T
AROUND: IntArray = np.indices((3, 3, 3)).reshape(3, 27).T - 1


def nearest_through_water(point: Array, targets: Array, field: DistanceField) -> int | None:
    """Return which of (T, 3) targets is nearest to a (3,) point through the water, or None when there is no way.

    When the nearest in a straight line is in sight, it is that one. Otherwise it is the one that is met first by a
    search that spreads by one sample in all directions at a time; of several met at once, the one in their middle.
    Places tighter than SAFE_CLEARANCE are not searched.
    """
    nearest = int(np.argmin(np.linalg.norm(targets - point, axis=1)))
    if _sees(np.asarray(point), targets[nearest], field):
        return nearest
    target_keys = np.rint((targets - field.origin) / field.spacing).astype(np.int64) @ AXES
    cell = np.floor((np.asarray(point) - field.origin) / field.spacing).astype(np.int64)
    front, before = _wide_enough((cell + CORNERS) @ AXES, field), np.zeros(0, dtype=np.int64)
    while len(front):
        met = np.flatnonzero(_is_in(target_keys, front))
        if len(met):
            return int(met[len(met) // 2])
        beside = _sorted_once((front[:, None] + AROUND @ AXES).ravel())
        # Samples beside the front lie in it, in the one before, or ahead.
        is_new = ~_is_in(beside, front) & ~_is_in(beside, before)
        front, before = _wide_enough(beside[is_new], field), front
    return None


def _sorted_once(keys: IntArray) -> IntArray:
    """Return keys in order, each once: `np.unique`, which hashes integers and takes five times as long here."""
    keys = np.sort(keys)
    return keys[np.append(True, keys[1:] != keys[:-1])]


def _is_in(keys: IntArray, ordered: IntArray) -> BoolArray:
    """Return which keys are among others that are in order: `np.isin`, which would sort them again."""
    if not len(ordered):
        return np.zeros(len(keys), dtype=bool)
    places = np.minimum(np.searchsorted(ordered, keys), len(ordered) - 1)
    return ordered[places] == keys


def _wide_enough(keys: IntArray, field: DistanceField) -> IntArray:
    indices = np.stack([keys >> 2 * BITS, (keys >> BITS) % (1 << BITS), keys % (1 << BITS)], axis=1)
    wide: IntArray = keys[field.clearance(field.positions(indices)) >= SAFE_CLEARANCE * field.spacing]
    return wide


def _sees(point: Array, target: Array, field: DistanceField) -> bool:
    count = 2 + int(np.linalg.norm(target - point) / field.spacing)
    line = point + np.linspace(0.0, 1.0, count)[:, None] * (target - point)
    return bool((field.clearance(line) >= SAFE_CLEARANCE * field.spacing).all())
