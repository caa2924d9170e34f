from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.sim.batch.sensors.base import SensorBatch
from aquanav_tools.sim.batch.sensors.data_sheets import sheet_names
from aquanav_tools.sim.batch.sensors.inertial import InertialUnit
from aquanav_tools.types import rotation_matrix, yaw_quaternion
from tests.sim.batch.sensors.rooms import SECONDS, random_poses, room_batch

PERFECT = {"accelerometer": {"full_scale_g": 100.0}, "gyroscope": {"full_scale_deg_per_s": 2000.0}}
UP = np.array([0.0, 0.0, 9.81])


def unit(accelerometer: dict[str, float] | None = None, gyroscope: dict[str, float] | None = None) -> InertialUnit:
    """Return a unit that errs by nothing but what is given."""
    parts = {"accelerometer": accelerometer or {}, "gyroscope": gyroscope or {}}
    return InertialUnit({name: {**PERFECT[name], **parts[name]} for name in PERFECT})


def at(batch: SensorBatch, decision: int, **arrays: Any) -> SensorBatch:
    """Bring a batch to a decision with other arrays."""
    batch.state.decisions.fill_(decision)
    for name, values in arrays.items():
        getattr(batch.state, name).assign(values)
    return batch


def test_at_rest_it_feels_what_carries_it(rng: np.random.Generator) -> None:
    positions, turns = random_poses(rng, 20)
    read = unit().measure(room_batch(positions=positions, orientations=turns))
    expected = [rotation_matrix(turn).T @ UP for turn in turns]
    assert np.allclose(read[:, :3], expected, atol=1e-5)
    assert np.array_equal(read[:, 3:], np.zeros((20, 3)))


def test_a_turn_at_constant_speed_is_felt_as_the_change_of_velocity_over_the_decision() -> None:
    """Over a chord of the circle: u r sinc(r t / 2) towards its middle, seen from the decision's end."""
    speed, rate = 2.0, 1.5
    velocity = [[speed, 0.0, 0.0, 0.0, 0.0, rate]]
    imu, batch = unit(), room_batch(positions=np.zeros((1, 3)), velocities=velocity)
    imu.measure(batch)
    turned = 0.5 * rate * SECONDS
    read = imu.measure(at(batch, 1, orientations=[yaw_quaternion(2.0 * turned)]))[0]
    size = speed * rate * np.sin(turned) / turned
    assert np.allclose(read, [size * np.sin(turned), size * np.cos(turned), 9.81, 0.0, 0.0, rate], atol=1e-5)


def test_steady_acceleration_along_the_body_is_felt_as_it_is() -> None:
    imu, batch = unit(), room_batch(positions=np.zeros((1, 3)))
    imu.measure(batch)
    for decision in (1, 2, 3):
        speed = 0.7 * decision * SECONDS
        read = imu.measure(at(batch, decision, velocities=[[speed, 0.0, 0.0, 0.0, 0.0, 0.0]]))[0]
        assert np.allclose(read[:3], [0.7, 0.0, 9.81], atol=1e-5)


def test_measuring_twice_at_a_decision_gives_the_same_twice() -> None:
    imu, batch = InertialUnit("mti-1"), room_batch(positions=np.zeros((3, 3)), seeds=np.arange(3))
    imu.measure(batch)
    at(batch, 1, velocities=np.ones((3, 6)))
    first = imu.measure(batch).copy()
    assert np.array_equal(imu.measure(batch), first)


def test_an_episodes_beginning_forgets_the_one_before() -> None:
    imu, batch = InertialUnit("icm-20602"), room_batch(positions=np.zeros((3, 3)), seeds=np.arange(3))
    first = imu.measure(batch).copy()
    for decision in (1, 2):
        imu.measure(at(batch, decision, velocities=decision * np.ones((3, 6))))
    again = imu.measure(at(batch, 0, velocities=np.zeros((3, 6))))
    assert np.array_equal(again, first)


def test_white_noise_has_the_density_of_the_sheet() -> None:
    """A mean over t seconds of noise with density d has the standard deviation d / sqrt(t)."""
    num = 20_000
    imu = unit({"noise_density_ug": 1000.0}, {"noise_density_mdps": 50.0})
    error = imu.measure(room_batch(positions=np.zeros((num, 3)), seeds=np.arange(num))) - [*UP, 0.0, 0.0, 0.0]
    expected = np.repeat([9.80665e-3, np.radians(0.05)], 3) / np.sqrt(SECONDS)
    assert np.allclose(error.std(axis=0), expected, rtol=5 / np.sqrt(2 * num))
    assert np.abs(np.corrcoef(error.T) - np.eye(6)).max() < 5 / np.sqrt(num)


def test_a_bias_stays_for_an_episode_and_differs_between_devices() -> None:
    num = 20_000
    imu = unit({"bias_mg": 40.0}, {"bias_deg_per_s": 1.0})
    batch = room_batch(positions=np.zeros((num, 3)), seeds=np.arange(num))
    first = imu.measure(batch).copy()
    assert np.array_equal(imu.measure(at(batch, 1)), first)
    expected = np.repeat([0.04 * 9.80665, np.radians(1.0)], 3)
    assert np.allclose(first.std(axis=0), expected, rtol=5 / np.sqrt(2 * num))


def test_a_bias_walks_as_far_as_the_sheet_says_in_the_time_it_says() -> None:
    """100 steps of 0.1 s; after a quarter of the time, half as far."""
    num = 4000
    times = {"in_run_time": 10.0}
    imu = unit({"in_run_bias_mg": 2.0, **times}, {"in_run_bias_deg_per_h": 100.0, **times})
    batch = room_batch(positions=np.zeros((num, 3)), seeds=np.arange(num))
    expected = np.repeat([2e-3 * 9.80665, np.radians(100.0 / 3600.0)], 3)
    for decision in range(101):
        read = imu.measure(at(batch, decision))
        if decision in (25, 100):
            spread = (read - [*UP, 0.0, 0.0, 0.0]).std(axis=0)
            assert np.allclose(spread, expected * np.sqrt(decision / 100), rtol=5 / np.sqrt(2 * num))


def test_readings_end_at_full_scale() -> None:
    imu = unit({"full_scale_g": 0.5}, {"full_scale_deg_per_s": 10.0})
    read = imu.measure(room_batch(positions=np.zeros((1, 3)), velocities=[[0, 0, 0, 9.0, -9.0, 0]]))[0]
    assert np.allclose(read, [0, 0, 0.5 * 9.80665, np.radians(10), -np.radians(10), 0], atol=1e-6)
    assert imu.spec(None, None).contains(read)  # type: ignore[arg-type]  # it needs neither


def test_every_sheet_that_ships_can_be_read_and_names_its_source() -> None:
    assert sheet_names("imu") == ["icm-20602", "mti-1"]
    for name in sheet_names("imu"):
        assert InertialUnit(name).data.source


def test_an_unknown_sheet_is_refused_with_the_nearest() -> None:
    with pytest.raises(InputError, match=r"no data sheet 'mti1' for the sensor 'imu'. Did you mean 'mti-1'"):
        InertialUnit("mti1")


def test_an_impossible_figure_is_refused() -> None:
    with pytest.raises(InputError, match=r"accelerometer has scale_error = 2"):
        unit({"scale_error": 2.0})
