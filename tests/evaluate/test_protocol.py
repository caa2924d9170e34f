from __future__ import annotations

from collections import Counter

import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.options import EvaluateOptions, Grid
from aquanav_tools.evaluate.protocol import FOLDER, conditions_of, plan_episodes, read_protocol
from aquanav_tools.shipped import shipped_names


def test_same_seed_gives_the_same_episodes_and_another_seed_another_order() -> None:
    assert plan_episodes(10, 25, seed=3) == plan_episodes(10, 25, seed=3)
    orders = [[plan.start_index for plan in plan_episodes(10, 10, seed)] for seed in (0, 1)]
    assert orders[0] != orders[1]


def test_episode_seeds_count_up_from_the_given_one() -> None:
    assert [plan.seed for plan in plan_episodes(4, 6, seed=100)] == [100, 101, 102, 103, 104, 105]


def test_no_start_comes_twice_more_often_than_another() -> None:
    counts = Counter(plan.start_index for plan in plan_episodes(10, 25, seed=0))
    assert set(counts) == set(range(10))
    assert max(counts.values()) - min(counts.values()) == 1


def test_short_evaluation_is_the_beginning_of_a_long_one() -> None:
    assert plan_episodes(10, 50, seed=5)[:12] == plan_episodes(10, 12, seed=5)


def test_grid_gives_every_combination() -> None:
    conditions = conditions_of(Grid(sensor_noise=(0.0, 0.1), action_delay=(0, 2, 4)))
    assert len(conditions) == 6
    assert {"sensor_noise": 0.1, "action_delay": 4} in [condition.changes for condition in conditions]
    assert conditions_of(Grid())[0].changes == {}


@pytest.mark.parametrize("name", shipped_names(FOLDER))
def test_shipped_protocols_are_options_of_an_evaluation(name: str) -> None:
    assert EvaluateOptions(("baseline:random",), ("cave",), **read_protocol(name)).episodes >= 10  # type: ignore[arg-type]


def test_paper_starts_anywhere_and_one_collision_ends_it() -> None:
    assert read_protocol("paper")["starts"] == "anywhere"
    assert read_protocol("paper")["on_collision"] == "end"


def test_misspelt_protocol_gets_the_closest_match() -> None:
    with pytest.raises(InputError, match="Did you mean 'paper'"):
        read_protocol("papr")
