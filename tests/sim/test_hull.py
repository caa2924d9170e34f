from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.prediction import advance
from aquanav_tools.sim.hull import glide, hull_clearance
from aquanav_tools.types import Array
from tests.caves import TUBE_RADIUS
from tests.sim.bodies import STILL, body, run

HALF_AXIS, RADIUS = 0.3, 0.1
BODY = body(np.full(6, 10.0), np.ones(6), np.ones(6))
PARAMETERS = BODY.packed()


def state_at(position: tuple[float, float, float], yaw: float = 0.0) -> Array:
    return np.array([*position, np.cos(yaw / 2), 0, 0, np.sin(yaw / 2), 0, 0, 0, 0, 0, 0])


def grid(tube: Scenario) -> tuple[Array, Array, Array, float]:
    return tube.field.grid


@pytest.mark.parametrize("yaw", [0.0, 0.5, np.pi / 2, -2.0])
def test_hull_clearance_is_that_of_the_capsules_farther_end(tube: Scenario, yaw: float) -> None:
    y = 0.6
    farther = y + HALF_AXIS * abs(np.sin(yaw))  # the end of the axis nearest to the tube's wall
    clearance = hull_clearance(state_at((10, y, 0), yaw), HALF_AXIS, RADIUS, *grid(tube))
    assert clearance == pytest.approx(TUBE_RADIUS - farther - RADIUS, abs=0.01)  # the field's interpolation


def test_gliding_far_from_the_wall_is_advancing(tube: Scenario, rng: np.random.Generator) -> None:
    wrenches = rng.normal(size=(20, 6))
    state = state_at((10, 0, 0))
    expected = advance(state[None], wrenches, STILL, BODY, 0.02, 20)[0, -1]
    last = glide(state, wrenches, 0, STILL, PARAMETERS, 0.02, HALF_AXIS, 0.5, *grid(tube), np.empty(13))
    assert last == 20
    np.testing.assert_allclose(state, expected, atol=1e-12)  # compiled twice, rounded twice


def test_gliding_stops_before_the_wall_is_in_reach(tube: Scenario) -> None:
    state = state_at((10, 0, 0), yaw=np.pi / 2)
    state[7] = 2.0
    reach = 0.5
    after = np.empty(13)
    wrenches = np.tile([50.0, 0, 0, 0, 0, 0], (1000, 1))
    last = glide(state, wrenches, 0, STILL, PARAMETERS, 0.02, HALF_AXIS, reach, *grid(tube), after)
    assert last < 1000
    nose = state[1] + HALF_AXIS
    assert 0.0 < TUBE_RADIUS - nose - reach < 0.1  # a step's move at 3 m/s, and the field's error
    np.testing.assert_allclose(after, run(state, 1, BODY, wrenches[0]), atol=1e-12)
