"""The sets that ship hold to the rule by which they are drawn."""

from __future__ import annotations

import pytest

from aquanav_tools.benchmark.definition import SETS, read_benchmark
from aquanav_tools.evaluate.protocol import task_under
from aquanav_tools.scenario.shipped import drawn_from
from aquanav_tools.scenario.split import is_test_cave
from aquanav_tools.shipped import shipped_names
from aquanav_tools.task import TaskOptions
from eval.benchmark_set import RULES, tier_of


@pytest.mark.parametrize("name", shipped_names(SETS))
def test_a_set_consists_of_test_caves_in_the_tiers_of_the_rule(name: str) -> None:
    benchmark = read_benchmark(name)
    for tier, cave in benchmark.caves:
        drawn = drawn_from(cave.scenario)
        assert drawn is not None and is_test_cave(*drawn)
        assert cave.width is not None and cave.turn is not None and cave.length is not None
        assert tier_of(cave.width, cave.turn, cave.length) == tier.name
    assert {tier.name: tier.rules for tier in benchmark.tiers} == RULES
    assert len({len(tier.caves) for tier in benchmark.tiers}) == 1
    for tier in benchmark.tiers:
        assert task_under(tier.condition, TaskOptions()).current == tier.rules.current


@pytest.mark.parametrize(
    ("width", "turn", "length", "tier"),
    [
        (4.0, 7.9, 69.0, "tier 1"),
        (3.9, 0.0, 20.0, "tier 2"),
        (3.9, 8.0, 70.0, "tier 4"),
        (2.0, 0.0, 20.0, "tier 4"),
        (1.99, 0.0, 20.0, "tier 5"),
    ],
)
def test_tiers_count_points(width: float, turn: float, length: float, tier: str) -> None:
    assert tier_of(width, turn, length) == tier
