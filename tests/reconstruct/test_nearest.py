"""The search for matching keypoints does what its definition says, whatever the number of keypoints."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from aquanav_tools.reconstruct.nearest import best_matches, products_in_one_thread


def descriptors(rows: np.ndarray) -> np.ndarray:
    """Return rows as COLMAP keeps them: of length 512, in bytes."""
    return np.minimum(np.round(512.0 * rows / np.linalg.norm(rows, axis=1, keepdims=True)), 255.0).astype(np.uint8)


def by_definition(here: np.ndarray, there: np.ndarray) -> set[tuple[int, int]]:
    """Return pairs that are each other's nearest by angle, within 0.7 and 0.8 of the second nearest, both ways."""
    products = here.astype(np.int64) @ there.astype(np.int64).T
    angles = np.arccos(np.clip(products / 512.0**2, -1.0, 1.0))
    found = set()
    for i, j in enumerate(angles.argmin(axis=1)):
        beside, across = np.delete(angles[i], j).min(), np.delete(angles[:, j], i).min()
        if angles[i, j] < 0.7 and angles[i, j] < 0.8 * beside and angles[i, j] < 0.8 * across:
            found.add((i, int(j)))
    return found


@pytest.mark.parametrize(("count", "other"), [(2, 3), (255, 257), (256, 512), (700, 300)])
def test_matches_are_those_of_the_definition(rng: np.random.Generator, count: int, other: int) -> None:
    here, there = rng.random((count, 128)), rng.random((other, 128))
    shared = min(count, other) // 2
    there[:shared] = here[rng.permutation(count)[:shared]] + rng.normal(0.0, 0.02, (shared, 128))
    first, second = descriptors(here), descriptors(np.abs(there))
    expected = by_definition(first, second)
    assert {(int(i), int(j)) for i, j in best_matches(first, second)} == expected
    assert len(expected) >= shared // 2


def test_matches_are_the_same_however_the_processor_multiplies(rng: np.random.Generator) -> None:
    here = rng.gamma(0.5, size=(600, 128))
    first, second = descriptors(here), descriptors(here[::-1] + rng.gamma(0.2, 0.5, (600, 128)))
    plain = best_matches(first, second)
    precision = torch.get_float32_matmul_precision()
    with products_in_one_thread():
        assert torch.get_float32_matmul_precision() == "medium"
        np.testing.assert_array_equal(best_matches(first, second), plain)
    assert torch.get_float32_matmul_precision() == precision
    assert len(plain) > 300


def test_what_is_there_twice_matches_nothing(rng: np.random.Generator) -> None:
    here = descriptors(rng.random((20, 128)))
    assert len(best_matches(here, here)) == 20
    assert len(best_matches(here, np.concatenate((here, here)))) == 0


@pytest.mark.parametrize("count", [0, 1])
def test_photos_with_hardly_a_keypoint_have_no_matches(rng: np.random.Generator, count: int) -> None:
    few = descriptors(rng.random((count, 128)))
    assert best_matches(few, descriptors(rng.random((9, 128)))).shape == (0, 2)
