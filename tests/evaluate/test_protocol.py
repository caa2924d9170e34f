from __future__ import annotations

from collections import Counter

from aquanav_tools.evaluate.protocol import plan_episodes


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
