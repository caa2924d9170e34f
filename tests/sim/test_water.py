"""Currents of an episode: their strength, their statistics, and what a scenario without a flow does."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

from aquanav_tools.cave.water.flow import find_flow
from aquanav_tools.errors import ScenarioError
from aquanav_tools.scenario.schema import PRESETS, Scenario, WaterSettings, WaveSettings
from aquanav_tools.sim.water import CLOSED_SHARE, GUST_SIZE, GUST_TIME, Water
from aquanav_tools.sim.water_properties import water_density, water_viscosity
from tests.caves import TUBE_LENGTH, TUBE_RADIUS, tube_scenario

MIDDLE = np.array([0.5 * TUBE_LENGTH, 0.0, 0.0])


@cache
def flowing() -> Scenario:
    """The tube with its flow, which enters at its far end."""
    scenario = tube_scenario()
    flow = find_flow(scenario.cavity, scenario.field, scenario.guide.centres[-1], TUBE_RADIUS, spacing=0.4)
    return dataclasses.replace(scenario, flow=flow)


def with_water(scenario: Scenario, **water: object) -> Scenario:
    settings = dataclasses.replace(scenario.settings, water=WaterSettings(**water))  # type: ignore[arg-type]
    return dataclasses.replace(scenario, settings=settings)


def some_water(scenario: Scenario, rng: np.random.Generator, count: int) -> np.ndarray:
    indices, _ = scenario.field.water()
    return scenario.field.positions(indices[rng.choice(len(indices), count)])


def test_a_preset_is_the_mean_speed_through_the_narrowest_section(rng: np.random.Generator) -> None:
    water = Water(flowing(), "half")
    along = []
    for seed in range(200):
        water.reset(np.random.default_rng(seed))
        along.append(water.velocity(MIDDLE)[0])
    # Gusts and eddies have zero mean; 200 draws of 0.18 of the strength leave 1.3 %, the cells' walls 2 %.
    assert np.mean(along) == pytest.approx(-PRESETS["half"], rel=0.06)


def test_still_water_stands_still_and_a_negative_strength_turns_the_flow() -> None:
    still, ahead, back = (Water(flowing(), current) for current in ("still", 0.3, -0.3))
    for water in (still, ahead, back):
        water.reset(np.random.default_rng(3))
        water.advance(0.1)
    assert not still.velocity(MIDDLE).any()
    assert ahead.velocity(MIDDLE)[0] < -0.2
    assert back.velocity(MIDDLE)[0] > 0.2


def test_one_velocity_everywhere_is_taken_as_it_is(rng: np.random.Generator) -> None:
    water = Water(flowing(), (0.1, -0.2, 0.3))
    water.reset(rng)
    water.advance(1.0)
    np.testing.assert_array_equal(water.velocities(MIDDLE + rng.normal(size=(5, 3))), np.tile([0.1, -0.2, 0.3], (5, 1)))


def test_equal_seeds_give_equal_currents_and_others_do_not() -> None:
    def run(seed: int) -> np.ndarray:
        water = Water(flowing(), "full")
        water.reset(np.random.default_rng(seed))
        found = []
        for _ in range(20):
            water.advance(0.1)
            found.append(water.velocity(MIDDLE).copy())
        return np.array(found)

    np.testing.assert_array_equal(run(5), run(5))
    assert np.abs(run(5) - run(6)).max() > 0.01


def test_many_places_at_once_get_what_each_gets_alone(rng: np.random.Generator) -> None:
    water = Water(flowing(), "full")
    water.reset(rng)
    points = some_water(flowing(), rng, 50)
    np.testing.assert_allclose(water.velocities(points), [water.velocity(point).copy() for point in points], rtol=1e-12)


@pytest.mark.parametrize("dt", [0.1, 2.0])
def test_gusts_have_their_variance_and_correlation_time_at_any_step(dt: float) -> None:
    water = Water(with_water(flowing(), turbulence=0.0), "full")
    lag = round(GUST_TIME / dt)
    first, later = [], []
    for seed in range(60):
        water.reset(np.random.default_rng(seed))
        speeds = []
        for _ in range(3 * lag):
            speeds.append(water.velocity(MIDDLE)[0])
            water.advance(dt)
        first.append(speeds[:-lag])
        later.append(speeds[lag:])
    mean = np.mean(first)
    a, b = np.ravel(first) / mean - 1.0, np.ravel(later) / mean - 1.0
    # 60 episodes of three correlation times: about 120 independent draws, so the spread is known to 7 %.
    assert np.std(a) == pytest.approx(GUST_SIZE, rel=0.25)
    assert np.mean(a * b) / np.mean(a * a) == pytest.approx(np.exp(-1.0), abs=0.2)


def test_eddies_have_their_share_of_the_strength(rng: np.random.Generator) -> None:
    scenario = with_water(flowing(), turbulence=0.2)
    calm, wild = Water(with_water(flowing(), turbulence=0.0), "full"), Water(scenario, "full")
    points, squares = some_water(scenario, rng, 400), []
    for seed in range(60):
        calm.reset(np.random.default_rng(seed))
        wild.reset(np.random.default_rng(seed))
        squares.append((wild.velocities(points) - calm.velocities(points)) ** 2)
    assert np.sqrt(np.mean(squares) * 3.0) == pytest.approx(0.2 * PRESETS["full"], rel=0.1)


def test_a_closed_cave_has_eddies_alone(rng: np.random.Generator) -> None:
    scenario = flowing()
    cavity = dataclasses.replace(scenario.cavity, portals=scenario.cavity.portals[:1])
    closed = dataclasses.replace(scenario, flow=None, cavity=cavity)
    water, points, found = Water(closed, 0.5), some_water(scenario, rng, 400), []
    for seed in range(60):
        water.reset(np.random.default_rng(seed))
        found.append(water.velocities(points))
    assert np.abs(np.mean(found, axis=(0, 1))).max() < 0.05
    assert np.sqrt((np.array(found) ** 2).sum(axis=2).mean()) == pytest.approx(0.5 * CLOSED_SHARE, rel=0.1)


def test_a_scenario_that_lacks_its_flow_says_what_to_do() -> None:
    with pytest.raises(ScenarioError, match=r"no flow between its 2 portals.*Build it again"):
        Water(tube_scenario(), "half")
    Water(tube_scenario(), "still")


def test_waves_move_water_at_the_surface_and_less_below() -> None:
    waves = WaveSettings(height=0.4, period=3.0, direction_deg=90.0)
    water = Water(with_water(flowing(), surface=5.0, waves=waves))
    water.reset(np.random.default_rng(0))
    crest, deep, sideways = [], [], []
    for _ in range(60):
        water.advance(0.05)
        crest.append(water.velocity(np.array([0.0, 0.0, 5.0])).copy())
        deep.append(water.velocity(np.array([0.0, 0.0, 2.0])).copy())
        sideways.append(crest[-1][0])
    # Half the height times the angular rate, and exp(-k depth) of it below with k = w^2 / g.
    rate = 2.0 * np.pi / 3.0
    assert np.abs(np.array(crest)[:, 1]).max() == pytest.approx(0.2 * rate, rel=0.01)
    assert np.abs(np.array(deep)[:, 1]).max() == pytest.approx(0.2 * rate * np.exp(-(rate**2) / 9.81 * 3.0), rel=0.01)
    assert np.abs(sideways).max() < 1e-12


@pytest.mark.parametrize(
    ("temperature", "salinity", "density", "viscosity"),
    [
        # Fresh: IAPWS-95 and IAPWS 2008, as tabled by NIST. Sea: TEOS-10 density; viscosity by Isdale et al. (1972).
        (10.0, 0.0, 999.70, 1.3059e-3),
        (20.0, 0.0, 998.21, 1.0016e-3),
        (40.0, 0.0, 992.22, 0.6530e-3),
        (20.0, 35.0, 1024.76, 1.077e-3),
    ],
)
def test_density_and_viscosity_are_those_of_tables(
    temperature: float, salinity: float, density: float, viscosity: float
) -> None:
    # The correlations' own accuracy: 0.1 % and 1.5 %.
    assert water_density(temperature, salinity) == pytest.approx(density, rel=1e-3)
    assert water_viscosity(temperature, salinity) == pytest.approx(viscosity, rel=1.5e-2)
