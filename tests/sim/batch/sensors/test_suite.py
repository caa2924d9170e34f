from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

from aquanav_tools.errors import InputError
from aquanav_tools.sim.batch.sensors import BUILT_IN
from aquanav_tools.sim.batch.sensors.base import SensorBatch
from aquanav_tools.sim.batch.sensors.depth import DepthCell
from aquanav_tools.sim.batch.sensors.suite import SensorSuite, make_sensor
from aquanav_tools.sim.vehicle import load_vehicle
from tests.caves import tube_scenario
from tests.sim.batch.sensors.rooms import room_batch

TUBE, VEHICLE = tube_scenario(), load_vehicle("bluerov2")


class Thermometer:
    """A sensor as a user would write it."""

    def __init__(self, result: Any = None) -> None:
        self.result = result

    def spec(self, scenario: Any, vehicle: Any) -> spaces.Box:
        return spaces.Box(-np.inf, np.inf, (1,), np.float32)

    def measure(self, batch: SensorBatch) -> Any:
        if self.result is not None:
            return self.result
        return 10.0 - 0.1 * batch.view_of("positions")[:, 2:] + 0.01 * batch.normals(1)


def test_every_built_in_sensor_measures_what_its_space_says(rng: np.random.Generator) -> None:
    suite = SensorSuite({name: name for name in BUILT_IN})
    space = suite.spec(TUBE, VEHICLE)
    readings = suite.measure(room_batch(positions=rng.uniform(-1, 1, (5, 3)), velocities=rng.normal(size=(5, 6))))
    assert list(readings) == list(BUILT_IN)
    for n in range(5):
        assert space.contains({name: values[n] for name, values in readings.items()})


def test_readings_are_copies_that_later_measurements_leave_alone() -> None:
    suite, batch = SensorSuite({"depth": "depth"}), room_batch(positions=np.zeros((2, 3)))
    suite.spec(TUBE, VEHICLE)
    first = suite.measure(batch)["depth"]
    kept = first.copy()
    batch.state.positions.assign(np.ones((2, 3)))
    suite.measure(batch)
    assert np.array_equal(first, kept)


def test_a_sensor_reads_the_same_beside_whatever_others_and_two_of_a_kind_err_apart() -> None:
    batch = room_batch(positions=np.zeros((4, 3)), seeds=np.arange(4))
    alone = SensorSuite({"cell": "depth"})
    both = SensorSuite({"other": DepthCell(), "cell": DepthCell()})
    for suite in (alone, both):
        suite.spec(TUBE, VEHICLE)
    readings = both.measure(batch)
    assert np.array_equal(alone.measure(batch)["cell"], readings["cell"])
    assert not np.array_equal(readings["other"], readings["cell"])


def test_a_users_sensor_draws_from_seed_name_and_decision_alone() -> None:
    def read(seeds: list[int], decision: int = 0, name: str = "thermometer") -> Any:
        suite = SensorSuite({name: Thermometer()})
        suite.spec(TUBE, VEHICLE)
        batch = room_batch(positions=np.zeros((len(seeds), 3)), seeds=np.array(seeds))
        batch.state.decisions.fill_(decision)
        return suite.measure(batch)[name][:, 0]

    together = read([5, 6, 7])
    assert read([6])[0] == together[1]
    assert len({*together, read([6], 1)[0], read([6], 0, "second")[0]}) == 5


@pytest.mark.parametrize(
    ("result", "words"),
    [
        (np.zeros((2, 3)), r"'mine' measured an array of shape \(2, 3\); 2 vehicles with its space take \(2, 1\)"),
        (np.array([[0.0], [np.nan]]), "not finite for 1 of 2 vehicles, the first of them number 1"),
    ],
)
def test_what_a_users_sensor_gets_wrong_is_said_with_its_name(result: Any, words: str) -> None:
    suite = SensorSuite({"mine": Thermometer(result)})
    suite.spec(TUBE, VEHICLE)
    with pytest.raises(InputError, match=words):
        suite.measure(room_batch(positions=np.zeros((2, 3))))


def test_an_unknown_sensor_is_refused_with_the_nearest() -> None:
    with pytest.raises(InputError, match=r"no sensor 'sonnar'. Did you mean 'sonar'"):
        make_sensor("sonnar")
    with pytest.raises(InputError, match="'depth' cannot be made of"):
        make_sensor("depth", shet="a")
    with pytest.raises(InputError, match="at least one"):
        SensorSuite({})
