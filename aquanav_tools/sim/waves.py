"""Small waves on a free surface, after Airy: their length, and what the laws of `sim/batch` need of them.

Source: Dean and Dalrymple, Water Wave Mechanics for Engineers and Scientists (1991), chapters 3 and 4.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from aquanav_tools.scenario.schema import WaveSettings
from aquanav_tools.sim.vehicle_base import GRAVITY
from aquanav_tools.types import Array

NEWTON_ROUNDS = 30
DEEP = 20.0
"""Wave number times depth from which the bottom is not felt: its cosh and sinh are equal to 1e-17."""


@numba.njit(cache=True)
def wave_number(period: float, depth: float) -> float:
    """Return the wave number k, rad/m, that solves w^2 = g k tanh(k h) for a period, s, in water of a depth, m."""
    deep = (2.0 * math.pi / period) ** 2 / GRAVITY
    if deep * depth >= DEEP:
        return deep
    k = deep / math.sqrt(math.tanh(deep * depth))  # Eckart's start, within 5 %
    for _ in range(NEWTON_ROUNDS):
        tanh = math.tanh(k * depth)
        k -= (k * tanh - deep) / (tanh + k * depth * (1.0 - tanh * tanh))
    return k


def wave_parameters(waves: WaveSettings, surface: float) -> Array:
    """Return the (7,) parameters of waves: k along x and y, k, angular rate, amplitude, surface, depth."""
    k = wave_number(waves.period, waves.depth)
    towards = math.radians(waves.direction_deg)
    rate = 2.0 * math.pi / waves.period
    return np.array([k * math.cos(towards), k * math.sin(towards), k, rate, 0.5 * waves.height, surface, waves.depth])
