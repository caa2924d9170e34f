"""Which photos show the same: by small copies, cheap enough to look before hours of work."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from aquanav_tools.reconstruct.intake.decode import GreyImage
from aquanav_tools.types import BoolArray, Progress, ignore_progress

REACH = 6
"""Photos that each one is compared with until one overlaps: a station may be photographed all around."""
_NUM_KEYPOINTS = 400
_SHRINK = 0.8
"""Of the small copies once more: keypoints are most of the cost."""
_MAX_RATIO = 0.85
"""Of a keypoint's distance to its best match over that to the second best (Lowe, IJCV 2004)."""
_MIN_INLIERS = 15
"""Matches that must fit one rigid scene. Pairs of photos of different places reach 10 (measured, 192 pairs)."""
_TOLERANCE_PX = 1.5
"""From the epipolar line."""
_SAME_BITS = 4
"""Of 64, that the hashes of one picture saved twice may differ in."""
_SAME_GREY = 2.0
"""Mean difference of two small copies, of 255, up to which they count as one picture saved twice."""
_STILL_GREY = 4.0
"""The same for photos taken from one place."""


@dataclass(frozen=True, eq=False)
class _Keypoints:
    places: npt.NDArray[np.float32]
    """(K, 2) px."""
    descriptors: npt.NDArray[np.float32]
    """(K, 128) unit vectors (RootSIFT)."""


def find_copies(pictures: Sequence[GreyImage]) -> list[tuple[int, int]]:
    """Return (copy, original) for every picture that shows exactly what an earlier one does.

    Candidates have nearly the same difference hash: whether each of 8 x 8 cells is brighter than the next.
    """
    hashes = np.array([_hash(picture) for picture in pictures])
    copies: list[tuple[int, int]] = []
    for index, picture in enumerate(pictures):
        bits = np.count_nonzero(hashes[:index] != hashes[index], axis=1)
        alike = [int(i) for i in np.flatnonzero(bits <= _SAME_BITS)]
        original = next((i for i in alike if _difference(pictures[i], picture) < _SAME_GREY), None)
        if original is not None:
            copies.append((index, original))
    return copies


def find_still(pictures: Sequence[GreyImage]) -> list[int]:
    """Return the pictures that are nearly the same as the one before: the camera did not move."""
    return [i for i in range(1, len(pictures)) if _difference(pictures[i - 1], pictures[i]) < _STILL_GREY]


def find_groups(pictures: Sequence[GreyImage], progress: Progress = ignore_progress) -> list[list[int]]:
    """Return the pictures in groups that hang together by what neighbours show, in order of their first pictures.

    Each one is compared with the next, up to REACH further ones until one overlaps: matches of keypoints (SIFT) that
    fit one rigid scene. Small copies hide much, so what overlaps here does, but more may.
    """
    group = list(range(len(pictures)))
    recent: list[_Keypoints] = []
    for index, picture in enumerate(pictures):
        keypoints = _keypoints(picture)
        for back, other in enumerate(reversed(recent), start=1):
            if _overlap(keypoints, other):
                kept, merged = sorted((group[index], group[index - back]))
                group = [kept if label == merged else label for label in group]
                break
        recent = [*recent, keypoints][-REACH:]
        progress(index + 1, len(pictures))
    return [[i for i, label in enumerate(group) if label == kept] for kept in sorted(set(group))]


def _keypoints(picture: GreyImage) -> _Keypoints:
    import cv2

    # Even light first: otherwise all keypoints lie in the middle of the lamp's beam.
    smaller = cv2.resize(picture, None, fx=_SHRINK, fy=_SHRINK, interpolation=cv2.INTER_AREA)
    even = cv2.createCLAHE(4.0, (8, 8)).apply(smaller)
    found, descriptors = cv2.SIFT.create(_NUM_KEYPOINTS, contrastThreshold=0.02).detectAndCompute(even, None)
    if descriptors is None:
        return _Keypoints(np.zeros((0, 2), np.float32), np.zeros((0, 128), np.float32))
    roots = np.sqrt(descriptors / descriptors.sum(axis=1, keepdims=True))
    return _Keypoints(np.array([point.pt for point in found], np.float32), roots)


def _overlap(first: _Keypoints, second: _Keypoints) -> bool:
    import cv2

    if min(len(first.places), len(second.places)) < _MIN_INLIERS:
        return False
    distance = np.sqrt(np.maximum(2.0 - 2.0 * first.descriptors @ second.descriptors.T, 0.0))
    best, other = distance.argmin(axis=1), distance.argmin(axis=0)
    two = np.partition(distance, 1, axis=1)[:, :2]
    is_match = (two[:, 0] < _MAX_RATIO * two[:, 1]) & (other[best] == np.arange(len(best)))
    if is_match.sum() < _MIN_INLIERS:
        return False
    here, there = first.places[is_match], second.places[best[is_match]]
    cv2.setRNGSeed(0)
    _, is_inlier = cv2.findFundamentalMat(here, there, cv2.FM_RANSAC, _TOLERANCE_PX, 0.99, 1000)
    return is_inlier is not None and int(is_inlier.sum()) >= _MIN_INLIERS


def _hash(picture: GreyImage) -> BoolArray:
    import cv2

    cells = cv2.resize(picture, (9, 8), interpolation=cv2.INTER_AREA).astype(np.int16)
    return (cells[:, 1:] > cells[:, :-1]).ravel()


def _difference(first: GreyImage, second: GreyImage) -> float:
    if first.shape != second.shape:
        return float("inf")
    return float(np.abs(first.astype(np.int16) - second).mean())
