"""Bodies and small tools that the tests of the integrator share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aquanav_tools.sim.hydrodynamics import advance
from aquanav_tools.types import Array

MASS = np.array([17.0, 24.2, 26.07, 0.28, 0.25, 0.31])
LINEAR = np.array([4.03, 6.22, 5.18, 0.07, 0.07, 0.07])
QUADRATIC = np.array([18.18, 21.66, 36.99, 1.55, 1.55, 1.55])
NONE = np.zeros(6)
STILL = np.zeros(3)
DT = 0.02
"""The environment's step, s."""


def coupled_mass() -> Array:
    """A mass matrix in which every axis pulls on every other; positive definite, as rows outweigh their neighbours."""
    rng = np.random.default_rng(5)
    scale = np.sqrt(MASS)
    share = rng.uniform(-0.18, 0.18, (6, 6))
    return np.diag(MASS) + np.triu(share, 1) * np.outer(scale, scale) + np.triu(share, 1).T * np.outer(scale, scale)


def at_rest() -> Array:
    state = np.zeros(13)
    state[3] = 1.0
    return state


def random_state(rng: np.random.Generator) -> Array:
    state = rng.normal(size=13)
    state[3:7] /= np.linalg.norm(state[3:7])
    return state


def run(
    state: Array, steps: int, parameters: Array, wrench: Array = NONE, current: Array = STILL, dt: float = DT
) -> Array:
    for _ in range(steps):
        state = advance(state, wrench, current, parameters, dt)
    return state


def multiply(a: Array, b: Array) -> Array:
    """Hamilton product, written from its definition by scalar and vector part."""
    return np.concatenate([[a[0] * b[0] - a[1:] @ b[1:]], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])


def extrapolated(measure: Callable[[float], Array | float], dt: float = DT) -> Array:
    """What `measure(dt)` tends to for a scheme whose error falls with dt^2: its dt^2 term is taken out.

    What is left is of fourth order, since a symmetric scheme has no odd terms.
    """
    result: Array = (4.0 * np.asarray(measure(0.5 * dt)) - np.asarray(measure(dt))) / 3.0
    return result
