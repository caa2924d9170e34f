"""What a vehicle reckons of its way is what the simulated sensor reads from the same echoes."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.deploy import Waypoint
from aquanav_tools.errors import InputError
from aquanav_tools.sim.batch.sensors import waypoint as simulated
from aquanav_tools.types import rotation_matrix, yaw_quaternion
from tests.sim.batch.sensors.rooms import room_batch
from tests.sim.batch.sensors.test_inertial import at


def test_it_reads_what_the_sensor_reads_on_a_way_that_winds(rng: np.random.Generator) -> None:
    num = 60
    headings = np.cumsum(rng.normal(0.0, 0.2, num))
    positions = [-3.0, -2.0, 1.0] + 0.1 * np.cumsum(
        np.stack([np.cos(headings), np.sin(headings), 0.1 * np.ones(num)], axis=1), axis=0
    )
    sensor, deployed, batch = simulated.Waypoint(), Waypoint(), room_batch(positions=positions[:1])
    pattern = sensor.pattern
    for decision, (place, heading) in enumerate(zip(positions, headings, strict=True)):
        turn = yaw_quaternion(heading)
        expected = sensor.measure(at(batch, decision, positions=[place], orientations=[turn])).copy()[0]
        if decision == 0:
            deployed.reset(place, np.zeros(3), heading)
        if decision % 5 == 0:
            ranges = sensor._out.numpy()[0]
            deployed.see(place, pattern.directions @ rotation_matrix(turn).T, ranges, pattern.lengths)
        if decision % 10 == 0:
            deployed.plan(place)
        np.testing.assert_allclose(deployed(place, heading), expected, atol=1e-6)


def test_what_is_no_reading_is_refused() -> None:
    vehicle = Waypoint()
    with pytest.raises(InputError, match="No dive has begun"):
        vehicle.plan([0.0, 0.0, 0.0])
    with pytest.raises(InputError, match="The goal must be finite"):
        vehicle.reset([0.0, 0.0, 0.0], [0.0, np.nan, 0.0], 0.0)
    vehicle.reset([0.0, 0.0, 0.0], [5.0, 0.0, 0.0], 0.0)
    with pytest.raises(InputError, match=r"The reaches must be finite numbers of shape \(2,\)"):
        vehicle.see([0.0, 0.0, 0.0], np.eye(3)[:2], [1.0, 2.0], [4.0])
    with pytest.raises(InputError, match="The place"):
        vehicle.plan([0.0, 0.0])
    with pytest.raises(InputError, match="finite angle"):
        vehicle([0.0, 0.0, 0.0], np.inf)
