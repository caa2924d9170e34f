"""Comparing pair by pair: the errors hold whenever one stops, half of the episodes do, and a killed run goes on."""

from __future__ import annotations

import functools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from aquanav_tools.cli.evaluate import main
from aquanav_tools.evaluate.paired import episodes_for
from aquanav_tools.evaluate.sequential import LEVEL, MISSED, evidence, is_smaller, judge, log_wealth, verdict_of
from aquanav_tools.types import Array
from tests.commands import run_here

compare = functools.partial(run_here, main)
RUNS, LENGTH = 2000, 3000
SMALLEST = 0.05
POLICIES = ("baseline:reactive", "baseline:random")
SHOWN = {(0.5, 0.0), (0.5, 0.8), (0.8, 0.4), (0.95, 0.0), (0.95, 0.8)}
EQUAL = [
    pytest.param(rate, correlation, marks=[pytest.mark.slow] * ((rate, correlation) not in SHOWN))
    for rate in (0.5, 0.8, 0.9, 0.95)
    for correlation in (0.0, 0.4, 0.8)
]
"""Rates of success of two policies and how they go together; the extremes and the middle are in the default tests."""


def drawn(first: float, second: float, correlation: float, rng: np.random.Generator, runs: int = RUNS) -> Array:
    """Return (runs, LENGTH) differences of successes with these rates and this phi coefficient."""
    both = first * second + correlation * np.sqrt(first * (1 - first) * second * (1 - second))
    dice = rng.random((runs, LENGTH))
    one, two = first - both, second - both
    return (dice < one).astype(float) - ((dice >= one) & (dice < one + two))


def upper(probability: float) -> float:
    """Return what a frequency of RUNS events of this probability stays below but for one time in a thousand."""
    return probability + 3.1 * np.sqrt(probability * (1 - probability) / RUNS)


@pytest.mark.parametrize(("rate", "correlation"), EQUAL)
def test_equal_policies_are_hardly_ever_told_apart_whenever_one_stops(
    rate: float, correlation: float, rng: np.random.Generator
) -> None:
    pairs = drawn(rate, rate, correlation, rng)
    assert (evidence(pairs, 0.0, SMALLEST) >= 1 / LEVEL).any(axis=1).mean() <= upper(LEVEL)


@pytest.mark.parametrize("rates", [(0.95, 0.9), (0.55, 0.5), (0.85, 0.9)])
def test_policies_that_far_apart_are_hardly_ever_called_alike(
    rates: tuple[float, float], rng: np.random.Generator
) -> None:
    pairs = drawn(*rates, 0.4, rng)
    assert is_smaller(pairs, SMALLEST)[:, -1].mean() <= upper(MISSED)


@pytest.mark.parametrize("correlation", [0.0, pytest.param(0.3, marks=pytest.mark.slow), 0.5])
def test_a_pair_five_points_apart_takes_half_of_the_episodes_of_a_fixed_number_of_equal_power(
    correlation: float, rng: np.random.Generator
) -> None:
    pairs = drawn(0.95, 0.90, correlation, rng)
    is_over = (evidence(pairs, 0.0, SMALLEST) >= 1 / LEVEL) | is_smaller(pairs, SMALLEST)
    used = np.where(is_over.any(axis=1), is_over.argmax(axis=1) + 1, LENGTH)
    verdicts = [verdict_of(row[:count], SMALLEST) for row, count in zip(pairs, used, strict=True)]
    power = min(verdicts.count("first") / RUNS, 1 - MISSED)  # what was reached, at most what is promised
    assert power >= 0.98
    assert used.mean() <= 0.5 * episodes_for(float(np.abs(pairs).mean()), 0.05, norm.ppf(power))


def test_wealth_is_the_product_by_hand() -> None:
    # Before the first pair 1 of 10 is taken to differ: bets of 0.05 / 0.1; then of 0.05 / (2 / 11).
    wealth = np.exp(log_wealth(np.array([1.0, -1.0]), 0.0, 1, SMALLEST, None))
    np.testing.assert_allclose(wealth, [1.5, 1.5 * (1 - 0.05 * 11 / 2)], rtol=1e-12)


def test_wealth_is_a_martingale_over_all_orders_of_a_list() -> None:
    """Drawn without putting back, the mean wealth against the list's own mean is 1 after any number of pairs."""
    from itertools import permutations

    listed = np.array([1.0, 1.0, 0.0, -1.0, 0.0, 1.0])
    orders = np.array(list(permutations(listed)))
    for direction in (1, -1):
        wealth = np.exp(log_wealth(orders, float(listed.mean()), direction, 0.2, len(listed)))
        np.testing.assert_allclose(wealth.mean(axis=0), 1.0, atol=1e-6)


def test_the_interval_holds_the_difference_at_all_times_together(rng: np.random.Generator) -> None:
    pairs = drawn(0.95, 0.85, 0.3, rng)
    assert (evidence(pairs, 0.10, SMALLEST) >= 1 / LEVEL).any(axis=1).mean() <= upper(LEVEL)
    found = judge(pairs[0], SMALLEST)
    assert found.verdict == "first"
    assert 0.0 < found.difference.low < 0.10 < found.difference.high < 0.25
    assert found.p_value == pytest.approx(1 / found.e_value)


def test_all_that_there_are_leave_nothing_to_chance() -> None:
    found = judge(np.array([1.0, 0.0, 0.0, 0.0]), SMALLEST, population=4)
    assert found.verdict == "first"
    assert (found.difference.low, found.difference.high) == (0.25, 0.25)
    assert judge(np.zeros(4), SMALLEST, population=4).verdict == "alike"
    assert judge(np.zeros(4), SMALLEST).verdict == "open"


def test_two_baselines_are_told_apart_early_and_a_stopped_run_goes_on(folder: Path, tmp_path: Path) -> None:
    flags: list[Any] = ["--scenario", folder, "--block", 4, "--workers", 1, "--max-decisions", 300, "-o", tmp_path]
    whole = compare("compare", "--sequential", *POLICIES, *flags)
    assert whole.returncode == 0, whole.stderr
    assert "baseline:reactive is better than baseline:random: 12 of at most 20 pairs" in whole.stdout
    numbers = (tmp_path / "comparison.json").read_text()
    assert json.loads(numbers)["comparisons"][0]["sequential"]["verdict"] == "first"
    journal = tmp_path / "baseline-reactive" / "episodes.jsonl"
    lines = journal.read_bytes().splitlines(keepends=True)
    starts = {json.loads(line)["metrics"]["index"] for line in lines[1:]}
    assert starts != set(range(12)), "the order is a permutation, not the scenario's"
    journal.write_bytes(b"".join(lines[:4]) + lines[4][:20])
    again = compare("compare", "--sequential", *POLICIES, *flags, "--resume")
    assert again.returncode == 0, again.stderr
    assert (tmp_path / "comparison.json").read_text() == numbers
    assert journal.read_bytes().splitlines()[:4] == [line.rstrip() for line in lines[:4]]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (POLICIES[:1], "takes two policies, not 1"),
        ((*POLICIES, "--smallest-difference", "5"), "--smallest-difference is 5.0"),
        ((*POLICIES, "--protocol", "quick", "--smallest-difference", "5"), "--smallest-difference is 5.0"),
        ((*POLICIES, "--block", "0"), "--block is 0; choose 1 or more"),
    ],
)
def test_what_cannot_be_compared_is_refused(arguments: tuple[str, ...], sentence: str, tmp_path: Path) -> None:
    result = compare("compare", "--sequential", *arguments, "--scenario", tmp_path, "-o", tmp_path / "out")
    assert result.returncode == 2
    assert sentence in result.stderr
