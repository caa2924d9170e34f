"""Currents of an episode: their strength, their statistics, and what a scenario without a flow does."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

from aquanav_tools.cave.water.flow import find_flow
from aquanav_tools.errors import ScenarioError
from aquanav_tools.scenario.schema import PRESETS, Scenario, WaterSettings, WaveSettings
from aquanav_tools.sim.batch.water import flow_velocities
from aquanav_tools.sim.water import GUST_SIZE, GUST_TIME, water_of
from aquanav_tools.sim.water_properties import water_density, water_viscosity
from tests.caves import TUBE_LENGTH, TUBE_RADIUS, tube_scenario
from tests.sim.batch.waters import Episodes

MIDDLE = np.array([[0.5 * TUBE_LENGTH, 0.0, 0.0]])


@cache
def flowing() -> Scenario:
    """The tube with its flow, which enters at its far end."""
    scenario = tube_scenario()
    flow = find_flow(scenario.cavity, scenario.field, scenario.guide.centres, TUBE_RADIUS, spacing=0.4)
    return dataclasses.replace(scenario, flow=flow)


def with_water(scenario: Scenario, **water: object) -> Scenario:
    settings = dataclasses.replace(scenario.settings, water=WaterSettings(**water))  # type: ignore[arg-type]
    return dataclasses.replace(scenario, settings=settings)


def some_water(scenario: Scenario, rng: np.random.Generator, count: int) -> np.ndarray:
    indices, _ = scenario.field.water()
    return scenario.field.positions(indices[rng.choice(len(indices), count)])


def test_a_preset_is_the_mean_speed_through_the_narrowest_section() -> None:
    along = Episodes(flowing(), "half", range(2000)).velocities(MIDDLE)[:, 0, 0]
    # Gusts and eddies have zero mean; 2000 draws of 0.18 of the strength leave 0.4 %, the cells' walls 2 %.
    assert along.mean() == pytest.approx(-PRESETS["half"], rel=0.03)


def test_still_water_stands_still_and_a_negative_strength_turns_the_flow() -> None:
    still, ahead, back = (Episodes(flowing(), current, [3]) for current in ("still", 0.3, -0.3))
    for water in (still, ahead, back):
        water.advance()
    assert not still.velocities(MIDDLE).any()
    assert ahead.velocities(MIDDLE)[0, 0, 0] < -0.2
    assert back.velocities(MIDDLE)[0, 0, 0] > 0.2


def test_one_velocity_everywhere_is_taken_as_it_is(rng: np.random.Generator) -> None:
    water = Episodes(flowing(), (0.1, -0.2, 0.3))
    water.advance()
    found = water.velocities(MIDDLE + rng.normal(size=(5, 3)))[0]
    np.testing.assert_array_equal(found, np.tile([0.1, -0.2, 0.3], (5, 1)))


def test_without_gusts_and_eddies_the_water_is_the_scenarios_flow(rng: np.random.Generator) -> None:
    scenario = with_water(flowing(), turbulence=0.0)
    water, points = Episodes(scenario, "full"), some_water(scenario, rng, 200)
    assert scenario.flow is not None
    expected = (
        PRESETS["full"] * (1.0 + GUST_SIZE * water.coefficients.numpy()[0, 0]) * flow_velocities(scenario.flow, points)
    )
    np.testing.assert_allclose(water.velocities(points)[0], expected, atol=1e-7)  # the samples are float32


def test_equal_seeds_give_equal_currents_and_others_do_not() -> None:
    water, found = Episodes(flowing(), "full", [5, 5, 6]), []
    for _ in range(20):
        water.advance()
        found.append(water.velocities(MIDDLE)[:, 0])
    first, same, other = np.array(found).transpose(1, 0, 2)
    np.testing.assert_array_equal(first, same)
    assert np.abs(first - other).max() > 0.01


@pytest.mark.parametrize("dt", [0.1, 2.0])
def test_gusts_have_their_variance_and_correlation_time_at_any_step(dt: float) -> None:
    water = Episodes(with_water(flowing(), turbulence=0.0), "full", range(4000), dt)
    first = water.velocities(MIDDLE)[:, 0, 0]
    for _ in range(round(GUST_TIME / dt)):
        water.advance()
    later = water.velocities(MIDDLE)[:, 0, 0]
    mean = np.mean([first, later])
    a, b = first / mean - 1.0, later / mean - 1.0
    # 4000 independent draws: spreads are known to 1.1 %, correlations to 1.6 %.
    assert np.std(a) == pytest.approx(GUST_SIZE, rel=0.05)
    assert np.std(b) == pytest.approx(GUST_SIZE, rel=0.05)
    assert np.corrcoef(a, b)[0, 1] == pytest.approx(np.exp(-1.0), abs=0.07)


def test_eddies_have_their_share_of_the_strength(rng: np.random.Generator) -> None:
    scenario, seeds = with_water(flowing(), turbulence=0.2), range(300)
    points = some_water(scenario, rng, 400)
    calm, wild = (Episodes(one, "full", seeds) for one in (with_water(flowing(), turbulence=0.0), scenario))
    gusts = GUST_SIZE * wild.coefficients.numpy()[:, 0], GUST_SIZE * calm.coefficients.numpy()[:, 0]
    np.testing.assert_array_equal(*gusts)  # what is drawn for gusts does not depend on eddies
    squares = (wild.velocities(points) - calm.velocities(points)) ** 2
    assert np.sqrt(squares.mean() * 3.0) == pytest.approx(0.2 * PRESETS["full"], rel=0.05)


def test_a_scenario_that_lacks_its_flow_says_what_to_do() -> None:
    with pytest.raises(ScenarioError, match=r"has no flow: .*2 portals.*Build it again"):
        water_of(tube_scenario(), "half")
    assert water_of(tube_scenario(), "still").is_constant


def test_waves_move_water_at_the_surface_and_less_below() -> None:
    waves = WaveSettings(height=0.4, period=3.0, direction_deg=90.0)
    water = Episodes(with_water(flowing(), surface=5.0, waves=waves), duration=0.05)
    found = []
    for _ in range(60):
        water.advance()
        found.append(water.velocities(np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 2.0]]))[0])
    crest, deep = np.array(found).transpose(1, 0, 2)
    # Half the height times the angular rate, and exp(-k depth) of it below with k = w^2 / g.
    rate = 2.0 * np.pi / 3.0
    assert np.abs(crest[:, 1]).max() == pytest.approx(0.2 * rate, rel=0.01)
    assert np.abs(deep[:, 1]).max() == pytest.approx(0.2 * rate * np.exp(-(rate**2) / 9.81 * 3.0), rel=0.01)
    assert np.abs(crest[:, 0]).max() < 1e-12
    assert np.argmax(crest[:, 1]) != np.argmax(crest[:, 2])  # orbits: up and ahead a quarter period apart


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
