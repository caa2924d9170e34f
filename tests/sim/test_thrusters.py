"""Thrusters: allocation, lag and saturation in closed form, and the vehicle that has them."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from aquanav_tools.sim.body_parameters import BodyParameters
from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.thrusters import Thrusters
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array, Pose, rotation_matrix, yaw_quaternion
from tests.sim.bodies import DT, NONE, run

HEAVY = load_vehicle("bluerov2-heavy")
assert isinstance(HEAVY, FossenVehicle)
ORIGIN = Pose(np.zeros(3), yaw_quaternion(0.0))
MASS = np.array([20.0, 20.0, 20.0, 0.5, 0.5, 0.5])


def pusher(time_constant: float, limit: float = 1000.0) -> BodyParameters:
    """Parameters of a body without damping that one thruster through its centre pushes ahead."""
    thrusters = Thrusters(((0.0, 0.0, 0.0),), ((1.0, 0.0, 0.0),), limit, limit, time_constant)
    return BodyParameters(np.diag(MASS), NONE, NONE, thrusters=thrusters.parameters())


def surge(force: float) -> Array:
    return np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0])


def at_rest(num_thrusters: int) -> Array:
    state = np.zeros(13 + num_thrusters)
    state[3] = 1.0
    return state


def test_shares_of_a_wrench_add_up_to_it(rng: np.random.Generator) -> None:
    assert HEAVY.thrusters is not None
    wrench = rng.normal(size=6)
    np.testing.assert_allclose(HEAVY.thrusters.wrenches() @ HEAVY.thrusters.allocation() @ wrench, wrench, atol=1e-12)


def test_a_thruster_off_the_axis_turns_the_vehicle() -> None:
    # Half a metre to the right, pushing ahead: to the left about z, by force times lever.
    thrusters = Thrusters(((0.0, -0.5, 0.0),), ((1.0, 0.0, 0.0),), 1.0, 1.0, 0.0)
    np.testing.assert_allclose(thrusters.wrenches()[:, 0], [1, 0, 0, 0, 0, 0.5])


@pytest.mark.parametrize("dt", [0.02, 0.1])
def test_force_and_speed_follow_a_step_as_the_lag_says(dt: float) -> None:
    # f = F (1 - exp(-t / T)), v = F / m (t - T (1 - exp(-t / T))): exact at any dt, as the step takes the mean force.
    force, lag, duration = 40.0, 0.15, 1.0
    state = run(at_rest(1), round(duration / dt), pusher(lag), surge(force), dt=dt)
    rise = 1.0 - np.exp(-duration / lag)
    assert state[13] == pytest.approx(force * rise, rel=1e-12)
    assert state[7] == pytest.approx(force / MASS[0] * (duration - lag * rise), rel=1e-12)


def test_no_lag_is_the_force_at_once() -> None:
    state = run(at_rest(1), 1, pusher(0.0), surge(40.0))
    assert state[13] == 40.0
    assert state[7] == pytest.approx(40.0 / MASS[0] * DT, rel=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_no_thruster_pushes_harder_than_it_can(sign: float) -> None:
    state = run(at_rest(1), 200, pusher(0.1, limit=30.0), surge(sign * 500.0))
    assert state[13] == pytest.approx(sign * 30.0, rel=1e-12)


def test_heavy_reaches_the_speed_at_which_drag_balances_full_thrust() -> None:
    state = run(HEAVY.state_at(ORIGIN), 1500, HEAVY.motion_parameters(1000.0), surge(HEAVY.actuators.surge_force))
    # 13.7 v + 141 v^2 = 60 (von Benzon et al., table A1); 2e-3 is the splitting's error at dt = 0.02.
    assert state[7] == pytest.approx((np.sqrt(13.7**2 + 4 * 141 * 60) - 13.7) / (2 * 141), rel=2e-3)
    assert rotation_matrix(state[3:7])[2, 2] > np.cos(np.radians(1.0))  # level, though it is pushed from below


def test_heavy_rights_a_tilt_and_holds_its_rates_through_its_thrusters() -> None:
    state = HEAVY.state_at(ORIGIN)
    state[3:7] = [np.cos(0.3), np.sin(0.3) * 0.6, np.sin(0.3) * 0.8, 0]
    state = run(state, 150, HEAVY.motion_parameters(1000.0))
    assert rotation_matrix(state[3:7])[2, 2] > np.cos(np.radians(2.0))
    assert np.abs(state[10:13]).max() < 0.05


def test_heavy_turns_as_fast_as_drag_and_gain_leave() -> None:
    wrench = np.array([0, 0, 0, 0, 0, HEAVY.full_steer])
    state = run(HEAVY.state_at(ORIGIN), 400, HEAVY.motion_parameters(1000.0), wrench)
    # 3 (1.5 - r) = 1.5 r^2 is the balance of the rate loop and von Benzon's drag: r = 1 rad/s.
    assert state[12] == pytest.approx(1.0, rel=5e-3)


def test_full_actions_stay_within_the_thrusters_limits() -> None:
    assert HEAVY.thrusters is not None
    for demand in HEAVY.demands().values():
        assert np.abs(HEAVY.thrusters.allocation() @ demand).max() <= HEAVY.thrusters.max_forward


def test_thrusters_that_give_no_pure_push_are_refused() -> None:
    assert HEAVY.thrusters is not None
    vertical = HEAVY.thrusters.positions[4:], HEAVY.thrusters.directions[4:]
    with pytest.raises(ValueError, match=r"thrusters cannot produce full ahead: .* give no pure surge"):
        dataclasses.replace(HEAVY, thrusters=Thrusters(*vertical, 30.4, 30.4, 0.1))


def test_an_autopilot_needs_thrusters_about_every_axis_it_holds() -> None:
    # Three level thrusters and one in the middle that lifts: nothing turns the vehicle about x.
    sideways = Thrusters(
        ((0.0, 0.2, 0.0), (0.0, -0.2, 0.0), (0.0, 0.0, 0.0)), ((1, 0, 0), (1, 0, 0), (0, 0, 1)), 100, 100, 0.1
    )
    with pytest.raises(ValueError, match=r"cannot produce the autopilot's roll"):
        dataclasses.replace(HEAVY, thrusters=sideways)


def test_an_action_beyond_the_thrusters_is_refused_with_the_share_they_reach() -> None:
    # Four thrusters at 45 degrees give 4 * 30.4 / sqrt(2) = 86 N, which is 86 % of 100.
    strong = dataclasses.replace(HEAVY.actuators, surge_force=100.0)
    with pytest.raises(ValueError, match=r"cannot produce full ahead of 100 .* 30\.4 N\. They reach 86 %"):
        dataclasses.replace(HEAVY, actuators=strong)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"directions": ((1.0, 0.0, 0.0),) * 7}, r"directions has 7 rows and positions 8"),
        ({"directions": ((1.0, 1.0, 0.0),) * 8}, r"directions\[0\] must have length 1, got 1\.41"),
        ({"positions": (), "directions": ()}, r"positions must be 1 to 32 points, got 0"),
        ({"positions": ((np.nan, 0.0, 0.0),) * 8}, r"positions\[0\] must be finite"),
        ({"max_forward": 0.0}, r"max_forward must be positive"),
        ({"time_constant": -0.1}, r"time_constant must not be negative"),
    ],
)
def test_senseless_thrusters_are_refused_by_name(change: dict[str, object], message: str) -> None:
    assert HEAVY.thrusters is not None
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(HEAVY.thrusters, **change)  # type: ignore[arg-type]
