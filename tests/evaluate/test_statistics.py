from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest, bootstrap

from aquanav_tools.evaluate.paired import compare_rates, fraction_won, probability_of_improvement
from aquanav_tools.evaluate.statistics import (
    bootstrap_means,
    bootstrap_ratio,
    episodes_for,
    failure_bound,
    interquartile_mean,
    wilson,
)

SCORES = np.array([[0.62, 0.91, 0.40], [0.70, 0.88, 0.55], [0.15, 0.97, 0.47], [0.66, 0.79, 0.61], [0.58, 0.93, 0.05]])
OTHERS = np.array([[0.51, 0.90, 0.33], [0.64, 0.70, 0.55], [0.35, 0.91, 0.21], [0.49, 0.81, 0.52]])


@pytest.mark.parametrize(("hits", "trials"), [(0, 1), (1, 1), (0, 20), (20, 20), (7, 50), (499, 1000)])
def test_wilson_interval_equals_scipys(hits: int, trials: int) -> None:
    expected = binomtest(hits, trials).proportion_ci(0.95, method="wilson")
    ours = wilson(hits, trials)
    assert ours.rate == hits / trials
    np.testing.assert_allclose([ours.low, ours.high], [expected.low, expected.high], atol=1e-12)


def test_all_of_twenty_is_no_proof_of_more_than_84_percent() -> None:
    assert wilson(20, 20).low == pytest.approx(0.8389, abs=1e-4)  # 20 / (20 + 1.96^2), by hand


@pytest.mark.parametrize(("hits", "trials"), [(0, 0), (3, 2), (-1, 2)])
def test_impossible_counts_are_refused(hits: int, trials: int) -> None:
    with pytest.raises(ValueError, match="hits in"):
        wilson(hits, trials)
    with pytest.raises(ValueError, match="hits in"):
        failure_bound(hits, trials)


@pytest.mark.parametrize(("failures", "trials"), [(0, 1), (0, 300), (1, 20), (17, 50), (49, 50), (5, 5)])
def test_failure_bound_is_clopper_and_pearsons(failures: int, trials: int) -> None:
    expected = binomtest(failures, trials, alternative="less").proportion_ci(0.95, method="exact").high
    assert failure_bound(failures, trials) == pytest.approx(expected, abs=1e-9)


def test_without_a_failure_the_bound_is_the_rule_of_three() -> None:
    assert failure_bound(0, 300) == pytest.approx(1.0 - 0.05 ** (1 / 300), abs=1e-12)  # (1 - p)^300 = 5 %
    assert failure_bound(0, 300) == pytest.approx(3 / 300, rel=0.01)


@pytest.mark.parametrize("rate", [0.5, 0.9, 1.0])
def test_advised_number_of_episodes_is_the_smallest_that_is_enough(rate: float) -> None:
    count = episodes_for(rate, 0.02)

    def half_width(trials: int) -> float:
        squared = 1.959964**2
        return float(
            1.959964 / (trials + squared) * np.sqrt(trials * rate * (1 - rate) + squared / 4)  # Wilson 1927
        )

    assert half_width(count) <= 0.02 < half_width(count - 1)
    assert {0.5: 2397, 0.9: 866, 1.0: 93}[rate] == pytest.approx(
        count, rel=0.02
    )  # z^2 p (1 - p) / 0.02^2; z^2/2w - z^2


def test_bootstrap_interval_of_a_mean_agrees_with_scipys(rng: np.random.Generator) -> None:
    values = rng.exponential(size=80)
    expected = bootstrap((values,), np.mean, n_resamples=20_000, method="percentile", rng=rng).confidence_interval
    ours = bootstrap_means(np.stack([values, 2.0 * values], axis=1))
    width = expected.high - expected.low
    assert (ours[0].low, ours[0].high) == pytest.approx((expected.low, expected.high), abs=0.06 * width)
    assert ours[1].high == pytest.approx(2.0 * ours[0].high)
    assert ours[0].mean == pytest.approx(values.mean())


def test_ratio_is_that_of_sums_and_no_way_gives_no_collisions() -> None:
    ratio = bootstrap_ratio(np.array([1.0, 3.0]), np.array([0.5, 1.5]))
    assert (ratio.mean, ratio.low, ratio.high) == pytest.approx((2.0, 2.0, 2.0))
    assert bootstrap_ratio(np.zeros(3), np.zeros(3)).mean == 0.0


def test_interquartile_mean_is_the_mean_of_the_middle_half() -> None:
    assert interquartile_mean(np.array([[0.0, 1.0, 2.0, 9.0], [3.0, 4.0, 5.0, -9.0]])) == 2.5 - 0.75 + 0.25 * 3


def test_interquartile_means_are_rliables() -> None:
    # rliable 1.2.0, metrics.aggregate_iqm on the same scores
    assert interquartile_mean(SCORES) == pytest.approx(0.6511111111111112)
    assert interquartile_mean(OTHERS) == pytest.approx(0.5683333333333334)


@pytest.mark.parametrize(("first", "second", "p_value"), [(1, 8, 20 / 512), (0, 6, 2 / 64), (5, 5, 1.0), (0, 0, 1.0)])
def test_mcnemars_p_value_is_that_of_tossing_a_coin(first: int, second: int, p_value: float) -> None:
    rates = compare_rates(*_outcomes(30, first, second, 10))
    assert rates.p_value == pytest.approx(p_value)  # 2 (1 + 9) / 2^9 and 2 / 2^6, by counting
    assert (rates.both, rates.only_first, rates.only_second, rates.neither) == (30, first, second, 10)


def test_interval_of_a_paired_difference_holds_the_truth_in_95_percent(rng: np.random.Generator) -> None:
    chances = [0.85, 0.09, 0.03, 0.03]
    hits = 0
    for counts in rng.multinomial(60, chances, size=2000):
        interval = compare_rates(*_outcomes(*counts)).difference
        hits += interval.low <= 0.06 <= interval.high
    assert 0.93 <= hits / 2000 <= 0.985  # Newcombe's mean coverage is 0.955 to 0.97; +-0.01 from 2000 draws


def test_improvement_is_counted_over_all_pairs_and_wins_over_the_same_episodes() -> None:
    first, second = np.array([1.0, 2.0, 3.0]), np.array([2.0, 2.0, 0.0])
    assert probability_of_improvement(first, second) == pytest.approx((1 + 2 + 3) / 9)
    assert fraction_won(first, second).mean == pytest.approx((0.0 + 0.5 + 1.0) / 3)


def _outcomes(both: int, only_first: int, only_second: int, neither: int) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[type-arg]
    counts = (both, only_first, only_second, neither)
    return np.repeat([True, True, False, False], counts), np.repeat([True, False, True, False], counts)
