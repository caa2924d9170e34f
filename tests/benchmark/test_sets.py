"""The sets that ship hold to the rule by which they are drawn."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.benchmark.definition import SETS, TierRules, read_benchmark
from aquanav_tools.evaluate.protocol import task_under
from aquanav_tools.scenario.shipped import drawn_from
from aquanav_tools.scenario.split import is_test_cave, training_seed
from aquanav_tools.shipped import shipped_names
from aquanav_tools.synthetic.styles.catalogue import STYLES
from aquanav_tools.synthetic.styles.names import number_of
from aquanav_tools.task import TaskOptions
from eval.benchmark_set import RULES, basis_of, is_valid, tier_of

NARROW = "squeezes"


@pytest.mark.parametrize("name", [name for name in shipped_names(SETS) if name != NARROW])
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


def test_quick_is_the_beginning_of_each_tier_of_the_set() -> None:
    quick, whole = read_benchmark("quick"), read_benchmark("aquanav-300")
    assert (quick.episodes, quick.seed, len(quick.caves), len(whole.caves)) == (whole.episodes, whole.seed, 30, 300)
    for some, all_ in zip(quick.tiers, whole.tiers, strict=True):
        assert (some.name, some.rules, some.caves) == (all_.name, all_.rules, all_.caves[:6])


def test_the_narrow_set_is_what_its_rule_draws_and_no_test_cave() -> None:
    """The sizes are drawn as `cave.styles.drawing` draws them, from the seed alone."""
    for tier in read_benchmark(NARROW).tiers:
        kind, drawn, number = STYLES[tier.name], [], 0
        while len(drawn) < len(tier.caves):
            seed = training_seed(tier.name, "held-out squeezes", number)
            number += 1
            sizes = np.random.default_rng([number_of(tier.name, seed), 1])
            length, opening = (
                float(np.exp(sizes.uniform(*np.log(range_)))) for range_ in (kind.lengths, kind.openings)
            )
            if opening < 2.9 and length < 80.0:
                drawn.append(f"generated/{tier.name}/{seed}")
        assert [cave.scenario for cave in tier.caves] == drawn
        assert not any(is_test_cave(*drawn_from(name)) for name in drawn)  # type: ignore[misc]
        assert tier.rules == TierRules(current="full")


@pytest.mark.parametrize(
    ("width", "turn", "length", "tier"),
    [
        (4.0, 11.9, 69.0, "tier 1"),
        (3.9, 0.0, 20.0, "tier 2"),
        (3.9, 12.0, 70.0, "tier 4"),
        (2.0, 0.0, 20.0, "tier 4"),
        (1.99, 0.0, 20.0, "tier 5"),
    ],
)
def test_tiers_count_points(width: float, turn: float, length: float, tier: str) -> None:
    assert tier_of(width, turn, length) == tier


def test_a_cave_is_looked_at_anew_where_its_rules_or_its_tier_changed_and_where_a_dive_is_missing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    row = {"scenario": "generated/mixed/7", "width": 3.5, "turn": 3.0, "length": 30.0, "tier": "tier 2"}
    row["basis"] = basis_of("tier 2")
    assert is_valid({"scenario": "generated/mixed/8", "fault": "It is too tight."}, ())
    assert is_valid(row | {"clean": 10}, ())
    assert is_valid(row, ("tier 2",)) and not is_valid(row, ("tier 1",))
    assert not is_valid(row | {"clean": 10, "width": 2.9}, ())  # tier 3, which has the rules of tier 2
    monkeypatch.setitem(RULES, "tier 2", TierRules(current="still"))
    assert not is_valid(row | {"clean": 10}, ())
