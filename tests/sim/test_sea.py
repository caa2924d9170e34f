"""The sea against the theory of waves: spectrum, growth, dispersion, variance, directions, gusts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import trapezoid
from scipy.stats import kurtosis

from aquanav_tools.errors import InputError
from aquanav_tools.sim.sea_state import BREEZE, CALM, ROUGH, SeaState, draw_sea, jonswap, sea_state
from aquanav_tools.sim.sea_water import ACROSS, DRIFT, GUST_LENGTH, SeaWater
from aquanav_tools.sim.vehicle_base import GRAVITY
from aquanav_tools.sim.water import GUST_SIZE

DEPTH = 6.0
STATES = pytest.mark.parametrize("state", [CALM, BREEZE, ROUGH], ids=["calm", "breeze", "rough"])


@STATES
def test_significant_height_is_four_roots_of_the_spectrums_area(state: SeaState) -> None:
    rates = state.peak_rate * np.linspace(0.3, 30.0, 200_000)
    area = trapezoid(jonswap(rates, state.significant_height, state.peak_rate), rates)
    assert 4.0 * np.sqrt(area) == pytest.approx(state.significant_height, rel=1e-3)  # the tail above 20 peaks


@STATES
def test_spectrum_has_its_peak_where_it_should_and_falls_as_the_fifth_power(state: SeaState) -> None:
    rates = state.peak_rate * np.linspace(0.5, 2.0, 150_001)
    density = jonswap(rates, state.significant_height, state.peak_rate)
    assert rates[density.argmax()] == pytest.approx(state.peak_rate, rel=1e-3)
    high = jonswap(state.peak_rate * np.array([8.0, 16.0]), state.significant_height, state.peak_rate)
    assert high[0] / high[1] == pytest.approx(2.0**5, rel=2e-3)  # exp(-1.25 / 8^4) is 3e-4 off 1


def test_peak_is_higher_than_without_the_enhancement_by_gamma() -> None:
    """Below the peak's width the spectrum is Pierson and Moskowitz's; at the peak 3.3 times that."""
    peak, far = jonswap(np.array([1.0, 3.0]), 1.0, 1.0)
    plain = np.array([1.0, 3.0]) ** -5.0 * np.exp(-1.25 * np.array([1.0, 3.0]) ** -4.0)
    assert (peak / far) / (plain[0] / plain[1]) == pytest.approx(3.3)


def test_waves_grow_with_wind_and_fetch_as_measured_in_the_north_sea() -> None:
    state = SeaState(wind_speed=10.0, fetch=20_000.0)
    assert state.significant_height == pytest.approx(0.0016 * 10.0 * np.sqrt(20_000.0 / GRAVITY))
    scaled = state.peak_rate / (2.0 * np.pi) * 10.0 / GRAVITY  # dimensionless peak frequency
    assert scaled == pytest.approx(3.5 * (GRAVITY * 20_000.0 / 10.0**2) ** (-1.0 / 3.0))


@STATES
def test_sampled_waves_have_the_spectrums_variance_and_obey_dispersion(
    state: SeaState, rng: np.random.Generator
) -> None:
    waves, _ = draw_sea(state, DEPTH, rng)
    assert 4.0 * np.sqrt(np.sum(waves[:, 4] ** 2) / 2.0) == pytest.approx(state.significant_height)
    k, rate = waves[:, 2], waves[:, 3]
    np.testing.assert_allclose(GRAVITY * k * np.tanh(k * DEPTH), rate**2, rtol=1e-9)
    np.testing.assert_allclose(np.hypot(waves[:, 0], waves[:, 1]), k, rtol=1e-12)


def test_waves_stand_in_the_spectrum_as_its_area_says(rng: np.random.Generator) -> None:
    rates = draw_sea(replace(BREEZE, num_waves=1000), DEPTH, rng)[0][:, 3]
    grid = BREEZE.peak_rate * np.linspace(0.5, 5.0, 20_000)
    density = jonswap(grid, BREEZE.significant_height, BREEZE.peak_rate)
    below = np.cumsum(density) / density.sum()
    for share in (0.1, 0.5, 0.9):
        assert np.quantile(rates, share) == pytest.approx(np.interp(share, below, grid), rel=5e-3)


def test_surface_has_that_variance_over_places_and_episodes_and_is_nearly_gaussian(rng: np.random.Generator) -> None:
    sea, rises = SeaWater(BREEZE, DEPTH), []
    for _ in range(200):
        sea.reset(rng)
        rises.append(sea.rise(rng.uniform(-500.0, 500.0, (200, 2))))
    heights = np.concatenate(rises)
    # 200 seas of 48 waves are 9600 phases; their squares' mean has a standard error of about 1 %.
    assert 4.0 * heights.std() == pytest.approx(BREEZE.significant_height, rel=0.02)
    assert abs(heights.mean()) < 0.02 * BREEZE.significant_height
    assert kurtosis(heights) == pytest.approx(-1.5 / BREEZE.num_waves, abs=0.15)  # of equal sines; their sampling error


def test_surface_varies_in_time_as_over_places(rng: np.random.Generator) -> None:
    sea, place, heights = SeaWater(ROUGH, DEPTH), np.zeros((1, 2)), []
    sea.reset(rng)
    for _ in range(4000):
        sea.advance(0.5)
        heights.append(sea.rise(place)[0])
    assert 4.0 * np.std(heights) == pytest.approx(ROUGH.significant_height, rel=0.03)  # 760 peak periods


def test_water_at_the_surface_rises_with_it(rng: np.random.Generator) -> None:
    sea, place, dt = SeaWater(replace(ROUGH, gustiness=0.0), DEPTH), np.array([[3.0, -7.0]]), 1e-4
    sea.reset(rng)
    before = sea.rise(place)[0]
    surface = np.array([[3.0, -7.0, before]])
    speed = sea.velocities(surface)[0, 2]
    sea.advance(dt)
    assert (sea.rise(place)[0] - before) / dt == pytest.approx(speed, rel=1e-3, abs=1e-3)


def test_directions_spread_about_the_wind_as_the_cosine_power(rng: np.random.Generator) -> None:
    waves, _ = draw_sea(replace(BREEZE, num_waves=1000, direction_deg=40.0), DEPTH, rng)
    unit = (waves[:, 0] + 1j * waves[:, 1]) / waves[:, 2]
    mean = unit.mean()
    assert np.degrees(np.angle(mean)) == pytest.approx(40.0, abs=0.5)
    assert abs(mean) == pytest.approx(BREEZE.spread / (BREEZE.spread + 1.0), rel=2e-3)  # Mitsuyasu's closed form


def test_without_spread_all_waves_go_with_the_wind(rng: np.random.Generator) -> None:
    waves, _ = draw_sea(replace(CALM, spread=np.inf, direction_deg=90.0), DEPTH, rng)
    np.testing.assert_allclose(waves[:, 0], 0.0, atol=1e-12)
    np.testing.assert_allclose(waves[:, 1], waves[:, 2])


def test_gusts_have_their_strength_and_memory(rng: np.random.Generator) -> None:
    sea, dt = SeaWater(replace(BREEZE, current=(0.4, 0.0), num_waves=1), DEPTH), 1.0
    sea.reset(rng)
    wind, current = [], []
    for _ in range(20_000):
        sea.advance(dt)
        wind.append(sea.wind)
        current.append(sea.current)
    along, across = np.array(wind).T
    assert along.mean() == pytest.approx(8.0, rel=0.01)
    # 20,000 s are 800 memories of 25 s (there and back): a standard deviation is known to 2.5 %.
    assert along.std() == pytest.approx(0.12 * 8.0, rel=0.08)
    assert across.std() == pytest.approx(ACROSS * 0.12 * 8.0, rel=0.08)
    memory = np.corrcoef(along[:-1], along[1:])[0, 1]
    assert memory == pytest.approx(np.exp(-dt * 8.0 / GUST_LENGTH), abs=0.01)
    flow = np.array(current)
    assert flow[:, 0].mean() == pytest.approx(0.4 + DRIFT * 8.0, rel=0.02)
    assert flow[:, 0].std() == pytest.approx(GUST_SIZE * 0.4, rel=0.12)  # a memory of 20 s


def test_a_seed_repeats_the_sea_to_the_bit() -> None:
    places = np.random.default_rng(1).uniform(-50.0, 50.0, (20, 3))
    found = []
    for _ in range(2):
        sea = SeaWater(ROUGH, DEPTH)
        sea.reset(np.random.default_rng(5))
        for _ in range(10):
            sea.advance(0.02)
        found.append((sea.rise(places), sea.velocities(places), sea.wind, sea.current))
    for one, other in zip(*found, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_still_sea_is_flat_and_at_rest(rng: np.random.Generator) -> None:
    sea = SeaWater(sea_state("still"), DEPTH)
    sea.reset(rng)
    sea.advance(1.0)
    assert not sea.rise(np.ones((3, 2))).any()
    assert not sea.velocities(np.ones((3, 3))).any()
    assert not sea.wind.any()


def test_an_unknown_state_is_refused_with_the_closest_one() -> None:
    with pytest.raises(InputError, match="Did you mean 'breeze'"):
        sea_state("breze")
    with pytest.raises(InputError, match="wind_speed is 90"):
        SeaState(wind_speed=90.0)


@STATES
@pytest.mark.parametrize("height", [0.4, -0.05, -0.3, -3.0, -5.0])
def test_rise_and_orbits_are_the_sums_of_airys_waves(state: SeaState, height: float, rng: np.random.Generator) -> None:
    """Written out with NumPy's cosh and sinh, depths from the moving surface."""
    water = SeaWater(state, DEPTH)
    water.reset(rng)
    (kx, ky, k, rate, amplitude, _, depth), phases = water.waves[0].T, water.waves[1]
    for x, y in rng.uniform(-200.0, 200.0, (5, 2)):
        angle = kx * x + ky * y - phases
        rise = float(np.sum(amplitude * np.cos(angle)))
        above = depth - max(rise - height, 0.0)
        level = rate * amplitude * np.cosh(k * above) / np.sinh(k * depth) * np.cos(angle)
        upright = rate * amplitude * np.sinh(k * above) / np.sinh(k * depth) * np.sin(angle)
        expected = np.array([np.sum(level * kx / k), np.sum(level * ky / k), np.sum(upright)])
        place = np.array([[x, y, height]])
        assert water.rise(place)[0] == pytest.approx(rise, abs=1e-12)
        # waves above k h = 20 do not feel the bed, at which e^-20 of them is left: 2e-9 of some 0.1 m/s
        np.testing.assert_allclose(water.velocities(place)[0] - water.current, expected, rtol=1e-9, atol=1e-9)


def test_flows_drawn_ahead_are_those_that_come(rng: np.random.Generator) -> None:
    state, seed = replace(BREEZE, current=(0.4, -0.1)), int(rng.integers(1 << 32))
    one, other = (SeaWater(state, DEPTH, np.random.default_rng(seed)) for _ in range(2))
    ahead = [*zip(*one.draw_ahead(0.1, 7), strict=True), *zip(*one.draw_ahead(0.1, 5), strict=True)]
    assert len(ahead) == 12
    for current, wind in ahead:
        assert np.array_equal(other.current, current)
        assert np.array_equal(other.wind, wind)
        other.advance(0.1)
