"""Which drawn caves are for training and which for tests: a rule that every name can be held against.

A cave generated/STYLE/SEED is a test cave where the SHA-256 of "aquanav-300|STYLE|SEED" (STYLE as the seed picks it
where it is mixed), read as a whole number, is divisible by five: a fifth of them, spread evenly. No training may name
one, and none is drawn for a training.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from aquanav_tools.errors import InputError
from aquanav_tools.scenario.shipped import GENERATED, drawn_from, generated_name
from aquanav_tools.synthetic.styles.names import MAX_SEED, STYLE_NAMES, style_of

if TYPE_CHECKING:
    from aquanav_tools.scenario.schema import Scenario

Spec = TypeVar("Spec")
SALT = "aquanav-300"
"""Begins what is hashed; another word would make another split."""
TEST_ONE_IN = 5


def is_test_cave(style: str, seed: int) -> bool:
    """Return whether a drawn cave is one of those that no training may see.

    Raises:
        InputError: there is no such style, or the seed is out of range.
    """
    return _number(SALT, style_of(style, seed), seed) % TEST_ONE_IN == 0


def names_for_tests(style: str, count: int) -> list[str]:
    """Return the names of the first test caves of a style, by their seeds from 0 upwards."""
    seeds = (seed for seed in itertools.count() if is_test_cave(style, seed))
    return [generated_name(style, seed) for seed in itertools.islice(seeds, count)]


def training_seed(style: str, *parts: object) -> int:
    """Return a seed for training that is drawn by a hash of `parts`: the same for the same ones, on every machine."""
    first = _number(style, *parts) % (MAX_SEED + 1)
    return next(seed for seed in _upwards(first) if not is_test_cave(style, seed))


def check_training_cave(name: str) -> None:
    """Check that a training may use a scenario; what is no name of a drawn cave passes.

    Raises:
        InputError: it is a test cave; the message has the rule and the next seed.
        ScenarioError: the name begins as that of a drawn cave and is none.
    """
    drawn = drawn_from(name)
    if drawn is not None:
        _refuse_test_cave(name, *drawn)


def check_training_scenario(scenario: Scenario) -> None:
    """The same for a scenario that was read, from wherever it lay: a drawn cave's title is STYLE-SEED.

    Raises:
        InputError: as in `check_training_cave`.
    """
    style, _, seed = scenario.name.rpartition("-")
    is_drawn = scenario.settings.built.kind == "synthetic" and style in STYLE_NAMES and seed.isdecimal()
    if is_drawn and int(seed) <= MAX_SEED:
        _refuse_test_cave(scenario.name, style, int(seed))


def fixed_draw(specs: Sequence[Spec], most: int, seed: int) -> list[Spec | str]:
    """Return scenarios with names in place of each style without a seed: those of caves for training.

    Args:
        specs: Names, paths or whatever stands for scenarios.
        most: Drawn caves in all, dealt to the styles in turn; each has one at least.
        seed: Draws them.

    Raises:
        InputError: there is no such style.
    """
    found = [distribution_of(str(spec)) if isinstance(spec, str | Path) else None for spec in specs]
    fixed = [spec for spec, style in zip(specs, found, strict=True) if style is None]
    styles = [style for style in found if style is not None]
    turns = [styles[n % len(styles)] for n in range(max(most, len(styles)))] if styles else []
    drawn = [generated_name(style, training_seed(style, seed, n, 0)) for n, style in enumerate(turns)]
    return [*fixed, *drawn]


def _refuse_test_cave(name: str, style: str, seed: int) -> None:
    if not is_test_cave(style, seed):
        return
    free = next(other for other in _upwards(seed) if not is_test_cave(style, other))
    raise InputError(
        f"{name} is a test cave: a fifth of the seeds, by a hash of style and seed, is kept for tests, and no training "
        f"or validation may use one (docs/caves.md). The next seed for training is {generated_name(style, free)}."
    )


def distribution_of(name: str) -> str | None:
    """Return the style in a name generated/STYLE, which stands for all its caves for training; None for another name.

    Raises:
        InputError: there is no such style.
    """
    parts = name.split("/")
    if len(parts) != 2 or parts[0] != GENERATED:
        return None
    style_of(parts[1], 0)
    return parts[1]


def _upwards(seed: int) -> itertools.chain[int]:
    return itertools.chain(range(seed, MAX_SEED + 1), range(seed))


def _number(*parts: object) -> int:
    return int.from_bytes(hashlib.sha256("|".join(map(str, parts)).encode()).digest(), "big")
