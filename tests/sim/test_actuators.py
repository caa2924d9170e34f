from __future__ import annotations

import pytest

from aquanav_tools.sim.actuators import HEAVE, SURGE, YAW, ActuatorModel, actuator_model
from aquanav_tools.sim.vehicle import load_vehicle

VEHICLE = load_vehicle("bluerov2")


@pytest.fixture
def actuators() -> ActuatorModel:
    return actuator_model(VEHICLE, dt=0.02, substeps=5)


def test_nothing_commanded_gives_no_wrench(actuators: ActuatorModel) -> None:
    assert not actuators.apply(0.0, 0.0, 0.0).any()


def test_reverse_is_half_as_strong(actuators: ActuatorModel) -> None:
    ahead = actuators.apply(0.0, 0.0, 1.0)[0, SURGE]
    astern = actuators.apply(0.0, 0.0, -1.0)[0, SURGE]
    assert ahead > 0
    assert astern == -0.5 * ahead


def test_steering_left_turns_about_body_z(actuators: ActuatorModel) -> None:
    assert actuators.apply(0.0, 1.0, 0.0)[0, YAW] > 0
    assert actuators.apply(0.0, -1.0, 0.0)[0, YAW] < 0


def test_trim_rises_while_commanded_and_holds_on_keep(actuators: ActuatorModel) -> None:
    rising = actuators.apply(1.0, 0.0, 0.0)[:, HEAVE].copy()
    assert (rising[1:] > rising[:-1]).all()
    assert actuators.trim == pytest.approx(0.1)  # 1 per second for 0.1 s
    held = actuators.apply(0.0, 0.0, 0.0)[:, HEAVE]
    assert (held == rising[-1]).all()


def test_trim_stays_within_full_and_empty(actuators: ActuatorModel) -> None:
    for _ in range(30):
        wrenches = actuators.apply(-1.0, 0.0, 0.0)
    assert actuators.trim == -1.0
    assert wrenches[-1, HEAVE] == -VEHICLE.actuators.heave_force


def test_reset_trims_to_neutral(actuators: ActuatorModel) -> None:
    actuators.apply(1.0, 0.0, 0.0)
    actuators.reset()
    assert actuators.trim == 0.0
