"""The wind's force against the formula written out for angles, against symmetry, and where there must be none."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from aquanav_tools.sim.batch.boat_motion import OpenWater
from aquanav_tools.sim.boat import DENSITY, load_boat
from aquanav_tools.sim.windage import AIR_DENSITY, Windage
from aquanav_tools.types import Array, yaw_quaternion

WINDAGE = Windage(front=1.2, side=4.0, length=3.0, height=10.0, arm=0.5, front_drag=0.6, side_drag=0.8, turning=0.15)


def wrench(
    wind: Array, yaw: float = 0.0, velocity: tuple[float, float] = (0.0, 0.0), windage: Windage | None = WINDAGE
) -> Array:
    state = np.zeros(13)
    state[3:7], state[7:9] = yaw_quaternion(yaw), velocity
    water = OpenWater(replace(load_boat("otter"), windage=windage), DENSITY, 0.02)
    water.wind = wind
    found: Array = water.loads(state)[1]
    return found


@pytest.mark.parametrize("angle", np.radians([0.0, 20.0, 45.0, 90.0, 160.0, 180.0, -70.0]))
def test_a_boat_at_rest_is_pushed_as_the_handbook_says(angle: float) -> None:
    speed = 9.0
    found = wrench(-speed * np.array([math.cos(angle), math.sin(angle)]))  # from `angle` left of the bow
    pressure = 0.5 * AIR_DENSITY * speed**2
    sway = -pressure * 0.8 * 4.0 * math.sin(angle)
    surge = -pressure * 0.6 * 1.2 * math.cos(angle)
    assert found[0] == pytest.approx(surge)
    assert found[1] == pytest.approx(sway)
    assert found[5] == pytest.approx(-pressure * 0.15 * 4.0 * 3.0 * math.sin(2.0 * angle))
    np.testing.assert_allclose(found[2:5], np.cross([0.0, 0.0, 0.5], [surge, sway, 0.0])[[2, 0, 1]], atol=1e-9)


def test_a_boat_that_moves_with_the_air_feels_none() -> None:
    assert np.abs(wrench(np.array([3.0, -2.0]), velocity=(3.0, -2.0))).max() < 1e-12
    assert wrench(np.array([3.0, -2.0]), velocity=(4.0, -2.0))[0] < 0.0  # faster: it is held back


def test_the_world_turned_with_boat_and_wind_changes_nothing(rng: np.random.Generator) -> None:
    for yaw in rng.uniform(-np.pi, np.pi, 5):
        turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
        wind = rng.normal(0.0, 8.0, 2)
        np.testing.assert_allclose(wrench(turn @ wind, yaw, (1.0, 0.2)), wrench(wind, 0.0, (1.0, 0.2)), atol=1e-9)


def test_the_wind_is_weaker_near_the_water() -> None:
    low = Windage(front=1.2, side=4.0, length=3.0, height=0.5, arm=0.5, front_drag=0.6, side_drag=0.8, turning=0.15)
    wind = np.array([0.0, 10.0])
    assert wrench(wind, windage=low)[1] / wrench(wind)[1] == pytest.approx((0.5 / 10.0) ** (2.0 / 7.0))


def test_without_windage_there_is_no_force() -> None:
    assert not wrench(np.array([20.0, 5.0]), windage=None).any()


def test_windage_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(ValueError, match="areas and drags must not be negative, got -1"):
        Windage(front=-1.0, side=1.0, length=2.0, height=1.0, arm=0.0)
    with pytest.raises(ValueError, match="height and length must be positive"):
        Windage(front=1.0, side=1.0, length=2.0, height=0.0, arm=0.0)
