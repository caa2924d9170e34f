"""The sea in an episode: its surface, the water's motion below it, and gusts of wind and current.

Waves pass through each other unchanged (linear theory); depths count from the moving surface (Wheeler), so that crests
are no faster than the theory's surface. World frame: z up from still water.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from aquanav_tools.sim.sea_state import SeaState, draw_sea
from aquanav_tools.sim.water import GUST_SIZE, GUST_TIME
from aquanav_tools.sim.waves import add_waves, wave_rise
from aquanav_tools.types import Array

GUST_LENGTH = 100.0
"""Size of the gusts 10 m above the water, m: the usual integral length scale."""
ACROSS = 0.8
"""Gusts across the wind over those along it (IEC 61400-1)."""
DRIFT = 0.03
"""Speed of the surface over the wind's (Wu, Journal of Fluid Mechanics 68, 1975)."""


class SeaWater:
    """Wind, waves and current over time."""

    def __init__(self, state: SeaState, depth: float, rng: np.random.Generator | None = None) -> None:
        """Begin with a sea of a state over a bed of a depth (m), drawn as `reset` does."""
        self._state, self._depth = state, depth
        towards = math.radians(state.direction_deg)
        self._along = np.array([math.cos(towards), math.sin(towards)])
        self._across = np.array([-math.sin(towards), math.cos(towards)])
        gust_time = GUST_LENGTH / max(state.wind_speed, 1e-3)
        self._times = np.array([gust_time, gust_time, GUST_TIME, GUST_TIME])
        self._gusts = np.zeros(4)
        """Along and across the wind, along and across the current, in standard deviations."""
        self.reset(np.random.default_rng(0) if rng is None else rng)

    def reset(self, rng: np.random.Generator) -> None:
        """Begin an episode: draw other waves, and gusts from their stationary distribution."""
        self._rng = rng
        self._waves, self._phases = draw_sea(self._state, self._depth, rng)
        rng.standard_normal(out=self._gusts)

    def advance(self, dt: float) -> None:
        """Let time pass, s; exact for any step."""
        kept = np.exp(-dt / self._times)
        self._gusts = kept * self._gusts + np.sqrt(1.0 - kept**2) * self._rng.standard_normal(4)
        self._phases += self._waves[:, 3] * dt

    def draw_ahead(self, dt: float, count: int) -> tuple[Array, Array]:
        """Let gusts go on by `count` times `advance(dt)`.

        The waves stay: this is for who moves them by themselves.

        Returns:
            (count, 3) `current` and (count, 2) `wind` before each, m/s.
        """
        kept = np.exp(-dt / self._times)
        gusts = np.concatenate([self._gusts[None], np.sqrt(1.0 - kept**2) * self._rng.standard_normal((count, 4))])
        _add_up(gusts, kept)
        self._gusts = gusts[-1]
        return self._currents(gusts[:-1]), self._winds(gusts[:-1])

    @property
    def waves(self) -> tuple[Array, Array]:
        """(N, 7) parameters of `waves.add_waves` and (N,) phases now, rad: for compiled functions."""
        return self._waves, self._phases

    @property
    def wind(self) -> Array:
        """(2,) velocity of the air 10 m above the water, m/s."""
        return self._winds(self._gusts)

    @property
    def current(self) -> Array:
        """(3,) velocity of the water at the surface without its waves, m/s."""
        return self._currents(self._gusts)

    def rise(self, positions: Array) -> Array:
        """Return how far the surface stands above still water at (N, 2) or (N, 3) places, (N,) m."""
        found = np.empty(len(positions))
        _rises(np.ascontiguousarray(positions), self._waves, self._phases, found)
        return found

    def velocities(self, positions: Array) -> Array:
        """Return the (N, 3) velocity of the water at (N, 3) places, m/s; in the air, that of the surface below."""
        found = np.tile(self.current, (len(positions), 1))
        _add_velocities(np.ascontiguousarray(positions), self._waves, self._phases, found)
        return found

    def _winds(self, gusts: Array) -> Array:
        """Return the (..., 2) winds of (..., 4) gusts, m/s."""
        speed, strength = self._state.wind_speed, self._state.gustiness
        along, across = 1.0 + strength * gusts[..., 0], ACROSS * strength * gusts[..., 1]
        winds: Array = speed * (along[..., None] * self._along + across[..., None] * self._across)
        return winds

    def _currents(self, gusts: Array) -> Array:
        """Return the (..., 3) currents of (..., 4) gusts, m/s."""
        east, north = self._state.current
        along, across = 1.0 + GUST_SIZE * gusts[..., 2], GUST_SIZE * gusts[..., 3]
        drift = DRIFT * self._state.wind_speed * self._along
        flows = along * east - across * north + drift[0], along * north + across * east + drift[1]
        return np.stack([*flows, np.zeros_like(along)], axis=-1)


@numba.njit(cache=True)
def _add_up(gusts, kept):  # type: ignore[no-untyped-def]
    """Add to each row what is kept of the row before."""
    for n in range(1, len(gusts)):
        gusts[n] += kept * gusts[n - 1]


@numba.njit(cache=True)
def sea_rise(waves, phases, x, y):  # type: ignore[no-untyped-def]
    """Return how far the surface of all waves stands above still water at a place, m."""
    rise = 0.0
    for n in range(len(waves)):
        rise += wave_rise(waves[n], phases[n], x, y)
    return rise


@numba.njit(cache=True)
def add_sea(waves, phases, x, y, z, velocity):  # type: ignore[no-untyped-def]
    """Add the velocity of the water under all waves at a place to a (3,) velocity, m/s."""
    level = z - sea_rise(waves, phases, x, y)
    for n in range(len(waves)):
        add_waves(waves[n], phases[n], x, y, level, velocity)


@numba.njit(cache=True)
def _rises(positions, waves, phases, found):  # type: ignore[no-untyped-def]
    for n in range(len(positions)):
        found[n] = sea_rise(waves, phases, positions[n, 0], positions[n, 1])


@numba.njit(cache=True)
def _add_velocities(positions, waves, phases, found):  # type: ignore[no-untyped-def]
    for n in range(len(positions)):
        add_sea(waves, phases, positions[n, 0], positions[n, 1], positions[n, 2], found[n])
