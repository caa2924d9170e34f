"""The sea in an episode: waves drawn from its state, and gusts of wind and current.

The motion of the water under waves is that of `sim/batch/boat_water.py`. World frame: z up from still water.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from aquanav_tools.sim.batch.boat_water import probe
from aquanav_tools.sim.sea_state import SeaState, draw_sea
from aquanav_tools.sim.water import GUST_SIZE, GUST_TIME
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
        self.draw_ahead(dt, 1)
        self._phases += self._waves[:, 3] * dt

    def draw_ahead(self, dt: float, count: int) -> tuple[Array, Array]:
        """Let gusts go on by `count` steps of `dt` (s). The waves stay: this is for who moves them by themselves.

        Returns:
            (count, 3) `current` and (count, 2) `wind` at the beginning of each, m/s.
        """
        kept = np.exp(-dt / self._times)
        gusts = np.concatenate([self._gusts[None], np.sqrt(1.0 - kept**2) * self._rng.standard_normal((count, 4))])
        _add_up(gusts, kept)
        self._gusts = gusts[-1]
        return self._currents(gusts[:-1]), self._winds(gusts[:-1])

    @property
    def waves(self) -> tuple[Array, Array]:
        """(N, 7) parameters of `waves.wave_parameters` and (N,) phases now, rad."""
        return self._waves, self._phases

    @property
    def wind(self) -> Array:
        """(2,) velocity of the air 10 m above the water, m/s."""
        return self._winds(self._gusts)

    @property
    def current(self) -> Array:
        """(3,) velocity of the water at the surface without its waves, m/s."""
        return self._currents(self._gusts)

    def set_phases(self, phases: Array) -> None:
        """Bring the waves to (N,) phases, rad: for who moves them by themselves."""
        self._phases = phases.copy()

    def rise(self, positions: Array) -> Array:
        """Return how far the surface stands above still water at (N, 2) or (N, 3) places, (N,) m."""
        level = np.concatenate([positions[:, :2], np.zeros((len(positions), 1))], axis=1)
        return probe(self._waves, self._phases, level)[0]

    def velocities(self, positions: Array) -> Array:
        """Return the (N, 3) velocity of the water at (N, 3) places, m/s; in the air, that of the surface below."""
        found: Array = self.current + probe(self._waves, self._phases, positions)[1]
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
