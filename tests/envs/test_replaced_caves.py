"""Caves of a batch that others take the place of: vehicles go there one by one, each as its episode ends."""

from __future__ import annotations

import dataclasses
import gc
import weakref
from typing import Any

import numpy as np
import pytest

from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import LimitSettings, Scenario
from tests.caves import tube_scenario
from tests.sim.test_water import flowing

CHOICES: list[dict[str, Any]] = [
    {},
    {"randomisation": "wide", "starts": "anywhere"},
    {"sensors": ("depth", "dvl"), "action_delay": 1, "observation_delay": 1},
]


def old_cave() -> Scenario:
    """The tube with its flow, for 12 decisions."""
    scenario = flowing()
    return dataclasses.replace(
        scenario, settings=dataclasses.replace(scenario.settings, limits=LimitSettings(decisions=12))
    )


def new_cave() -> Scenario:
    """The same for 15 decisions, with denser water, in which bodies move otherwise, other starts and a larger goal."""
    scenario = flowing()
    water = dataclasses.replace(scenario.settings.water, density=1200.0)
    goal = dataclasses.replace(scenario.settings.goal, tolerance=4.0)  # which starts anywhere keep away from
    settings = dataclasses.replace(scenario.settings, limits=LimitSettings(decisions=15), water=water, goal=goal)
    return dataclasses.replace(scenario, settings=settings, starts=scenario.starts[:1])


def stepped(batch: CaveBatch, count: int) -> list[dict[str, np.ndarray]]:
    """Return what is seen at each of some decisions, all of them ahead and to the left."""
    seen = []
    for _ in range(count):
        batch.set_commands(np.tile(np.float32([0.1, 0.4, 1.0]), (batch.num, 1)))
        batch.step()
        names = ("observations", "positions", "rewards", "truncated", "seeds", "restarted", "remaining")
        seen.append({name: batch.copy_of(name) for name in names})
    return seen


@pytest.mark.parametrize("choice", CHOICES, ids=["plain", "drawn", "sensors"])
def test_each_vehicle_ends_its_episode_and_then_swims_as_one_that_began_in_the_new_cave(choice: dict[str, Any]) -> None:
    options = {"next_step": False, "current": "half", **choice}
    batch, left = (CaveBatch([old_cave(), flowing()], 6, replaceable=True, **options) for _ in range(2))
    for one in (batch, left):
        one.reset(range(6))
        one.world.age(np.array([0, 3, 6, 0, 0, 0]))  # so that episodes end one after the other
    assert batch.replace(0, new_cave())
    assert not batch.replace(0, new_cave())  # vehicles are still in the one before
    both = list(zip(stepped(batch, 12), stepped(left, 12), strict=True))
    ends = [12, 9, 6]
    for decision, (here, there) in enumerate(both, 1):
        for vehicle in range(6):
            if vehicle > 2 or decision < ends[vehicle]:
                for name in here:
                    assert np.array_equal(here[name][vehicle], there[name][vehicle])
    assert batch.cave_of.tolist() == [2, 2, 2, 1, 1, 1]
    assert batch.limits.tolist()[:3] == [15] * 3
    # The episode that began last, at decision 12, is the one that a batch in the new cave has from the same seed.
    alone = CaveBatch(new_cave(), 1, **options)
    alone.reset([int(both[-1][0]["seeds"][0]) % (1 << 32)])
    assert np.array_equal(alone.copy_of("observations")[0], both[-1][0]["observations"][0])
    for here, there in zip(stepped(batch, 14), stepped(alone, 14), strict=True):
        for name in ("observations", "positions", "rewards", "truncated", "remaining"):
            assert np.array_equal(here[name][0], there[name][0]), name
    assert batch.replace(0, old_cave())
    for one in (batch, left, alone):
        one.close()


def test_a_batch_comes_back_to_where_it_was_between_two_caves() -> None:
    options = {"next_step": False, "current": "half", "randomisation": "wide"}
    caves = [old_cave(), flowing()]
    batch = CaveBatch(caves, 4, replaceable=True, **options)
    batch.reset(range(4))
    batch.world.age(np.array([0, 6, 0, 0]))
    batch.replace(0, new_cave())
    stepped(batch, 8)  # one vehicle has changed caves, the other has not
    assert batch.cave_of.tolist() == [0, 2, 1, 1]
    state, later = batch.state(), stepped(batch, 10)
    other = CaveBatch(caves, 4, replaceable=True, **options)
    other.put(2, new_cave())
    other.restore(state)
    for here, there in zip(later, stepped(other, 10), strict=True):
        assert all(np.array_equal(here[name], there[name]) for name in here)
    batch.reset(range(4))
    assert batch.cave_of.tolist() == [2, 2, 1, 1]  # all begin anew in the caves of now
    batch.close()
    other.close()


def test_a_cave_that_was_left_is_let_go_of() -> None:
    old = old_cave()
    left = weakref.ref(old)
    batch = CaveBatch(old, 2, next_step=False, replaceable=True, starts="anywhere", randomisation="wide")
    batch.reset(range(2))
    del old
    batch.replace(0, new_cave())
    stepped(batch, 12)
    assert batch.replace(0, new_cave())  # into the row of the one that was left
    gc.collect()
    assert left() is None
    batch.close()


def test_a_drawn_bodys_floaters_are_those_of_the_cave_that_it_is_in() -> None:
    """Those of the cave before are freed with it."""
    options = {"vehicle": "original-auv", "randomisation": "wide"}
    batch = CaveBatch(old_cave(), 2, next_step=False, replaceable=True, **options)
    batch.reset(range(2))
    batch.replace(0, new_cave())
    stepped(batch, 12)
    assert batch.cave_of.tolist() == [1, 1]
    bodies = batch.world.launched_on[2].numpy()
    there = batch.world._crafts.rows[1].dragged.floaters
    assert bodies["dragged"]["floaters"]["data"].tolist() == [there.ptr] * 2
    batch.close()


def test_what_cannot_be_replaced_is_told() -> None:
    with pytest.raises(InputError, match="Caves are replaced in batches with contacts of their own only"):
        CaveBatch(old_cave(), 2, next_step=True, replaceable=True)
    still = CaveBatch(tube_scenario(), 2, next_step=False, replaceable=True)
    with pytest.raises(InputError, match="in one batch they must be as long"):
        still.put(1, tube_scenario(limits=LimitSettings(substeps=3)))
    with pytest.raises(InputError, match=r"needs \d+ values of eddies for each vehicle, and .* began with 1\."):
        still.put(1, strong())
    still.close()


def strong() -> Scenario:
    """The tube with a current of its own."""
    scenario = flowing()
    water = dataclasses.replace(scenario.settings.water, current="full")
    return dataclasses.replace(scenario, settings=dataclasses.replace(scenario.settings, water=water))
