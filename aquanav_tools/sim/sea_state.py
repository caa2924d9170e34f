"""How rough a bay is: wind, the waves that it raises (JONSWAP), and the current at the surface.

Sources: Hasselmann et al., Measurements of wind-wave growth and swell decay during the Joint North Sea Wave Project
(1973), spectrum and growth with fetch; Mitsuyasu et al., Journal of Physical Oceanography 5 (1975), directions.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.sim.vehicle_base import GRAVITY
from aquanav_tools.sim.waves import wave_number
from aquanav_tools.types import Array

PEAKEDNESS = 3.3
"""Gamma, the mean of the JONSWAP measurements."""
WIDTH_BELOW, WIDTH_ABOVE = 0.07, 0.09
"""Sigma of the peak on either side, over the peak's frequency."""
GROWTH = 1.6e-7
"""Variance of the surface per fetch, both made dimensionless by wind and gravity."""
PEAK = 3.5
"""Peak frequency times (wind times fetch / g^2)^(1/3)."""
LOWEST, HIGHEST = 0.5, 5.0
"""Range of frequencies that is sampled, over the peak's; beyond it lie 0.2 % of the variance."""
DENSITY_STEPS = 4000
"""Frequencies at which the spectrum is summed up."""


def _check(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise InputError(f"The sea state's {name} is {value:g}; it must be from {low:g} to {high:g}.")


@dataclass(frozen=True)
class SeaState:
    """Wind, waves and current. Waves follow from the wind and from the fetch over which it blows."""

    wind_speed: float = 0.0
    """Mean, 10 m above the water, m/s."""
    fetch: float = 5000.0
    """Open water to windward, m; chosen, as of a wide bay."""
    direction_deg: float = 0.0
    """Where wind and waves go to, degrees from world x towards y."""
    spread: float = 10.0
    """Directions are distributed as cos(angle / 2)^(2 spread); 10 is Mitsuyasu's near the peak. Infinite: one only."""
    num_waves: int = 48
    """Waves whose sum is the sea; chosen, see the test of its kurtosis."""
    current: tuple[float, float] = (0.0, 0.0)
    """Mean of the tide's, world x and y, m/s; the wind's drift comes on top."""
    gustiness: float = 0.12
    """Standard deviation of the wind along its mean over its speed: usual over open water (IEC 61400-3)."""

    def __post_init__(self) -> None:
        _check("wind_speed", self.wind_speed, 0.0, 40.0)
        _check("fetch", self.fetch, 100.0, 1e6)
        _check("direction_deg", self.direction_deg, -360.0, 360.0)
        _check("spread", self.spread, 1.0, math.inf)
        _check("num_waves", self.num_waves, 1, 1000)
        _check("gustiness", self.gustiness, 0.0, 0.5)
        for value in self.current:
            _check("current", value, -5.0, 5.0)

    @property
    def significant_height(self) -> float:
        """Four standard deviations of the surface, m."""
        return 4.0 * math.sqrt(GROWTH * self.fetch * self.wind_speed**2 / GRAVITY)

    @property
    def peak_rate(self) -> float:
        """Angular rate at which most of the waves' energy is, rad/s; 0 without wind."""
        if self.wind_speed == 0.0:
            return 0.0
        return 2.0 * math.pi * PEAK * (GRAVITY**2 / (self.wind_speed * self.fetch)) ** (1.0 / 3.0)


CALM, BREEZE, ROUGH = SeaState(3.0), SeaState(8.0), SeaState(15.0)
SEA_STATES = {"still": SeaState(), "calm": CALM, "breeze": BREEZE, "rough": ROUGH}
"""Beaufort 0, 2, 5 and 7: waves of 0, 0.11, 0.29 and 0.54 m."""


def sea_state(name: str) -> SeaState:
    """Return a sea state by its name.

    Raises:
        InputError: there is none of that name; the message has the closest one.
    """
    if name not in SEA_STATES:
        raise InputError(f"There is no sea state '{name}'.{did_you_mean(name, SEA_STATES)}")
    return SEA_STATES[name]


def jonswap(rates: Array, significant_height: float, peak_rate: float) -> Array:
    """Return the (N,) spectral density of the surface at (N,) angular rates, m^2 s / rad.

    Scaled so that four standard deviations of all of it are the significant height.

    Args:
        rates: Positive, rad/s.
        significant_height: m.
        peak_rate: rad/s.
    """
    ratios, step = np.linspace(0.3, 20.0, 10 * DENSITY_STEPS, retstep=True)
    variance = float(_shape(ratios).sum()) * step * peak_rate
    density: Array = significant_height**2 / 16.0 / variance * _shape(np.asarray(rates) / peak_rate)
    return density


def draw_sea(state: SeaState, depth: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return waves whose sum is a sea: (N, 7) parameters as of `waves.wave_parameters` and (N,) phases, rad.

    All have the same energy: frequencies stand closer where the spectrum is higher, one drawn from each of N parts.
    Directions are drawn likewise and dealt to the frequencies at random.

    Args:
        state: Wind and fetch.
        depth: Of the water, m.
        rng: Draws 3 N numbers and an order of N.
    """
    num = state.num_waves if state.wind_speed > 0.0 else 0
    if num == 0:
        return np.zeros((0, 7)), np.zeros(0)
    rates = state.peak_rate * _one_of_each_part(*_frequencies(), num, rng)
    turns = np.zeros(num)
    if math.isfinite(state.spread):
        turns = rng.permutation(_one_of_each_part(*_directions(state.spread), num, rng))
    towards = math.radians(state.direction_deg) + turns
    numbers = np.array([wave_number(2.0 * math.pi / rate, depth) for rate in rates])
    amplitude = state.significant_height / 4.0 * math.sqrt(2.0 / num)
    columns = (
        numbers * np.cos(towards),
        numbers * np.sin(towards),
        numbers,
        rates,
        np.full(num, amplitude),
        np.zeros(num),
        np.full(num, depth),
    )
    return np.stack(columns, axis=1), rng.uniform(0.0, 2.0 * np.pi, num)


def _shape(ratio: Array) -> Array:
    """Return the spectrum at frequencies over the peak's, but for a factor."""
    width = np.where(ratio <= 1.0, WIDTH_BELOW, WIDTH_ABOVE)
    peak = PEAKEDNESS ** np.exp(-((ratio - 1.0) ** 2) / (2.0 * width**2))
    shape: Array = ratio**-5.0 * np.exp(-1.25 * ratio**-4.0) * peak
    return shape


@functools.cache
def _frequencies() -> tuple[Array, Array]:
    """Return frequencies over the peak's, rising, and the weight of the spectrum below each."""
    ratios = np.linspace(LOWEST, HIGHEST, DENSITY_STEPS)
    return ratios, _weight_below(ratios, _shape(ratios))


@functools.lru_cache(maxsize=8)
def _directions(spread: float) -> tuple[Array, Array]:
    """Return directions from the wind's, rising, and the weight of those below each."""
    angles = np.linspace(-np.pi, np.pi, DENSITY_STEPS)
    return angles, _weight_below(angles, np.cos(0.5 * angles) ** (2.0 * spread))


def _weight_below(values: Array, density: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(values))])


def _one_of_each_part(values: Array, weight: Array, num: int, rng: np.random.Generator) -> Array:
    """Return one value from each of `num` parts of equal weight, rising."""
    shares = (np.arange(num) + rng.random(num)) / num
    drawn: Array = np.interp(shares * weight[-1], weight, values)
    return drawn
