"""How long episodes last, and what a way takes at best."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from aquanav_tools.envs.cave_batch import CaveBatch
from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.scenario.schema import LimitSettings
from aquanav_tools.sim.time_limit import decision_limit, ideal_time
from aquanav_tools.sim.vehicle import load_vehicle
from tests import caves
from tests.caves import tube_scenario

TOP_SPEED = 0.9947
"""Of bluerov2, m/s (see test_trial)."""


def limit(length: float, monkeypatch: pytest.MonkeyPatch, vehicle: str = "bluerov2", **settings: object) -> int:
    """Return the limit in a tube of some length; its field, which does not count here, stays that of a short one."""
    field, cavity = caves.tube_field(), caves.tube_cavity()
    monkeypatch.setattr(caves, "tube_field", lambda: field)
    monkeypatch.setattr(caves, "tube_cavity", lambda: cavity)
    monkeypatch.setattr(caves, "TUBE_LENGTH", length)
    return decision_limit(tube_scenario(**settings), load_vehicle(vehicle))


@pytest.mark.parametrize("length", [20.0, 60.0, 119.0])
def test_the_original_limit_stays_where_it_is_twice_the_ideal(length: float, monkeypatch: pytest.MonkeyPatch) -> None:
    assert limit(length, monkeypatch) == 2400


@pytest.mark.parametrize("length", [150.0, 439.0, 2000.0])
def test_a_long_way_leaves_time_for_at_least_twice_the_ideal(length: float, monkeypatch: pytest.MonkeyPatch) -> None:
    ideal = length / TOP_SPEED / 0.1
    assert limit(length, monkeypatch) == pytest.approx(2400 + 6.0 * (ideal - 1200.0), abs=150.0)
    assert limit(length, monkeypatch) >= 2.0 * ideal


def test_a_slower_vehicle_has_more_time(monkeypatch: pytest.MonkeyPatch) -> None:
    assert limit(100.0, monkeypatch, "bluerov2-heavy") > limit(100.0, monkeypatch) == 2400


def test_an_explicit_limit_wins(monkeypatch: pytest.MonkeyPatch) -> None:
    assert limit(439.0, monkeypatch, limits=LimitSettings(decisions=300)) == 300
    scenario = tube_scenario()
    assert CaveEnv(scenario, max_decisions=7).max_decisions == 7


def test_environment_and_batch_end_episodes_by_the_same_rule() -> None:
    scenario = tube_scenario()
    slow = slowed(0.001)
    batch = CaveBatch(scenario, 2, next_step=True, vehicle=slow)
    assert CaveEnv(scenario, vehicle=slow).max_decisions == batch.limits[0] == decision_limit(scenario, slow) > 2400
    batch.close()


def slowed(share: float):  # type: ignore[no-untyped-def]  # any vehicle
    """Return bluerov2 with less thrust."""
    vehicle = load_vehicle("bluerov2")
    actuators = vehicle.actuators  # type: ignore[attr-defined]
    return dataclasses.replace(
        vehicle, actuators=dataclasses.replace(actuators, surge_force=share * actuators.surge_force)
    )


def test_still_water_takes_the_way_over_the_speed() -> None:
    best = ideal_time(tube_scenario(), load_vehicle("bluerov2"), "still")
    assert best(10.5) == pytest.approx(10.0 / TOP_SPEED, rel=1e-3)  # half a metre is the goal's tolerance
    assert best(100.5) == pytest.approx(100.0 / TOP_SPEED, rel=1e-3)
    assert best(0.2) == 0.0


def test_a_current_adds_to_the_speed_over_ground() -> None:
    vehicle, tube = load_vehicle("bluerov2"), tube_scenario()
    for speed in (-0.5, 0.3):
        best = ideal_time(tube, vehicle, (speed, 0.0, 0.0))
        assert best(10.5) == pytest.approx(10.0 / (TOP_SPEED + speed), rel=1e-3)
        assert best.slowest == pytest.approx(TOP_SPEED + speed, rel=1e-3)
    half = ideal_time(tube, vehicle, (-0.5, 0.0, 0.0), fraction=0.5)
    assert half(10.5) == pytest.approx(10.0 / (TOP_SPEED - 0.25), rel=1e-3)


def test_a_current_that_is_too_strong_is_told() -> None:
    best = ideal_time(tube_scenario(), load_vehicle("bluerov2"), (-1.2, 0.0, 0.0))
    assert best.slowest < 0.0
    assert np.isfinite(best(10.0))
