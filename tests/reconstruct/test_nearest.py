"""The search for matching keypoints does what its definition says, whatever the number of keypoints."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.reconstruct.nearest import best_matches


def unit(rows: np.ndarray) -> np.ndarray:
    return (rows / np.linalg.norm(rows, axis=1, keepdims=True)).astype(np.float32)


def by_definition(here: np.ndarray, there: np.ndarray) -> set[tuple[int, int]]:
    """Return pairs that are each other's nearest by angle, within 0.7 and 0.8 of the second nearest, both ways."""
    angles = np.arccos(np.clip(here.astype(float) @ there.astype(float).T, -1.0, 1.0))
    found = set()
    for i, j in enumerate(angles.argmin(axis=1)):
        beside, across = np.delete(angles[i], j).min(), np.delete(angles[:, j], i).min()
        if angles[i, j] < 0.7 and angles[i, j] < 0.8 * beside and angles[i, j] < 0.8 * across:
            found.add((i, int(j)))
    return found


@pytest.mark.parametrize(("count", "other"), [(2, 3), (255, 257), (256, 512), (700, 300)])
def test_matches_are_those_of_the_definition(rng: np.random.Generator, count: int, other: int) -> None:
    here, there = unit(rng.random((count, 128))), rng.random((other, 128))
    shared = min(count, other) // 2
    there[:shared] = here[rng.permutation(count)[:shared]] + rng.normal(0.0, 0.02, (shared, 128))
    expected = by_definition(here, unit(there))
    assert {(int(i), int(j)) for i, j in best_matches(here, unit(there))} == expected
    assert len(expected) >= shared // 2


def test_what_is_there_twice_matches_nothing(rng: np.random.Generator) -> None:
    here = unit(rng.random((20, 128)))
    assert len(best_matches(here, here)) == 20
    assert len(best_matches(here, np.concatenate((here, here)))) == 0


@pytest.mark.parametrize("count", [0, 1])
def test_photos_with_hardly_a_keypoint_have_no_matches(rng: np.random.Generator, count: int) -> None:
    assert best_matches(unit(rng.random((count, 128))), unit(rng.random((9, 128)))).shape == (0, 2)
