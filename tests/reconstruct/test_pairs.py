"""Pairs worth comparing: nothing near or alike is missed, and what hangs apart is bridged."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aquanav_tools.reconstruct.mapping import last_snapshot
from aquanav_tools.reconstruct.matching import MatchOptions, expected_pairs
from aquanav_tools.reconstruct.pairs import alike_pairs, bridging_pairs, friends_of_friends, likeness_of, near_pairs


def test_neighbours_and_doubling_distances_of_a_sequence_are_compared() -> None:
    pairs = near_pairs(400, 10)
    assert {(0, 10), (0, 256), (389, 399)} <= pairs
    assert (0, 12) not in pairs


def test_photos_that_look_alike_are_compared_wherever_they_come() -> None:
    likeness = np.zeros((50, 50), int)
    likeness[3, 47] = likeness[47, 3] = 9
    assert alike_pairs(likeness, most=5) == {(3, 47)}


def test_photos_that_share_two_neighbours_are_compared_with_each_other() -> None:
    verified = np.zeros((5, 5), bool)
    for i, j in ((0, 1), (0, 2), (3, 1), (3, 2), (3, 4)):
        verified[i, j] = verified[j, i] = True
    assert friends_of_friends(verified, most=5) == {(0, 3), (1, 2)}


def test_photos_that_overlap_with_many_ask_for_no_more() -> None:
    verified = np.zeros((30, 30), bool)
    verified[:14, 14:] = verified[14:, :14] = True  # each of 14 with each of 16, and no other
    verified[0, 16:] = verified[16:, 0] = False
    pairs = friends_of_friends(verified, most=30)
    assert pairs == {(0, other) for other in range(1, 14)}


def test_likeness_counts_the_words_that_photos_share(rng: np.random.Generator) -> None:
    words = rng.normal(size=(70, 256, 128)).astype(np.float32)
    for i, j, shared in ((0, 69, 40), (3, 5, 7), (64, 66, 256)):
        words[i, :shared] = words[j, -shared:]
    words[20, 100:] = 0.0
    words[30, :100] = words[20, :100]
    words /= np.maximum(np.linalg.norm(words, axis=2, keepdims=True), 1e-9)
    expected = np.zeros((70, 70), int)
    for i, j, shared in ((0, 69, 40), (3, 5, 7), (64, 66, 256), (20, 30, 100)):
        expected[i, j] = expected[j, i] = shared
    np.testing.assert_array_equal(likeness_of(list(words)), expected)


def test_photos_of_separate_groups_are_compared_with_those_they_resemble_most_of_the_other_group() -> None:
    verified = np.zeros((4, 4), bool)
    verified[0, 1] = verified[1, 0] = verified[2, 3] = verified[3, 2] = True
    likeness = np.array([[0, 9, 1, 5], [9, 0, 0, 2], [1, 0, 0, 9], [5, 2, 9, 0]])
    assert bridging_pairs(verified, likeness, most=1) == {(0, 2), (0, 3), (1, 3)}
    assert bridging_pairs(verified, likeness, most=9) == {(0, 2), (0, 3), (1, 2), (1, 3)}
    assert bridging_pairs(np.ones((4, 4), bool), likeness, most=9) == set()


def test_a_small_set_is_compared_completely_and_a_long_one_in_proportion_to_its_length() -> None:
    options = MatchOptions()
    assert expected_pairs(30, options) == 30 * 29 / 2
    assert expected_pairs(2000, options) < 2.1 * expected_pairs(1000, options)


def test_a_killed_mapping_goes_on_from_a_snapshot_that_was_written_to_its_end(tmp_path: Path) -> None:
    assert last_snapshot(tmp_path) is None
    for name in ("0001", "0002", "0003"):
        (tmp_path / name).mkdir()
    assert last_snapshot(tmp_path) == tmp_path / "0002"
