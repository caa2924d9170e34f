"""Which photos are worth comparing: neighbours in time, and those that look alike wherever they come in the sequence.

Likeness is counted on each photo's coarsest keypoints, which tell overlap nearly as well as all of them for a fiftieth
of the work and need no vocabulary (preemptive matching; Wu, Towards Linear-Time Incremental Structure from Motion,
3DV 2013).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numba
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
_AT_ONCE = 64
"""Photos that one is compared with at once: one product of matrices for all of them, 17 MB."""
_ENOUGH = 12
"""Photos that one overlaps with. Of 120 photos of the demo's cave, 1,418 pairs were compared without this limit, 1,121
with it; those left out had a quarter of the others' matches, and cameras came out as exact (0.8 mm off on average)."""
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

    Photos that overlap with ENOUGH others already ask for none: what they would get has few matches.

    Args:
        verified: (N, N) symmetric; which photos overlap as far as known.
        most: of new pairs per photo.
    """
    shared = verified.astype(np.int64) @ verified.astype(np.int64)
    shared[verified | (shared < 2)] = 0
    np.fill_diagonal(shared, 0)
    shared[verified.sum(axis=1) >= _ENOUGH] = 0
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
    every = np.concatenate(words) if words else np.zeros((0, 128), np.float32)
    for i in range(1, len(words)):
        for first in range(0, i, _AT_ONCE):
            last = min(first + _AT_ONCE, i)
            likeness[i, first:last] = _num_mutual(words[i] @ every[first * _COARSEST : last * _COARSEST].T)
    return likeness + likeness.T


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


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _num_mutual(cosines):  # type: ignore[no-untyped-def]
    """Return (P,) how many matches of a photo with each of P others are best both ways and clear one way.

    Args:
        cosines: (_COARSEST, P * _COARSEST) of its words with theirs.
    """
    counts = np.zeros(cosines.shape[1] // _COARSEST, np.int64)
    for photo in numba.prange(len(counts)):
        best, back = np.full((2, _COARSEST), np.float32(-2.0))
        second = np.full(_COARSEST, np.float32(-1.0))
        match, match_back = np.zeros((2, _COARSEST), np.int64)
        for row in range(_COARSEST):
            for column in range(_COARSEST):
                cosine = cosines[row, photo * _COARSEST + column]
                if cosine > best[row]:
                    second[row] = max(second[row], best[row])
                    best[row], match[row] = cosine, column
                elif cosine > second[row]:
                    second[row] = cosine
                if cosine > back[column]:
                    back[column], match_back[column] = cosine, row
        for row in range(_COARSEST):
            is_clear = 1.0 - best[row] < _MAX_RATIO**2 * (1.0 - second[row])
            counts[photo] += is_clear and match_back[match[row]] == row
    return counts
