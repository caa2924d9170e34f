"""Matches between photos, kept in COLMAP's database beside their keypoints.

Small sets are compared completely. Of larger ones, first neighbours in time and photos that look alike; then those that
share neighbours; then, while groups do not hang together, what looks most alike between them. Most of these pairs show
nothing in common: their coarse keypoints are compared first, and the others only of pairs where some of those match.

A killed run goes on where it was, to the same matches: the pairs of a round rest on what earlier rounds found, so they
are written down before the first of them is matched; and matches of a pair do not depend on the pairs matched with it.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.machine import num_cores
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.nearest import Descriptors, best_matches, products_in_one_thread
from aquanav_tools.reconstruct.pairs import (
    Counts,
    Pair,
    alike_pairs,
    bridging_pairs,
    count_likeness,
    friends_of_friends,
    largest,
    near_pairs,
)
from aquanav_tools.store import write_whole
from aquanav_tools.types import Array, BoolArray, Progress, ignore_progress

_PAIRS_AT_ONCE = 128
"""Few enough that a killed run loses seconds."""
_NUM_COARSE = 1500
"""Keypoints of each photo, the largest, that are compared first: a tenth of the work of all."""
_LEAST_COARSE = 2
"""Matches among them from which all are compared. Of 1,285 pairs of a dive with wide steps this leaves out 827
of the 1,017 that fit no rigid scene, and 6 of the 268 that do, with 25 matches at most (measured)."""
_BLOCK = 16
"""Photos whose pairs are taken together, so that few are held in memory at a time."""


@dataclass(frozen=True, eq=False)
class _Described:
    """A photo as matching sees it."""

    image_id: int
    camera: Any
    """pycolmap.Camera."""
    places: Array
    """(K, 2) of its keypoints, px."""
    descriptors: Descriptors
    """(K, 128) of them."""
    coarse: Descriptors
    """(_NUM_COARSE or K, 128) of the largest."""


@dataclass(frozen=True)
class MatchOptions:
    """Which photos are compared."""

    exhaustive_up_to: int = 40
    """Compare every photo with every other one in sets up to this size."""
    overlap: int = 5
    """In larger sets, photos compared with each one's next neighbours, and with those 2, 4, 8, ... further on."""
    alike: int = 15
    """And with those that look most like it, wherever they come in the sequence: loops and other dives."""
    seed: int = 0
    """Of the robust geometric check."""

    def __post_init__(self) -> None:
        if self.exhaustive_up_to < 0 or self.overlap < 1 or self.alike < 0:
            raise ValueError(
                f"exhaustive_up_to = {self.exhaustive_up_to} and alike = {self.alike} must be 0 or more, "
                f"overlap = {self.overlap} 1 or more."
            )


def match_features(
    photos: PhotoSet, database: Path, options: MatchOptions, progress: Progress = ignore_progress
) -> None:
    """Match the keypoints of photo pairs and keep the matches that fit one rigid scene."""
    names = [photo.file for photo in photos.photos]
    expected = expected_pairs(len(names), options)
    done = _num_compared(database)
    for number, (find, in_full) in enumerate(_rounds(database, names, options)):
        plan = database.with_name(f"round-{number}.txt")
        if plan.exists():  # a killed run may have matched its next pairs, but not struck them off
            _forget(database, _read_pairs(plan)[:_PAIRS_AT_ONCE])
        else:
            _write_pairs(plan, _named(names, find()))
        left = _read_pairs(plan)
        for start in range(0, len(left), _PAIRS_AT_ONCE):
            chunk = left[start : start + _PAIRS_AT_ONCE]
            _match(database, chunk, options, in_full)
            _write_pairs(plan, left[start + len(chunk) :])
            done = min(done + len(chunk), expected)
            progress(done, expected)
    progress(expected, expected)


def expected_pairs(count: int, options: MatchOptions) -> int:
    """Return about how many pairs of a set will be compared: all, or as many as the rounds ask for without overlap."""
    every = count * (count - 1) // 2
    if count <= options.exhaustive_up_to:
        return every
    return min(every, len(near_pairs(count, options.overlap)) + count * options.alike)


def _rounds(database: Path, names: Sequence[str], options: MatchOptions) -> list[tuple[Callable[[], set[Pair]], bool]]:
    """Return what finds the pairs of each round, to be called when those before are matched.

    With each, whether all keypoints of its pairs are compared whatever the coarse ones show: the last round looks for
    the weakest ties, also among pairs that were set aside before.
    """
    count = len(names)
    if count <= options.exhaustive_up_to:
        return [(lambda: set(itertools.combinations(range(count), 2)), True)]

    @functools.cache
    def likeness() -> Counts:
        return count_likeness(database, names)

    def new(pairs: set[Pair]) -> set[Pair]:
        return _unmatched(database, names, pairs)

    def verified() -> BoolArray:
        return verified_matches(database, names) > 0

    return [
        (lambda: near_pairs(count, options.overlap) | alike_pairs(likeness(), options.alike), False),
        (lambda: new(friends_of_friends(verified(), options.alike // 2)), False),
        (lambda: new(bridging_pairs(verified(), likeness(), 2 * options.alike)), True),
    ]


def _match(database: Path, pairs: list[tuple[str, str]], options: MatchOptions, in_full: bool) -> None:
    """Write the matches of pairs, and those of them that fit one rigid scene; nothing of pairs that are set aside."""
    pycolmap = load_pycolmap()
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = options.seed
    with pycolmap.Database.open(database) as store, ThreadPoolExecutor(num_cores()) as threads:
        photos = {name: _read_described(store, name) for name in sorted({name for pair in pairs for name in pair})}

        def compare(pair: tuple[str, str]) -> tuple[Any, Any] | None:
            here, there = (photos[name] for name in pair)
            if not in_full and len(best_matches(here.coarse, there.coarse)) < _LEAST_COARSE:
                return None
            matches = best_matches(here.descriptors, there.descriptors)
            if len(matches) < verification.min_num_inliers:
                return matches, pycolmap.TwoViewGeometry()
            return matches, pycolmap.estimate_two_view_geometry(
                here.camera, here.places, there.camera, there.places, matches, verification
            )

        with products_in_one_thread():
            found = list(threads.map(compare, pairs))
        with pycolmap.DatabaseTransaction(store):
            for pair, one in zip(pairs, found, strict=True):
                if one is not None:
                    ids = [photos[name].image_id for name in pair]
                    store.write_matches(*ids, one[0])
                    store.write_two_view_geometry(*ids, one[1])


def _read_described(store: Any, name: str) -> _Described:
    image = store.read_image_with_name(name)
    descriptors = np.asarray(store.read_descriptors(image.image_id).data)
    keypoints = np.asarray(store.read_keypoints(image.image_id))
    coarse = descriptors[largest(keypoints, _NUM_COARSE)]
    places = keypoints[:, :2].astype(np.float64)
    return _Described(image.image_id, store.read_camera(image.camera_id), places, descriptors, coarse)


def _forget(database: Path, pairs: list[tuple[str, str]]) -> None:
    """Remove what is known of pairs."""
    with load_pycolmap().Database.open(database) as store:
        for pair in pairs:
            ids = [store.read_image_with_name(name).image_id for name in pair]
            store.delete_two_view_geometry(*ids)
            store.delete_matches(*ids)


def _unmatched(database: Path, names: Sequence[str], pairs: set[Pair]) -> set[Pair]:
    """Return the pairs that were not compared yet."""
    with load_pycolmap().Database.open(database) as store:
        ids = [store.read_image_with_name(name).image_id for name in names]
        return {(i, j) for i, j in pairs if not store.exists_matches(ids[i], ids[j])}


def _num_compared(database: Path) -> int:
    with load_pycolmap().Database.open(database) as store:
        return int(store.num_matched_image_pairs())


def _write_pairs(path: Path, pairs: list[tuple[str, str]]) -> None:
    write_whole(path, "".join(f"{a} {b}\n" for a, b in pairs))


def _read_pairs(path: Path) -> list[tuple[str, str]]:
    pairs = [line.split(" ") for line in path.read_text(encoding="utf-8").splitlines()]
    return [(a, b) for a, b in pairs]


def _named(names: Sequence[str], pairs: set[Pair]) -> list[tuple[str, str]]:
    ordered = sorted(pairs, key=lambda pair: (pair[0] // _BLOCK, pair[1] // _BLOCK, pair))
    return [(names[i], names[j]) for i, j in ordered]


def verified_matches(database: Path, names: Sequence[str]) -> Counts:
    """Return (N, N) how many matches of two photos fit one rigid scene."""
    pycolmap = load_pycolmap()
    matches = np.zeros((len(names), len(names)), np.int64)
    with pycolmap.Database.open(database) as store:
        rows = {store.read_image_with_name(name).image_id: row for row, name in enumerate(names)}
        pair_ids, counts = store.read_two_view_geometry_num_inliers()
    for pair_id, count in zip(pair_ids, counts, strict=True):
        i, j = (rows[image_id] for image_id in pycolmap.pair_id_to_image_pair(pair_id))
        matches[i, j] = matches[j, i] = count
    return matches
