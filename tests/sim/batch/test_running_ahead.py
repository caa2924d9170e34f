"""Pursuit and full stop run ahead: against the same loops in NumPy around single predicted decisions."""

from __future__ import annotations

import numpy as np
import pytest
import warp as wp

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.prediction import Predictor
from aquanav_tools.sim.batch.pursuit import Pursuit
from aquanav_tools.sim.batch.stopping import Stopping
from aquanav_tools.sim.batch.water import Water, WaterNow
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array, Pose, rotation_matrix, yaw_quaternion
from tests.caves import TUBE_RADIUS

VEHICLE, STILL, MOST = load_vehicle("bluerov2"), 0.05, 30
HALF_AXIS, RADIUS = 0.5 * VEHICLE.capsule.axis_length, VEHICLE.capsule.radius
ARC = np.linspace(0.0, 18.0, 181)
MIDDLE = np.stack([1.0 + ARC, np.zeros(181), np.zeros(181)], axis=1)
"""A path along the tube's axis."""


def state_at(position: tuple[float, float, float], yaw: float = 0.0, speed: float = 0.0) -> Array:
    state = VEHICLE.state_at(Pose(np.array(position), yaw_quaternion(yaw)))
    state[7] = speed
    return state


def predictor_in(tube: Scenario) -> Predictor:
    return Predictor(VEHICLE, 1000.0, 0.02, 5, tube.field)


def room(state: Array, walls: Array) -> float:
    """Distance of three points of the hull's axis from the nearest wall, less the radius."""
    nose = rotation_matrix(state[3:7])[:, 0]
    points = state[:3] + HALF_AXIS * np.array([[-1.0], [0.0], [1.0]]) * nose
    return float(np.linalg.norm(walls[None] - points[:, None], axis=2).min()) - RADIUS


def stop_alone(predictor: Predictor, state: Array, command: Array, walls: Array) -> tuple[float, float, int]:
    """Least and last room, and decisions, of a command and a full stop."""
    trim, rooms = np.zeros(1), []
    for _ in range(1 + MOST):
        reached = predictor.predict(state[None], trim, command[None, None], np.zeros(3))
        state, trim = reached.states[0, 1], reached.trims[:, 1]
        rooms.append(room(state, walls))
        if np.linalg.norm(state[7:10]) < STILL:
            break
        climb = rotation_matrix(state[3:7])[2] @ state[7:10]
        missing = np.clip(-4.0 * climb, -1, 1) - trim[0]
        thrust = 0.0 if abs(state[7]) < STILL else -np.sign(state[7])
        command = np.array([0.0 if abs(missing) <= STILL else np.sign(missing), 0.0, thrust])
    return min(rooms), rooms[-1], len(rooms)


def test_a_stop_run_ahead_is_the_one_taken_decision_by_decision(tube: Scenario, rng: np.random.Generator) -> None:
    predictor = predictor_in(tube)
    stopping = Stopping(predictor, 200, MOST, STILL)
    state, lengths = state_at((5.0, 0.0, 0.0), speed=0.8), []
    state[9:13] = 0.3, 0.2, -0.1, 0.4
    commands = rng.uniform(-1, 1, (12, 3))
    for num in (1, 200, 40):  # fewer walls after more: those of before are forgotten
        walls = state[:3] + rng.uniform(0.6, 2.0, (num, 1)) * rng.normal(size=(num, 3))
        least, last = stopping.foresee(state, 0.0, commands, walls)
        for n, command in enumerate(commands):
            *expected, length = stop_alone(predictor, state, command, walls)
            np.testing.assert_allclose([least[n], last[n]], expected, atol=1e-9)  # rounding, in up to 155 steps
            lengths.append(length)
    assert min(lengths) < max(lengths)  # some stop earlier than others


def test_without_walls_there_is_room_without_end(tube: Scenario) -> None:
    stopping = Stopping(predictor_in(tube), 10, MOST, STILL)
    least, last = stopping.foresee(state_at((5.0, 0.0, 0.0)), 0.0, np.zeros((2, 3)), np.zeros((0, 3)))
    assert np.isinf(least).all()
    assert np.isinf(last).all()


@pytest.mark.parametrize(
    ("position", "yaw", "axis", "sign"),
    [
        ((5.0, 0.0, 0.0), 0.0, 1, 0.0),
        ((5.0, 0.0, 0.0), 0.5, 1, -1.0),  # the nose points left of the path: to the right
        ((5.0, -0.8, 0.0), 0.0, 1, 1.0),  # the path is on the left
        ((5.0, 0.0, -0.8), 0.0, 0, 1.0),  # and above
        ((5.0, 0.0, 0.8), 0.0, 0, -1.0),
        ((5.0, 0.0, 0.0), 0.0, 2, 1.0),
        ((5.0, 0.0, 0.0), np.pi, 2, 0.0),  # the path goes on behind it: turn first
    ],
)
def test_pursuit_steers_towards_the_path_ahead(
    position: tuple[float, float, float], yaw: float, axis: int, sign: float, tube: Scenario
) -> None:
    pursuit = Pursuit(predictor_in(tube), MIDDLE, ARC, 1)
    found = pursuit.foresee(state_at(position, yaw), 0.0, np.zeros(3))
    assert found.commands[0, axis] == sign
    assert found.reached[0] == pytest.approx(4.0)


def test_pursuit_aims_up_the_current(tube: Scenario) -> None:
    pursuit, at_rest = Pursuit(predictor_in(tube), MIDDLE, ARC, 1), state_at((5.0, 0.0, 0.0))
    drifts = [pursuit.foresee(at_rest, 0.0, np.array([0.0, drift, 0.0])).commands[0, 1] for drift in (-0.3, 0.3)]
    assert drifts == [1.0, -1.0]


def test_pursuit_reports_where_its_first_command_leads(tube: Scenario, rng: np.random.Generator) -> None:
    predictor, commands, current = predictor_in(tube), rng.uniform(-1, 1, (9, 3)), np.array([0.1, -0.2, 0.05])
    state = state_at((5.0, 1.2, 0.3), 0.4, 0.9)
    found = Pursuit(predictor, MIDDLE, ARC, 1).foresee(state, 0.2, current, commands)
    states = np.repeat(state[None], 9, axis=0)
    reached = predictor.predict(states, np.full(9, 0.2), commands[:, None], current)
    nearest = np.linalg.norm(reached.states[:, 1, None, :3] - MIDDLE, axis=2).argmin(axis=1)
    np.testing.assert_array_equal(found.made, ARC[nearest])
    np.testing.assert_array_equal(found.clearances, reached.clearances[:, 1])


def test_pursuit_follows_the_path_through_the_tube(tube: Scenario) -> None:
    # 150 decisions from beside the wall: at up to 0.8 m/s, in the middle at the end.
    pursuit = Pursuit(predictor_in(tube), MIDDLE, ARC, 150)
    found = pursuit.foresee(state_at((2.0, 1.0, -1.0), 1.0), 0.0, np.zeros(3))
    assert 8.0 < found.made[0] - found.reached[0] < 0.8 * 15.0 + 0.5
    assert 0.2 < found.clearances[0] < TUBE_RADIUS - np.hypot(1.0, 1.0) - RADIUS + 0.01


def test_pursuit_meets_the_water_on_its_way(tube: Scenario) -> None:
    predictor, state = predictor_in(tube), state_at((5.0, 1.0, 0.3), 0.4, 0.9)
    command, here, there = np.array([[1.0, -1.0, 1.0]]), np.zeros(3), np.array([-0.3, 0.4, 0.1])
    water = Water()
    water.uniform = wp.vec3d(*(2.0 * there))
    now = WaterNow(
        water, predictor.zeros((1, 1)), predictor.zeros((1,)), wp.full(1, wp.float64(0.5), wp.float64, "cpu")
    )
    found = Pursuit(predictor, MIDDLE, ARC, 2, now).foresee(state, 0.2, here, command)
    first = predictor.predict(state[None], np.array([0.2]), command[None], here)
    then = Pursuit(predictor, MIDDLE, ARC, 1).foresee(first.states[0, 1], first.trims[0, 1], there)
    assert found.clearances[0] == pytest.approx(min(first.clearances[0, 1], then.clearances[0]), abs=1e-12)
    held = Pursuit(predictor, MIDDLE, ARC, 2).foresee(state, 0.2, here, command)
    assert abs(held.clearances[0] - found.clearances[0]) > 1e-4


def test_pursuit_keeps_each_pace_beside_a_wall(tube: Scenario) -> None:
    side, paces = TUBE_RADIUS - RADIUS - 0.2, (0.3, 0.5, 0.7)
    pursuit, state = Pursuit(predictor_in(tube), MIDDLE + [0.0, side, 0.0], ARC, 40), state_at((3.0, side, 0.0))
    found = pursuit.foresee(state, 0.0, np.zeros(3), paces=paces)
    speeds = (found.made - found.reached) / 4.0  # m in 4 s; the first of them is lost in gathering way
    np.testing.assert_allclose(speeds, paces, rtol=0.25)


def test_clearance_in_a_prediction_is_that_of_the_tube(tube: Scenario) -> None:
    state = state_at((5.0, 0.6, 0.0), 0.5)
    found = predictor_in(tube).predict(state[None], np.zeros(1), np.zeros((1, 0, 3)), np.zeros(3))
    farther = 0.6 + HALF_AXIS * np.sin(0.5)
    assert found.clearances[0, 0] == pytest.approx(TUBE_RADIUS - farther - RADIUS, abs=0.01)  # the field's error
