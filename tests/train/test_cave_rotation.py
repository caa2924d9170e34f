"""Which of the drawn caves leaves when the next one comes in."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from aquanav_tools.train.cave_rotation import CaveRotation
from aquanav_tools.train.episodes import EpisodeSummary
from aquanav_tools.train.settings import TrainSettings
from tests.train.runs import assert_stopped_run_ends_alike, tiny_pipeline
from tests.train.test_drawn_caves import MIXED, ON_BATCH, stub

CLEAN = EpisodeSummary(1.0, 10, 0, True)
TOUCHED = dataclasses.replace(CLEAN, num_collisions=1)
LOST = dataclasses.replace(CLEAN, is_success=False)
CUT_SHORT = dataclasses.replace(LOST, is_cut_short=True)


class Places:
    """Stands for a batch of two vehicles in each of four places, the first of which has a cave that stays."""

    def __init__(self) -> None:
        self.slices = [slice(2 * place, 2 * place + 2) for place in range(4)]
        self.slots = np.repeat(np.arange(4), 2)
        self.current_caves, self.cave_of = np.arange(4), np.repeat(np.arange(4), 2)
        self.came: list[tuple[int, Any]] = []

    def replace(self, place: int, scenario: Any) -> bool:
        other = int(place + 4 if self.current_caves[place] == place else place)
        if (self.cave_of == other).any():
            return False
        self.current_caves[place] = other
        self.came.append((place, scenario))
        return True

    def move(self, vehicle: int) -> None:
        self.cave_of[vehicle] = self.current_caves[self.slots[vehicle]]


def rotation(leaves: str) -> CaveRotation:
    """Return one with drawn caves 0, 1, 2 in places 1, 2, 3; after every fourth decision another comes in."""
    supply: Any = SimpleNamespace(take=lambda number: f"cave {number}", expect=lambda _: None, at_once=list, waited=0.0)
    settings = TrainSettings(scenario=MIXED, num_envs=8, new_cave_every=32, cave_that_leaves=leaves)  # type: ignore[arg-type]
    return CaveRotation(supply, [0, 1, 2], settings)


def fly(turns: CaveRotation, batch: Any, ends: dict[int, EpisodeSummary]) -> None:
    """Take four decisions, in the second to fourth of which the same vehicles' episodes end."""
    turns.step(batch, {})
    for _ in range(3):
        for vehicle in ends:
            batch.move(vehicle)
        turns.step(batch, ends)


@pytest.mark.parametrize(("leaves", "places"), [("oldest", [1, 2, 3, 1]), ("easiest", [2, 3, 1, 2])])
def test_the_cave_that_is_dived_best_leaves_first(leaves: str, places: list[int]) -> None:
    batch, turns = Places(), rotation(leaves)
    for ends in ({2: TOUCHED, 4: CLEAN, 6: LOST}, {2: TOUCHED, 3: TOUCHED, 6: CLEAN, 7: CLEAN}, {2: CLEAN}, {}):
        fly(turns, batch, ends)
        for vehicle in range(8):
            batch.move(vehicle)
    assert batch.came == [(place, f"cave {number}") for number, place in enumerate(places, 3)]


def test_many_clean_dives_tell_more_than_few() -> None:
    batch, turns = Places(), rotation("easiest")
    fly(turns, batch, {2: CLEAN, 4: CLEAN, 5: CLEAN, 6: CLEAN, 7: TOUCHED})
    assert batch.came == [(2, "cave 3")]


def test_what_says_nothing_of_a_cave_is_not_counted() -> None:
    """Episodes in caves that stay, that time cut short by chance, and that ended in the cave before."""
    turns = rotation("easiest")
    batch: Any = Places()
    fly(turns, batch, {0: CLEAN, 2: CUT_SHORT, 4: TOUCHED, 6: TOUCHED})
    assert batch.came == [(1, "cave 3")]  # nothing tells them apart: the oldest
    fly(turns, batch, {4: CLEAN, 5: CLEAN})
    assert batch.came[1:] == [(2, "cave 4")]
    # Vehicles 4 and 5 are still in the cave before; a clean end there is no praise for cave 4.
    before = turns.state()["rotation/ended"].copy()
    turns.step(batch, {4: CLEAN})
    assert np.array_equal(turns.state()["rotation/ended"], before)


def test_a_place_whose_vehicles_have_not_left_is_passed_over() -> None:
    batch, turns = Places(), rotation("easiest")
    fly(turns, batch, {4: CLEAN, 5: CLEAN})
    batch.move(4)
    fly(turns, batch, {4: CLEAN})  # 5 is still in the cave before
    assert batch.came == [(2, "cave 3"), (1, "cave 4")]


def test_a_cave_of_which_nothing_is_known_stays() -> None:
    """Or, while nothing is dived well, each new one would make way for the next."""
    batch, turns = Places(), rotation("easiest")
    for _ in range(3):
        fly(turns, batch, {2: TOUCHED, 4: LOST, 6: TOUCHED})
        for vehicle in range(8):
            batch.move(vehicle)
    assert batch.came == [(1, "cave 3"), (2, "cave 4"), (3, "cave 5")]


def test_a_run_of_an_earlier_version_goes_on() -> None:
    turns, batch = rotation("easiest"), Places()
    state = {**turns.state(), "cave_of": batch.cave_of}
    del state["rotation/ended"]
    turns.restore(state, batch)  # type: ignore[arg-type]  # it stands for one
    assert not turns.state()["rotation/ended"].any()


def test_a_stopped_run_ends_as_one_that_never_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stub(monkeypatch, tmp_path / "caves")
    pipeline = tiny_pipeline(
        Path(MIXED), 1, ON_BATCH, num_caves=2, new_cave_every=48, steps=384, current="half", cave_that_leaves="easiest"
    )
    assert_stopped_run_ends_alike(pipeline, tmp_path, monkeypatch, 2)
