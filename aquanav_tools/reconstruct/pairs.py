"""Which photos are worth comparing: neighbours in time, and those that look alike wherever they come in the sequence.

Likeness is counted on each photo's coarsest keypoints, which tell overlap nearly as well as all of them for a fiftieth
of the work and need no vocabulary (preemptive matching; Wu, Towards Linear-Time Incremental Structure from Motion,
3DV 2013).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.types import BoolArray

Counts = npt.NDArray[np.int64]
Words = npt.NDArray[np.float32]
Pair = tuple[int, int]
"""Two photos, by their places in the sequence, the earlier one first."""

_COARSEST = 256
"""Keypoints per photo that likeness is counted on."""
_MAX_RATIO = 0.8
"""Of a keypoint's distance to its best match over that to the second best (Lowe, IJCV 2004)."""


def near_pairs(count: int, overlap: int) -> set[Pair]:
    """Return the pairs of a sequence up to `overlap` places apart, and those 2, 4, 8, ... apart up to 2^overlap."""
    steps = set(range(1, overlap + 1)) | {2**power for power in range(overlap)}
    return {(i, i + step) for step in steps for i in range(count - step)}


def alike_pairs(likeness: Counts, most: int) -> set[Pair]:
    """Return the pairs of each photo with the `most` photos that it resembles most; (N, N) likeness."""
    pairs: set[Pair] = set()
    for i, row in enumerate(likeness):
        best = np.argsort(-row, kind="stable")[:most]
        pairs |= {(min(i, int(j)), max(i, int(j))) for j in best if row[j] > 0}
    return pairs


def friends_of_friends(verified: BoolArray, most: int) -> set[Pair]:
    """Return pairs that share neighbours: of each photo, those with the `most` photos that share most, two or more.

    Args:
        verified: (N, N) symmetric; which photos overlap as far as known.
        most: of new pairs per photo.
    """
    shared = verified.astype(np.int64) @ verified.astype(np.int64)
    shared[verified | (shared < 2)] = 0
    np.fill_diagonal(shared, 0)
    return alike_pairs(shared, most)


def bridging_pairs(verified: BoolArray, likeness: Counts, most: int) -> set[Pair]:
    """Return pairs between groups that do not hang together yet: of each photo, with those it resembles most.

    Args:
        verified: (N, N) symmetric; which photos overlap as far as known.
        likeness: (N, N).
        most: of pairs per photo.
    """
    from scipy.sparse.csgraph import connected_components

    _, labels = connected_components(verified, directed=False)
    return alike_pairs(np.where(labels[:, None] == labels, 0, likeness + 1), most)


def count_likeness(database: Path, names: Sequence[str]) -> Counts:
    """Return (N, N) how many of the coarsest keypoints of two photos are each other's clearly best match."""
    with load_pycolmap().Database.open(database) as store:
        ids = [store.read_image_with_name(name).image_id for name in names]
        return likeness_of([coarsest(store.read_keypoints(i), store.read_descriptors(i)) for i in ids])


def likeness_of(words: Sequence[Words]) -> Counts:
    """Return the same of photos given by what `coarsest` returns of them."""
    likeness = np.zeros((len(words), len(words)), np.int64)
    for i in range(len(words)):
        for j in range(i):
            likeness[i, j] = likeness[j, i] = _mutual(words[i] @ words[j].T)
    return likeness


def coarsest(keypoints: Any, descriptors: Any) -> Words:
    """Return (K, 128) unit descriptors of a photo's largest keypoints; zeros where it has fewer.

    Args:
        keypoints: (L, 4 or 6) as COLMAP keeps them.
        descriptors: pycolmap.FeatureDescriptors.
    """
    words = np.zeros((_COARSEST, 128), np.float32)
    rows = np.asarray(keypoints)
    if len(rows):
        chosen = np.asarray(descriptors.data)[largest(rows, _COARSEST)].astype(np.float32)
        words[: len(chosen)] = chosen / np.maximum(np.linalg.norm(chosen, axis=1, keepdims=True), 1.0)
    return words


def largest(keypoints: npt.NDArray[np.float32], most: int) -> Counts:
    """Return the rows of the largest of (K, 4 or 6) keypoints, the largest first."""
    return np.argsort(-np.hypot(keypoints[:, 2], keypoints[:, 3]), kind="stable")[:most]


def _mutual(cosines: npt.NDArray[np.float32]) -> int:
    """Return the matches in (K, K) cosines that are best both ways and pass the ratio test one way."""
    rows = np.arange(len(cosines))
    best, back = cosines.argmax(axis=1), cosines.argmax(axis=0)
    first = cosines[rows, best]
    is_mutual = back[best] == rows
    rest = cosines[is_mutual]
    rest[np.arange(len(rest)), best[is_mutual]] = -1.0
    second = rest.max(axis=1, initial=-1.0)
    return int(np.count_nonzero(1.0 - first[is_mutual] < _MAX_RATIO**2 * (1.0 - second)))
