"""What commands do, seen in the trim and in the first motion from rest."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.sim.batch.prediction import Prediction, Predictor
from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array, Pose, yaw_quaternion

VEHICLE = load_vehicle("bluerov2")
assert isinstance(VEHICLE, FossenVehicle)
AT_REST = VEHICLE.state_at(Pose(np.zeros(3), yaw_quaternion(0.0)))


def hold(commands: Array, trim: float = 0.0, dt: float = 0.02, substeps: int = 5) -> Prediction:
    """Give (D, 3) commands to a vehicle at rest."""
    given = np.asarray(commands, dtype=np.float64)[None]
    return Predictor(VEHICLE, 1000.0, dt, substeps).predict(AT_REST[None], np.array([trim]), given, np.zeros(3))


def wrench(ballast: float, steer: float, thrust: float, trim: float = 0.0) -> Array:
    """The (6,) wrench of a command: mass times speed after a time too short for drag, N and N m."""
    dt = 1e-7
    speed = hold([[ballast, steer, thrust]], trim, dt, 1).states[0, -1, 7:13]
    result: Array = VEHICLE.total_mass * speed / dt
    return result


def test_nothing_commanded_gives_no_wrench() -> None:
    np.testing.assert_array_equal(hold(np.zeros((5, 3))).states[0, -1], AT_REST)


def test_full_thrust_is_the_vehicles_force_and_half_of_it_in_reverse() -> None:
    # 1e-6: a speed of 1e-7 m/s has lost so little to drag.
    np.testing.assert_allclose(wrench(0, 0, 1), [22.0, 0, 0, 0, 0, 0], atol=1e-5)
    np.testing.assert_allclose(wrench(0, 0, -1), [-11.0, 0, 0, 0, 0, 0], atol=1e-5)


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_steer_asks_for_the_moment_that_turns_at_the_vehicles_rate(side: float) -> None:
    # 1.5 rad/s times the autopilot's 15 N m s/rad; to the left is positive about body z.
    np.testing.assert_allclose(wrench(0, side, 0), [0, 0, 0, 0, 0, side * 22.5], atol=1e-4)


def test_ballast_lifts_by_the_trim() -> None:
    np.testing.assert_allclose(wrench(0, 0, 0, trim=-0.5), [0, 0, -6.0, 0, 0, 0], atol=1e-5)


def test_trim_rises_while_commanded_and_holds_on_keep() -> None:
    trims = hold([[1, 0, 0], [1, 0, 0], [0, 0, 0], [-1, 0, 0]]).trims[0]
    np.testing.assert_allclose(trims, [0.0, 0.1, 0.2, 0.2, 0.1], atol=1e-12)  # 1 per second, for 0.1 s each


def test_trim_stays_within_full_and_empty() -> None:
    for side in (1.0, -1.0):
        trims = hold(np.tile([side, 0.0, 0.0], (30, 1))).trims[0]
        assert trims[-1] == side
        assert np.abs(trims).max() == 1.0
