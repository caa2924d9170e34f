from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
import pytest

from aquanav_tools.sim.batch.disturbance import RayErrors, delay

LENGTHS = np.full(2000, 4.0)
HIT = np.full(2000, 2.0, dtype=np.float32)


def measure(rays: np.ndarray, noise: float, dropout: float, seed: int = 5, decision: int = 0) -> tuple[Any, Any]:
    """Return what one vehicle measures, and which of its rays got no echo."""
    measured, dropped = RayErrors(1, LENGTHS, noise, dropout).disturb(rays[None], [seed], [decision])
    return measured[0], dropped[0]


def test_noise_has_its_standard_deviation_and_no_bias() -> None:
    measured, dropped = measure(HIT, 0.1, 0.0)
    # 2000 draws: the mean errs by 0.1 / sqrt(2000) = 0.0022 m, the deviation by 0.1 / sqrt(4000); four sigma
    assert measured.mean() == pytest.approx(2.0, abs=0.009)
    assert measured.std() == pytest.approx(0.1, abs=0.0064)
    assert not dropped.any()


def test_errors_of_neighbouring_rays_and_of_following_decisions_do_not_depend_on_each_other() -> None:
    now, later = ((measure(HIT, 0.1, 0.0, decision=n)[0] - 2.0) / 0.1 for n in (0, 1))
    for first, second in ((now[:-1], now[1:]), (now, later)):  # four sigma of a correlation of 2000 pairs
        assert abs(np.corrcoef(first, second)[0, 1]) < 4.0 / np.sqrt(2000)


def test_measured_distances_stay_on_the_ray() -> None:
    measured, _ = measure(np.linspace(0, 4, 2000).astype(np.float32), 3.0, 0.0)
    assert measured.min() >= 0.0
    assert measured.max() <= 4.0


def test_a_ray_that_meets_nothing_has_no_error() -> None:
    free = LENGTHS.astype(np.float32)
    np.testing.assert_array_equal(measure(free, 0.5, 0.0)[0], free)


def test_dropout_takes_the_echo_of_its_share_of_rays() -> None:
    measured, dropped = measure(HIT, 0.0, 0.25)
    is_lost = measured == 4.0
    assert is_lost.mean() == pytest.approx(0.25, abs=4 * np.sqrt(0.25 * 0.75 / 2000))
    np.testing.assert_array_equal(is_lost, dropped)
    np.testing.assert_array_equal(measured[~is_lost], 2.0)


def test_vehicle_errs_beside_others_as_alone() -> None:
    rays = np.tile(HIT, (3, 1))
    together, _ = RayErrors(3, LENGTHS, 0.1, 0.2).disturb(rays, [7, 5, 4_000_000_000], [3, 8, 2])
    for row, (seed, decision) in zip(together, [(7, 3), (5, 8), (4_000_000_000, 2)], strict=True):
        np.testing.assert_array_equal(row, measure(HIT, 0.1, 0.2, seed, decision)[0])
    assert len(np.unique(together[:, 0])) == 3


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_rows_wait_in_queues_of_their_own(turns: int, rng: np.random.Generator) -> None:
    """Rows begin at different times, and some take no part in a turn."""
    waiting, counts = np.zeros((4, 2 * turns), dtype=np.float32), np.full(4, -1)
    lines: list[deque[Any]] = [deque() for _ in range(4)]
    for _ in range(12):
        values, chosen = rng.random((4, 2), dtype=np.float32), rng.random(4) < 0.8
        late = values.copy()
        delay(late, waiting, counts, chosen)
        for n in np.flatnonzero(chosen):
            if counts[n] < 0:
                lines[n] = deque([values[n]] * turns)
                np.testing.assert_array_equal(late[n], values[n])
            else:
                lines[n].append(values[n])
                np.testing.assert_array_equal(late[n], lines[n].popleft())
        counts[chosen] += 1
