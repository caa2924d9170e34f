from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binomtest

from aquanav_tools.evaluate.statistics import wilson


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
