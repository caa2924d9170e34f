"""Which drawn caves are for tests: a rule by a hash, which no training gets around."""

from __future__ import annotations

import dataclasses
import hashlib

import numpy as np
import pytest

from aquanav_tools.errors import InputError, ScenarioError
from aquanav_tools.scenario.schema import BuiltBy
from aquanav_tools.scenario.split import (
    check_training_cave,
    check_training_scenario,
    distribution_of,
    is_test_cave,
    names_for_tests,
    training_seed,
)
from aquanav_tools.synthetic.styles.names import STYLE_NAMES, style_of
from tests.caves import tube_scenario


def by_the_rule(style: str, seed: int) -> bool:
    return int(hashlib.sha256(f"aquanav-300|{style}|{seed}".encode()).hexdigest(), 16) % 5 == 0


def test_the_split_is_the_documented_hash_and_keeps_a_fifth() -> None:
    pairs = [(style, seed) for style in STYLE_NAMES for seed in range(500)]
    held = [is_test_cave(*pair) for pair in pairs]
    assert held == [by_the_rule(*pair) for pair in pairs]
    spread = np.sqrt(len(pairs) * 0.2 * 0.8)
    assert abs(sum(held) - len(pairs) / 5) < 4.0 * spread


def test_a_cave_is_on_one_side_by_whatever_name() -> None:
    assert [is_test_cave("mixed", seed) for seed in range(300)] == [
        by_the_rule(style_of("mixed", seed), seed) for seed in range(300)
    ]


def test_test_sets_are_the_first_test_seeds_and_trainings_draw_none() -> None:
    names = names_for_tests("maze", 5)
    assert names == [f"generated/maze/{n}" for n in range(100) if by_the_rule("maze", n)][:5]
    drawn = [training_seed(style, 7, number) for style in ("maze", "mixed") for number in range(300)]
    assert not any(is_test_cave("maze", seed) for seed in drawn[:300])
    assert not any(is_test_cave("mixed", seed) for seed in drawn[300:])
    assert len(set(drawn)) == 600 and drawn[0] == training_seed("maze", 7, 0)


def test_a_test_cave_in_a_training_is_refused_with_the_next_seed() -> None:
    seed = next(n for n in range(100) if by_the_rule("maze", n))
    free = next(n for n in range(seed, 200) if not by_the_rule("maze", n))
    with pytest.raises(InputError, match=rf"generated/maze/{seed} is a test cave.* is generated/maze/{free}\."):
        check_training_cave(f"generated/maze/{seed}")
    check_training_cave(f"generated/maze/{free}")
    check_training_cave("cave-train-1")
    drawn = dataclasses.replace(tube_scenario(name=f"maze-{seed}").settings, built=BuiltBy("0", "synthetic"))
    with pytest.raises(InputError, match=f"maze-{seed} is a test cave"):
        check_training_scenario(dataclasses.replace(tube_scenario(), settings=drawn))
    scanned = dataclasses.replace(drawn, built=BuiltBy("0", "scan"))
    check_training_scenario(dataclasses.replace(tube_scenario(), settings=scanned))  # a name like it, not drawn


def test_a_style_without_a_seed_stands_for_all_its_caves() -> None:
    assert distribution_of("generated/mixed") == "mixed"
    assert [distribution_of(name) for name in ("generated/maze/7", "cave-train-1", "caves/maze")] == [None] * 3
    with pytest.raises(InputError, match="no style 'maz'"):
        distribution_of("generated/maz")
    with pytest.raises(ScenarioError):
        check_training_cave("generated/maze/x")
