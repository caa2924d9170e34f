"""The water around the vehicles of a batch: its processes in time, each vehicle's own, and where it is."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from aquanav_tools.scenario.schema import Current, Scenario, WaterSettings, WaveSettings
from aquanav_tools.sim.batch.water import turnover_times
from aquanav_tools.sim.batch.world import BatchWorld
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.sim.water import GUST_TIME
from tests.caves import tube_scenario
from tests.sim.batch.waters import Episodes
from tests.sim.batch.worlds import make_world, place
from tests.sim.test_water import flowing

SWELL = {"surface": 5.0, "waves": WaveSettings(height=0.4, period=3.0, direction_deg=30.0, depth=9.0)}
DEEP_SWELL = {"surface": 5.0, "waves": WaveSettings(height=0.4, period=3.0, direction_deg=30.0)}
DECISION = 0.1
"""s"""


def many(num: int, current: Current = "full", scenario: Scenario | None = None, **options: Any) -> BatchWorld:
    return make_world(scenario or flowing(), load_vehicle("bluerov2"), num, current=current, **options)


def wait(world: BatchWorld, decisions: int) -> None:
    for _ in range(decisions):
        world.as_numpy("commands")[:] = 0.0
        world.step()


@pytest.mark.parametrize("water", [{}, SWELL, DEEP_SWELL])
def test_a_vehicle_is_in_the_water_of_where_it_is(water: dict[str, Any], rng: np.random.Generator) -> None:
    settings = dataclasses.replace(flowing().settings, water=WaterSettings(**water))
    scenario, num = dataclasses.replace(flowing(), settings=settings), 40
    world, seeds = many(num, "full", scenario), np.arange(num)
    indices, _ = scenario.field.water()
    place(world, scenario.field.positions(indices[rng.choice(len(indices), num)]) + rng.uniform(0, 0.05, (num, 3)))
    episodes = Episodes(scenario, "full", seeds, DECISION)
    for _ in range(3):
        wait(world, 1)
        episodes.advance()
    found = episodes.velocities(world.as_numpy("positions"))
    np.testing.assert_allclose(world.as_numpy("currents"), found[seeds, seeds], atol=1e-12)


def test_gusts_and_eddies_are_normal_and_forget_as_they_should() -> None:
    """Sample moments of 8192 vehicles: standard errors are 0.011 of means, 0.016 of variances; bounds are 5 of them."""
    num, decisions = 8192, 20
    world = many(num)
    before = world.as_numpy("eddies").copy()
    wait(world, decisions)
    after = world.as_numpy("eddies")
    waves = Episodes(flowing(), "full").water.waves.numpy()
    turnover = turnover_times(waves, 0.5 * flowing().settings.water.turbulence)  # "full" is 0.5 m/s
    times = np.concatenate([[GUST_TIME], turnover, turnover])
    assert after.shape[1] == len(times)
    for values in (before, after):
        assert np.abs(values.mean(axis=0)).max() < 0.055
        assert np.abs(values.var(axis=0) - 1.0).max() < 0.08
        assert np.abs((values**4).mean() - 3.0) < 5.0 * np.sqrt(96.0 / values.size)  # the fourth power's variance is 96
        relation = np.corrcoef(values.T) - np.eye(values.shape[1])
        assert np.abs(relation).max() < 0.06
        neighbours = (values[1:] * values[:-1]).mean(axis=0)
        assert np.abs(neighbours).max() < 0.06
    kept = np.exp(-decisions * DECISION / times)
    assert np.abs((before * after).mean(axis=0) - kept).max() < 0.08


def test_a_vehicles_water_depends_on_no_other_vehicle() -> None:
    small, large = many(3), many(300)
    for world in (small, large):
        world.reset(np.arange(5, 5 + world.num), np.zeros(world.num, dtype=np.int32))
        wait(world, 7)
    assert np.array_equal(small.as_numpy("eddies"), large.as_numpy("eddies")[:3])
    assert not np.array_equal(small.as_numpy("eddies")[0], small.as_numpy("eddies")[1])


def test_each_episode_draws_its_fraction_of_the_current() -> None:
    num = 2000
    world = many(num, current=(0.3, 0.0, 0.0), scenario=tube_scenario())
    world.reset(np.arange(num), conditions={"current_range": (0.5, 1.5)})
    fractions = world.as_numpy("current_fractions").copy()
    assert np.allclose(world.as_numpy("currents"), fractions[:, None] * [0.3, 0.0, 0.0])
    assert 0.5 <= fractions.min() < 0.505 and 1.495 < fractions.max() <= 1.5
    assert fractions.mean() == pytest.approx(1.0, abs=5 * 0.29 / np.sqrt(num))  # a uniform spread of 1 deviates by 0.29
    world.reset(np.arange(num) + num)
    assert (world.as_numpy("current_fractions") != fractions).all()


def test_a_batch_goes_back_to_where_it_was(rng: np.random.Generator) -> None:
    one, other = many(64), many(64)
    commands = rng.uniform(-1, 1, (20, 64, 3)).astype(np.float32)
    for moment, command in enumerate(commands):
        if moment == 10:
            other.restore(one.state())
        for world in (one, other) if moment >= 10 else (one,):
            world.as_numpy("commands")[:] = command
            world.step()
    for name, values in one.state().items():
        assert np.array_equal(values, other.state()[name]), name
