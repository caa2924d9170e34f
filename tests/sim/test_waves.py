"""Waves against the theory's own laws: dispersion, no divergence, no rotation, no flow through the bottom."""

from __future__ import annotations

import dataclasses
from functools import cache

import numpy as np
import pytest

from aquanav_tools.scenario.schema import WaterSettings, WaveSettings
from aquanav_tools.sim.vehicle_base import GRAVITY
from aquanav_tools.sim.waves import wave_number
from tests.caves import tube_scenario
from tests.sim.batch.waters import Episodes

SURFACE, DEPTH = 1.5, 4.0
WAVES = WaveSettings(height=0.3, period=3.0, direction_deg=30.0, depth=DEPTH)


@cache
def water() -> Episodes:
    scenario = tube_scenario()
    settings = dataclasses.replace(scenario.settings, water=WaterSettings(surface=SURFACE, waves=WAVES))
    return Episodes(dataclasses.replace(scenario, settings=settings), "still")


def velocity(point: np.ndarray, phase: float = 0.7) -> np.ndarray:
    found: np.ndarray = water().swell(phase, point[None])[0]
    return found


def test_wave_number_solves_the_dispersion_relation(rng: np.random.Generator) -> None:
    for period, depth in zip(rng.uniform(0.5, 30.0, 200), 10.0 ** rng.uniform(-1.0, 3.0, 200), strict=True):
        k = wave_number(period, depth)
        assert GRAVITY * k * np.tanh(k * depth) == pytest.approx((2.0 * np.pi / period) ** 2, rel=1e-10)


def test_long_waves_run_at_the_root_of_gravity_times_depth_and_deep_ones_by_their_period() -> None:
    assert 2.0 * np.pi / 60.0 / wave_number(60.0, 1.0) == pytest.approx(np.sqrt(GRAVITY * 1.0), rel=1e-2)
    assert wave_number(2.0, 1e9) == pytest.approx(np.pi**2 / GRAVITY, rel=1e-12)


def test_water_under_waves_neither_gathers_nor_spins(rng: np.random.Generator) -> None:
    step = 1e-5
    for _ in range(20):
        point = np.array([*rng.uniform(-5.0, 5.0, 2), rng.uniform(SURFACE - DEPTH + 0.1, SURFACE - 0.1)])
        slopes = np.array([(velocity(point + step * e) - velocity(point - step * e)) / (2 * step) for e in np.eye(3)])
        assert abs(np.trace(slopes)) < 1e-8
        np.testing.assert_allclose(slopes, slopes.T, atol=1e-8)


def test_no_water_passes_the_bottom_and_the_surface_moves_with_it() -> None:
    assert abs(velocity(np.array([0.3, 0.2, SURFACE - DEPTH]))[2]) < 1e-12
    phases = np.linspace(0.0, 2.0 * np.pi, 721)
    rise = [velocity(np.array([0.0, 0.0, SURFACE]), phase)[2] for phase in phases]
    assert max(rise) == pytest.approx(0.15 * 2.0 * np.pi / 3.0, rel=1e-4)  # amplitude times angular rate
