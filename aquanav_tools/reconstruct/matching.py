"""Matches between photos, kept in COLMAP's database beside their keypoints.

Small sets are compared completely. Of larger ones, first neighbours in time and photos that look alike; then those that
share neighbours; then, while groups do not hang together, everything between them. Photos that hang on few matches get
more from the neighbours they have, sought along the lines that the first matches allow.

A killed run goes on where it was, to the same matches: the pairs of a round rest on what earlier rounds found, so they
are written down before the first of them is matched; and matches of a pair do not depend on the pairs matched with it.
"""

from __future__ import annotations

import itertools
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.pairs import (
    Counts,
    Pair,
    alike_pairs,
    bridging_pairs,
    count_likeness,
    friends_of_friends,
    near_pairs,
)
from aquanav_tools.store import write_whole
from aquanav_tools.types import Progress, ignore_progress

_PAIRS_AT_ONCE = 256
"""Few enough that a killed run loses seconds; many, as every call builds the search trees of its photos anew."""
_BLOCK = 16
"""Photos whose pairs are taken together, so that the trees of a call are few."""
_STRONG_MATCHES = 100
"""That make a pair strong: COLMAP wants as many of the pair it starts with."""
_STRONG_NEIGHBOURS = 4
"""Of a photo that hangs well. Others are matched once more: that takes ten times as long, and finds twice as much."""
_GUIDED_RATIO = 0.9
"""Lowe's ratio where the epipolar line limits the choice; 0.8, COLMAP's own, where nothing does."""


@dataclass(frozen=True)
class MatchOptions:
    """Which photos are compared."""

    exhaustive_up_to: int = 150
    """Compare every photo with every other one in sets up to this size."""
    overlap: int = 5
    """In larger sets, photos compared with each one's next neighbours, and with those 2, 4, 8, ... further on."""
    alike: int = 20
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
    for number, (find, is_guided) in enumerate(_rounds(database, names, options)):
        plan = database.with_name(f"round-{number}.txt")
        if not plan.exists():
            _write_pairs(plan, _named(names, find()))
        left = _read_pairs(plan)
        for start in range(0, len(left), _PAIRS_AT_ONCE):
            chunk = left[start : start + _PAIRS_AT_ONCE]
            _forget(database, chunk)
            _match(database, chunk, options, is_guided)
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
    """Return what finds the pairs of each round, to be called when those before are matched, and if it is guided."""
    count = len(names)

    def new(pairs: set[Pair]) -> set[Pair]:
        return _unmatched(database, names, pairs)

    def verified() -> Counts:
        return verified_matches(database, names)

    weak: tuple[Callable[[], set[Pair]], bool] = (lambda: weak_pairs(verified()), True)
    if count <= options.exhaustive_up_to:
        return [(lambda: set(itertools.combinations(range(count), 2)), False), weak]
    return [
        (
            lambda: near_pairs(count, options.overlap) | alike_pairs(count_likeness(database, names), options.alike),
            False,
        ),
        (lambda: new(friends_of_friends(verified() > 0, options.alike)), False),
        (lambda: new(bridging_pairs(verified() > 0)), False),
        weak,
    ]


def weak_pairs(matches: Counts) -> set[Pair]:
    """Return the pairs with some matches of photos that have too few strong neighbours; (N, N) matches."""
    is_weak = np.count_nonzero(matches >= _STRONG_MATCHES, axis=1) < _STRONG_NEIGHBOURS
    rows, columns = np.nonzero(np.triu(matches > 0) & (is_weak[:, None] | is_weak))
    return set(zip(rows.tolist(), columns.tolist(), strict=True))


def _match(database: Path, pairs: list[tuple[str, str]], options: MatchOptions, is_guided: bool = False) -> None:
    pycolmap = load_pycolmap()
    matching = pycolmap.FeatureMatchingOptions()
    if is_guided:
        matching.guided_matching = True
        matching.sift.max_ratio = _GUIDED_RATIO
    verification = pycolmap.TwoViewGeometryOptions()
    verification.ransac.random_seed = options.seed
    with tempfile.TemporaryDirectory() as folder:
        pairing = pycolmap.ImportedPairingOptions()
        pairing.match_list_path = Path(folder) / "pairs.txt"
        _write_pairs(Path(pairing.match_list_path), pairs)
        pycolmap.match_image_pairs(
            database,
            matching_options=matching,
            pairing_options=pairing,
            verification_options=verification,
            device=pycolmap.Device.cpu,
        )


def _forget(database: Path, pairs: list[tuple[str, str]]) -> None:
    """Remove the matches of pairs, those that a killed run was in the middle of among them."""
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
