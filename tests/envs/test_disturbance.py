from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.envs.disturbance import Delay, disturb_rays
from aquanav_tools.sim.spheres import NOTHING, WALL

LENGTHS = np.full(2000, 4.0)
HIT = np.full(2000, 2.0, dtype=np.float32)
TAGS = np.full(2000, WALL)


def test_noise_has_its_standard_deviation_and_no_bias(rng: np.random.Generator) -> None:
    measured, tags = disturb_rays(HIT, TAGS, LENGTHS, 0.1, 0.0, rng)
    # 2000 draws: the mean errs by 0.1 / sqrt(2000) = 0.0022 m, the deviation by 0.1 / sqrt(4000); four sigma
    assert measured.mean() == pytest.approx(2.0, abs=0.009)
    assert measured.std() == pytest.approx(0.1, abs=0.0064)
    assert (tags == WALL).all()


def test_measured_distances_stay_on_the_ray(rng: np.random.Generator) -> None:
    measured, _ = disturb_rays(np.linspace(0, 4, 2000).astype(np.float32), TAGS, LENGTHS, 3.0, 0.0, rng)
    assert measured.min() >= 0.0
    assert measured.max() <= 4.0


def test_a_ray_that_meets_nothing_has_no_error(rng: np.random.Generator) -> None:
    free = LENGTHS.astype(np.float32)
    measured, _ = disturb_rays(free, np.full(2000, NOTHING), LENGTHS, 0.5, 0.0, rng)
    np.testing.assert_array_equal(measured, free)


def test_dropout_takes_the_echo_of_its_share_of_rays(rng: np.random.Generator) -> None:
    measured, tags = disturb_rays(HIT, TAGS, LENGTHS, 0.0, 0.25, rng)
    is_lost = measured == 4.0
    assert is_lost.mean() == pytest.approx(0.25, abs=4 * np.sqrt(0.25 * 0.75 / 2000))
    np.testing.assert_array_equal(is_lost, tags == NOTHING)
    np.testing.assert_array_equal(measured[~is_lost], 2.0)


def test_as_many_numbers_are_drawn_whatever_is_measured() -> None:
    after = []
    for noise, dropout, rays in ((0.0, 0.0, HIT), (1.0, 0.5, LENGTHS.astype(np.float32))):
        rng = np.random.default_rng(0)
        disturb_rays(rays, TAGS, LENGTHS, noise, dropout, rng)
        after.append(rng.random())
    assert after[0] == after[1]


@pytest.mark.parametrize("turns", [0, 1, 3])
def test_a_value_comes_out_after_its_turns(turns: int) -> None:
    delay: Delay[int] = Delay(turns)
    delay.fill(-1)
    assert [delay.through(n) for n in range(6)] == ([-1] * turns + list(range(6)))[:6]
    delay.fill(-2)
    assert delay.through(0) == (-2 if turns else 0)
