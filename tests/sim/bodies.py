"""Bodies and small tools that the tests of the integrator share."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from aquanav_tools.sim.batch.prediction import advance
from aquanav_tools.sim.body_parameters import BodyParameters, MotionParameters
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


def random_states(rng: np.random.Generator, num: int) -> Array:
    states = rng.normal(size=(num, 13))
    states[:, 3:7] /= np.linalg.norm(states[:, 3:7], axis=1, keepdims=True)
    return states


def random_state(rng: np.random.Generator) -> Array:
    return random_states(rng, 1)[0]


def body(
    mass: Array, linear: Array, quadratic: Array, net_weight: float = 0.0, righting: float = 0.0
) -> BodyParameters:
    """A body with six masses or a matrix of them, and a moment per sine of its tilt."""
    matrix = np.diag(mass) if mass.ndim == 1 else mass
    return BodyParameters(matrix, linear, quadratic, net_weight, np.array([0.0, 0.0, righting]))


def run(
    states: Array,
    steps: int,
    parameters: MotionParameters,
    wrench: Array = NONE,
    current: Array = STILL,
    dt: float = DT,
) -> Array:
    """Where a (S,) state, or each of (N, S) states, comes in so many steps under a (6,) wrench, or one for each."""
    rows = np.atleast_2d(states)
    pushes = np.broadcast_to(wrench, (len(rows), 6))[:, None]
    ends: Array = advance(rows, pushes, current, parameters, dt, steps)[:, -1].reshape(states.shape)
    return ends


def path(state: Array, steps: int, parameters: MotionParameters, wrench: Array = NONE, dt: float = DT) -> Array:
    """The (steps + 1, S) states on the way from one in still water."""
    return advance(state[None], wrench, STILL, parameters, dt, steps)[0]


def multiply(a: Array, b: Array) -> Array:
    """Hamilton product, written from its definition by scalar and vector part."""
    return np.concatenate([[a[0] * b[0] - a[1:] @ b[1:]], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])


def extrapolated(measure: Callable[[float], Array | float], dt: float = DT) -> Array:
    """What `measure(dt)` tends to for a scheme whose error falls with dt^2: its dt^2 term is taken out.

    What is left is of fourth order, since a symmetric scheme has no odd terms.
    """
    result: Array = (4.0 * np.asarray(measure(0.5 * dt)) - np.asarray(measure(dt))) / 3.0
    return result
