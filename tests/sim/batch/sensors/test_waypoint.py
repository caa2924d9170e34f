"""The place ahead that a vehicle's own map shows, in a room whose goal is in its middle, or beyond a wall."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from aquanav_tools.sim.batch.sensors.base import SensorBatch
from aquanav_tools.sim.batch.sensors.waypoint import Waypoint
from aquanav_tools.sim.occupancy import CELL
from aquanav_tools.sim.scales import DISTANCE_SCALE, unsoft
from aquanav_tools.sim.way import LOOKED_ALONG
from aquanav_tools.types import Array, rotation_matrix, yaw_quaternion
from tests.sim.batch.sensors.rooms import DEVICE, SECONDS, random_poses, room_batch, room_cave
from tests.sim.batch.sensors.test_inertial import at

BEHIND_THE_WALL = np.array([12.0, 0.05, 0.05])


def batch_to(goal: Array, **arrays: object) -> SensorBatch:
    """Return vehicles in the room with another goal than its middle."""
    batch, cave = room_batch(**arrays), room_cave()
    cave.rules.goal = wp.vec3d(*goal)
    return SensorBatch(batch.state, [cave], SECONDS, DEVICE, 1)


def test_in_open_water_it_shows_the_goal_on_level_axes_by_the_heading(rng: np.random.Generator) -> None:
    positions, turns = random_poses(rng, 30)
    read = Waypoint().measure(room_batch(positions=positions, orientations=turns))
    for place, turn, values in zip(positions, turns, read, strict=True):
        rotation = rotation_matrix(turn)
        heading = np.arctan2(rotation[1, 0], rotation[0, 0])
        length = unsoft(float(values[0]), DISTANCE_SCALE)
        if rotation[:2, 0] @ place[:2] > 0.0:  # the goal lies where it came from, as the map has it
            assert length > np.abs(place).sum() - 3 * CELL
            continue
        turned, tilted = heading + np.pi * values[1], 0.5 * np.pi * values[2]
        shown = np.array([np.cos(turned) * np.cos(tilted), np.sin(turned) * np.cos(tilted), np.sin(tilted)])
        if np.abs(place).sum() < CELL * (LOOKED_ALONG - 2):  # the goal itself, or a cell beside it
            assert shown @ -place > np.linalg.norm(place) - 2 * CELL
        else:
            assert shown @ -place > 0.0
        assert length == pytest.approx(np.abs(place).sum(), abs=3 * CELL + 0.3 * np.abs(place).sum())


def test_walls_all_around_leave_the_way_through_what_is_known_least() -> None:
    """From the middle of the room all is seen within 4 and 3 m, and nothing of what lies 6 m ahead."""
    read = Waypoint().measure(batch_to(BEHIND_THE_WALL, positions=np.zeros((1, 3))))
    assert abs(read[0, 1:3]).max() < 0.15
    assert unsoft(float(read[0, 0]), DISTANCE_SCALE) == pytest.approx(12.0, abs=2.0)
    assert 0.0 < read[0, 3] < 0.5  # cells between the beams


def test_it_reads_the_same_twice_at_a_decision(rng: np.random.Generator) -> None:
    batch = room_batch(positions=rng.uniform(-2.0, 2.0, (20, 3)), seeds=np.arange(20))
    sensor = Waypoint()
    for decision in (0, 1, 5, 10):
        at(batch, decision, positions=rng.uniform(-2.0, 2.0, (20, 3)))
        first = sensor.measure(batch).copy()
        np.testing.assert_array_equal(sensor.measure(batch), first)


def swim(sensor: Waypoint, batch: SensorBatch, first: int, last: int) -> Array:
    """Return (T, N, 4) readings along a line, from one decision to before another."""
    read = []
    for decision in range(first, last):
        places = np.tile([-4.0 + 0.1 * decision, 1.0, 0.5], (batch.num, 1))
        read.append(sensor.measure(at(batch, decision, positions=places)).copy())
    return np.array(read)


def test_threads_do_not_change_what_it_reads() -> None:
    start = np.tile([-4.0, 1.0, 0.5], (40, 1))
    alone, shared = (room_batch(positions=start, seeds=np.arange(40), num_threads=count) for count in (1, 3))
    np.testing.assert_array_equal(swim(Waypoint(), alone, 0, 25), swim(Waypoint(), shared, 0, 25))


def test_what_it_remembers_goes_into_a_state_and_comes_back() -> None:
    start = np.tile([-4.0, 1.0, 0.5], (3, 1))
    whole, stopped, resumed = Waypoint(), Waypoint(), Waypoint()
    expected = swim(whole, batch_to(BEHIND_THE_WALL, positions=start, seeds=np.arange(3)), 0, 40)
    swim(stopped, batch_to(BEHIND_THE_WALL, positions=start, seeds=np.arange(3)), 0, 23)
    resumed.restore(stopped.state())
    later = swim(resumed, batch_to(BEHIND_THE_WALL, positions=start, seeds=np.arange(3)), 23, 40)
    np.testing.assert_array_equal(later, expected[23:])


def test_an_episode_begins_without_the_last_ones_walls() -> None:
    start = np.tile([-4.0, 1.0, 0.5], (2, 1))
    batch, sensor = batch_to(BEHIND_THE_WALL, positions=start), Waypoint()
    first = swim(sensor, batch, 0, 30)
    np.testing.assert_array_equal(swim(sensor, batch, 0, 30), first)


def test_only_vehicles_that_begin_anew_are_measured_where_these_alone_are_asked_for() -> None:
    batch, sensor = room_batch(positions=np.tile([-4.0, 1.0, 0.5], (2, 1))), Waypoint()
    before = swim(sensor, batch, 0, 12)[-1]
    at(batch, 12, positions=np.tile([3.0, -1.0, 0.5], (2, 1)), orientations=[yaw_quaternion(1.0)] * 2)
    batch.state.restarted.assign([0, 1])
    batch.state.decisions.assign([12, 0])
    batch.only_restarted = True
    read = sensor.measure(batch)
    np.testing.assert_array_equal(read[0], before[0])
    assert not np.array_equal(read[1], before[1])
