"""Episodes of a batch that begin together need not run out of time together."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from aquanav_tools.envs.batch import Batch
from aquanav_tools.envs.factory import make_batch
from tests.caves import tube_scenario

LIMIT, NUM = 15, 12


def lengths_of(batch: Batch, decisions: int, state_at: int = -1) -> list[list[int]]:
    """Return the lengths of each vehicle's episodes when it does nothing, and go back where `state_at` is reached."""
    found: list[list[int]] = [[] for _ in range(NUM)]
    for step in range(decisions):
        batch.command(np.ones((NUM, len(batch.parts)), dtype=int))
        batch.step()
        for n in np.flatnonzero(batch.view_of("truncated")):
            found[n].append(int(batch.view_of("last_lengths")[n]))
        if step == state_at:
            batch.restore(batch.state())
    return found


@pytest.mark.parametrize("place", ["cave", "bay", "two caves"])
@pytest.mark.parametrize("state_at", [-1, 2])
def test_first_episodes_are_shorter_by_chance_and_later_ones_whole(place: str, state_at: int) -> None:
    cave = tube_scenario()
    places: dict[str, Any] = {"cave": cave, "bay": "bay-calm", "two caves": [cave, cave]}
    batch = make_batch(places[place], NUM, next_step=False, max_decisions=LIMIT)
    batch.reset(range(NUM))
    batch.randomise_time_limits(4)
    lengths = lengths_of(batch, 3 * LIMIT, state_at)
    first = [own[0] for own in lengths]
    assert len(set(first)) > NUM // 3
    assert 1 <= min(first) < max(first) <= LIMIT
    assert all(own[1:] and set(own[1:]) == {LIMIT} for own in lengths)
    batch.reset(range(NUM))
    assert {own[0] for own in lengths_of(batch, LIMIT)} == {LIMIT}  # not asked for again
    batch.close()
