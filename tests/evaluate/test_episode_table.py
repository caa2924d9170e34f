from __future__ import annotations

import dataclasses
import hashlib
import tracemalloc

import numpy as np
import pytest

from aquanav_tools.evaluate.episode_table import EpisodeTable
from aquanav_tools.evaluate.journal import worst_first
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from tests.evaluate.test_metrics import episode

EPISODES = [
    episode(index=0, scenario="a", digest="x", collisions=2, min_clearance=0.0, energy=None),
    episode(index=1, scenario="b", digest="x", outcome="timeout", time_ratio=None, interventions=7, reason="é"),
    episode(index=2, scenario="a", digest="x", collisions=0, min_clearance=0.3),
    episode(index=3, scenario="a", digest="y", collisions=0, min_clearance=0.1),
]


def test_a_table_gives_back_the_episodes_that_were_put_in() -> None:
    table = EpisodeTable(EPISODES)
    assert list(table) == EPISODES
    assert [table[n] for n in (0, -1)] == [EPISODES[0], EPISODES[-1]]
    assert table[1:3] == EPISODES[1:3]
    assert [type(value) for value in dataclasses.astuple(table[1])] == [
        type(value) for value in dataclasses.astuple(EPISODES[1])
    ]
    with pytest.raises(IndexError):
        table[4]


def test_rows_are_chosen_by_place_and_by_what_they_hold() -> None:
    table = EpisodeTable(EPISODES)
    assert list(table.rows(np.array([3, 0]))) == [EPISODES[3], EPISODES[0]]
    assert list(table.rows(table.are("scenario", "b"))) == [EPISODES[1]]
    assert table.names("scenario") == ["a", "b"]
    assert table.rows(np.array([1, 3])).names("scenario") == ["b", "a"]
    assert not table.are("outcome", "collision").any()
    assert np.isnan(table.column("energy")).tolist() == [True, False, False, False]


def test_of_episodes_that_are_the_same_in_one_cave_the_first_is_kept() -> None:
    assert [one.index for one in EpisodeTable(EPISODES).distinct()] == [0, 1, 3]


def test_worst_are_failures_then_collisions_then_near_walls() -> None:
    assert worst_first(EpisodeTable(EPISODES)) == [1, 0, 3, 2]


def test_a_digest_that_does_not_fit_is_refused() -> None:
    with pytest.raises(ValueError, match="at most 64 characters, not 65"):
        EpisodeTable([episode(digest="a" * 65)])


def test_an_episode_takes_a_third_of_a_kilobyte() -> None:
    def made(index: int) -> EpisodeMetrics:
        return dataclasses.replace(EPISODES[0], index=index, digest=hashlib.sha256(bytes(index)).hexdigest())

    tracemalloc.start()
    try:
        table = EpisodeTable(map(made, range(2000)))
        size = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert size / len(table) < 333
