from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.hull import hull_clearance
from aquanav_tools.types import Array
from tests.caves import TUBE_RADIUS

HALF_AXIS, RADIUS = 0.3, 0.1


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
