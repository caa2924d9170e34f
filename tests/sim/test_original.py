"""The original benchmark's body against its table, numbers from its authors' engine, and closed forms of its rule.

The rule v <- (v + a dt)(1 - drag dt) has the closed form v_n = v_end (1 - (1 - drag dt)^n).
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from aquanav_tools.sim.batch.prediction import Prediction, Predictor, advance
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.sim.vehicle_base import Vehicle
from aquanav_tools.types import Array, Pose, rotation_matrix, yaw_quaternion

DT = 0.02
STILL = np.zeros(3)
AUV, BOAT = load_vehicle("original-auv"), load_vehicle("boat")
assert isinstance(AUV, OriginalVehicle)


def predict(
    vehicle: Vehicle, command: tuple[float, float, float], steps: int, current: Array = STILL, yaw: float = 0.0
) -> Prediction:
    """Hold ballast, steer and thrust for so many physics steps, from rest and a neutral trim."""
    state = vehicle.state_at(Pose(np.array([1.0, 2.0, 3.0]), yaw_quaternion(yaw)))
    commands = np.broadcast_to(np.array(command, dtype=np.float64), (1, steps, 3))
    return Predictor(vehicle, 1000.0, DT, 1).predict(state[None], np.zeros(1), commands, current)


def swim(
    vehicle: Vehicle,
    command: tuple[float, float, float],
    seconds: float,
    current: Array = STILL,
    yaw: float = 0.0,
) -> Array:
    """The (N + 1, 14) states of holding ballast, steer and thrust from rest."""
    return predict(vehicle, command, round(seconds / DT), current, yaw).states[0]


def test_speed_ahead_follows_the_closed_form() -> None:
    speeds = np.linalg.norm(swim(AUV, (0, 0, 1), 10.0)[:, 7:10], axis=1)
    steps = np.arange(len(speeds))
    # 4000 N on 2000 kg: 2 m/s^2 * 0.98 s at the end. The floaters tilt the body by a degree, which costs 2e-4 and adds
    # 0.02 m/s of heave.
    np.testing.assert_allclose(speeds, 1.96 * (1.0 - 0.98**steps), rtol=1e-3, atol=1e-4)


@pytest.mark.parametrize(
    ("command", "axis", "expected"),
    [((0, 0, 1), 7, 1.96), ((0, 0, -1), 7, -0.98), ((0, 1, 1), 12, 3.04), ((0, -1, 1), 12, -3.04)],
)
def test_it_settles_at_the_tables_speeds(command: tuple[float, float, float], axis: int, expected: float) -> None:
    assert swim(AUV, command, 15.0)[-1, axis] == pytest.approx(expected, abs=0.005)  # as the table rounds


def test_95_percent_of_the_speed_take_2_98_seconds() -> None:
    speeds = swim(AUV, (0, 0, 1), 5.0)[:, 7]
    assert DT * int(np.argmax(speeds >= 0.95 * 1.96)) == pytest.approx(2.98, abs=DT)


@pytest.mark.parametrize(
    ("ballast", "heights"),
    [(1.0, {1: 0.21, 2: 1.24, 3: 3.06, 5: 7.2}), (-1.0, {1: -0.21, 2: -1.29, 3: -3.44, 5: -10.6})],
)
def test_ballast_moves_it_as_the_table_says(ballast: float, heights: dict[int, float]) -> None:
    states = swim(AUV, (ballast, 0, 0), 6.0)
    for seconds, height in heights.items():
        rise = states[round(seconds / DT), 2] - states[0, 2]
        assert rise == pytest.approx(height, abs=0.05 if seconds == 5 else 0.006)  # as the table rounds


def test_it_floats_where_it_starts() -> None:
    heights = swim(AUV, (0, 0, 0), 60.0)[:, 2]
    # The centre of mass stays; the root, 0.1 m above it, sinks by the cosine of a degree of tilt.
    assert np.ptp(heights) < 1e-3


def test_it_does_not_turn_on_the_spot_and_steers_the_other_way_in_reverse() -> None:
    assert abs(swim(AUV, (0, 1, 0), 2.0)[-1, 12]) < 0.01  # the floaters' asymmetry
    assert swim(AUV, (0, 1, -1), 15.0)[-1, 12] == pytest.approx(-3.04, abs=0.005)


def test_the_stabiliser_takes_a_fifth_of_a_tilt_per_step_and_leaves_the_heading() -> None:
    state = AUV.state_at(Pose(np.zeros(3), yaw_quaternion(0.0)))
    tilt, heading = 0.5, yaw_quaternion(1.0)
    c, s = np.cos(tilt / 2), np.sin(tilt / 2)  # roll by `tilt`, then turn to the heading
    state[3:7] = [heading[0] * c, heading[0] * s, heading[3] * s, heading[3] * c]
    parameters = AUV.motion_parameters(1000.0)
    # Too heavy to turn for the floaters: the stabiliser alone acts.
    parameters = dataclasses.replace(parameters, inertia=1e12 * parameters.inertia)
    states = advance(state[None], np.array([0, 0, 250.0, 0, 0, 0]), STILL, parameters, DT, 9)[0]
    for n in range(1, 10):
        matrix = rotation_matrix(states[n, 3:7])
        assert np.arccos(matrix[2, 2]) == pytest.approx(tilt * 0.8**n, rel=1e-6)
        assert np.arctan2(matrix[1, 0], matrix[0, 0]) == pytest.approx(1.0, abs=1e-9)


def test_power_stays_within_its_limits_and_shows_as_trim() -> None:
    # The original's power goes from 250 N/m by 0.8 N/m a step to 700 or 100; the trim is its share of that way.
    for ballast, limit in ((1.0, 700.0), (-1.0, 100.0)):
        power = np.clip(250.0 + ballast * 0.8 * np.arange(1001), 100.0, 700.0)
        trims = predict(AUV, (ballast, 0.0, 0.0), 1000).trims[0]
        np.testing.assert_allclose(trims, (power - 250.0) / abs(limit - 250.0), atol=1e-12)
        assert trims[-1] == ballast


def test_a_current_carries_it_along() -> None:
    current = np.array([0.3, -0.2, 0.0])
    states = swim(AUV, (0, 0, 0), 20.0, current)
    velocity = rotation_matrix(states[-1, 3:7]) @ states[-1, 7:10]
    np.testing.assert_allclose(velocity, current, atol=0.001)


def test_motion_turns_with_the_heading() -> None:
    turn = rotation_matrix(yaw_quaternion(2.0))
    straight, turned = (swim(AUV, (1, 1, 1), 3.0, yaw=yaw) for yaw in (0.0, 2.0))
    np.testing.assert_allclose(turned[:, 7:], straight[:, 7:], atol=1e-9)
    np.testing.assert_allclose(turned[:, :3] - turned[0, :3], (straight[:, :3] - straight[0, :3]) @ turn.T, atol=1e-9)


def test_boat_speeds_up_as_the_closed_form_says_and_keeps_its_height() -> None:
    states = swim(BOAT, (1, 0, 1), 30.0)
    # 10 N s per step on 200 kg with a drag of 0.2 /s: (v + 0.05) 0.996.
    steps = np.arange(len(states))
    np.testing.assert_allclose(states[:, 7], 12.45 * (1.0 - 0.996**steps), rtol=1e-9, atol=1e-12)
    assert np.ptp(states[:, 2]) == 0.0


def test_boat_turns_on_the_spot() -> None:
    # 1200 N m on 1421 kg m^2: 0.01689 rad/s per step, 4.205 rad/s at the end.
    assert swim(BOAT, (0, 1, 0), 60.0)[-1, 12] == pytest.approx(1200 / 1421 * DT * 0.996 / 0.004, rel=1e-4)
