from __future__ import annotations

from typing import Any

import pytest

from aquanav_tools.envs.episode import OUTCOMES
from aquanav_tools.envs.reward import (
    CAREFUL,
    DENSE,
    SAFE,
    SPARSE,
    TERMS,
    RewardWeights,
    boat_weights,
    cave_weights,
)
from aquanav_tools.errors import InputError
from aquanav_tools.sim.batch.episode import Decision
from aquanav_tools.sim.vehicle import load_vehicle

ENDS: dict[str, dict[str, Any]] = {
    "running": {},
    "success": {"is_at_goal": True},
    "collision": {"num_touched": 1, "ends_on_collision": True},
    "timeout": {"decisions": 2400},
}


def total(weights: RewardWeights, outcome: str = "running", **changes: Any) -> float:
    """Return what a decision is paid that ends in an outcome."""
    number, amounts = Decision(**(ENDS[outcome] | changes)).judge()
    assert OUTCOMES[number] == outcome
    return float(amounts @ [getattr(weights, name) for name in TERMS])


def test_dense_pays_ten_per_metre_less_time() -> None:
    assert total(DENSE, gained=0.3) == pytest.approx(10 * 0.3 - 5 * 0.01)


def test_dense_charges_each_step_of_contact() -> None:
    assert total(DENSE, num_touched=3) == pytest.approx(-5 * 0.01 - 3 * 0.01)


def test_dense_pays_500_at_the_goal() -> None:
    assert total(DENSE, outcome="success") == pytest.approx(500 - 0.05)


def test_a_contact_of_a_decision_costs_half_a_metre_to_the_careful_and_ten_where_it_ends_the_episode() -> None:
    assert total(CAREFUL, gained=0.5, num_touched=5) == pytest.approx(-0.05)
    assert total(CAREFUL, gained=10.1, num_touched=1, outcome="collision") == pytest.approx(-0.05)


def test_safe_charges_rays_that_are_cut_off() -> None:
    assert total(SAFE, cut_off=28.0) == pytest.approx(-0.05 - 5 * 0.14)  # -0.14 per step when all are at zero


def test_to_the_safe_swimming_at_1_m_per_s_pays_with_half_of_all_rays_cut_off_and_waiting_does_not() -> None:
    assert total(SAFE, gained=0.1, cut_off=14.0) > 0.0 > total(SAFE, cut_off=14.0)


def test_the_originals_vehicles_pay_the_originals_prices_of_nearness() -> None:
    # Its code: -0.02 per step and ray under water, five times as much for the boat.
    assert total(cave_weights("safe", load_vehicle("original-auv")), cut_off=28.0) == pytest.approx(-0.05 - 5 * 0.56)
    assert total(boat_weights("safe"), cut_off=7.0) == pytest.approx(-0.05 - 5 * 0.7)
    assert cave_weights("safe", load_vehicle("bluerov2")) == SAFE


@pytest.mark.parametrize("preset", ["dense", "careful", "sparse"])
def test_other_rewards_have_no_price_of_nearness_for_anybody(preset: str) -> None:
    assert cave_weights(preset, load_vehicle("original-auv")).proximity == boat_weights(preset).proximity == 0.0


@pytest.mark.parametrize(("outcome", "reward"), [("running", 0), ("success", 10), ("collision", -10), ("timeout", -1)])
def test_sparse_pays_for_the_outcome_only(outcome: str, reward: float) -> None:
    assert total(SPARSE, gained=2.0, num_touched=1, cut_off=9.0, outcome=outcome) == reward


def test_terms_come_in_the_order_of_their_names() -> None:
    """A weight of one for one term alone pays that term's own amount."""
    amounts = {"progress": 2.0, "time": 5.0, "contact": 3.0, "proximity": 5 * 0.25}
    for name in TERMS:
        paid = total(RewardWeights(**{name: 1.0}), gained=2.0, num_touched=3, cut_off=0.25)
        assert paid == amounts.get(name, 0.0)
    for name, outcome in (("goal", "success"), ("collision", "collision"), ("timeout", "timeout")):
        assert total(RewardWeights(**{name: 1.0}), outcome) == 1.0


def test_unknown_preset_suggests_the_closest() -> None:
    with pytest.raises(InputError, match="Did you mean 'dense'"):
        boat_weights("dens")
