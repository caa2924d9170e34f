"""What motion in water keeps and loses: energy, impulse, indifference to direction; and the order of the error."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.sim.body_parameters import BodyParameters
from aquanav_tools.types import Array, rotation_matrix
from tests.sim.bodies import (
    LINEAR,
    MASS,
    NONE,
    QUADRATIC,
    body,
    coupled_mass,
    multiply,
    path,
    random_state,
    random_states,
    run,
)

MATRICES = pytest.mark.parametrize("matrix", [np.diag(MASS), coupled_mass()], ids=["diagonal", "coupled"])


def energy(matrix: Array, states: Array) -> Array:
    """Kinetic energy of body and water at (..., S) states, J."""
    result: Array = 0.5 * np.einsum("...i,ij,...j->...", states[..., 7:], matrix, states[..., 7:])
    return result


def impulse(matrix: Array, state: Array) -> Array:
    """Kelvin's (6,) linear and angular impulse about the world's origin, world frame, N s and N m s."""
    momentum, rotation = matrix @ state[7:], rotation_matrix(state[3:7])
    linear = rotation @ momentum[:3]
    return np.concatenate([linear, rotation @ momentum[3:] + np.cross(state[:3], linear)])


@MATRICES
def test_ideal_fluid_keeps_energy_and_kelvins_impulse(matrix: Array, rng: np.random.Generator) -> None:
    state, parameters = random_state(rng), body(matrix, NONE, NONE)
    before_energy, before = energy(matrix, state), impulse(matrix, state)
    errors = []
    for dt in (0.02, 0.01):
        after = run(state, round(5 / dt), parameters, dt=dt)
        errors.append(
            [energy(matrix, after) / before_energy - 1, *((impulse(matrix, after) - before) / np.abs(before).max())]
        )
    coarse, fine = np.abs(errors).max(axis=1)
    # Runge-Kutta at rates of 1 to 3 rad/s; an explicit Euler step would gain more than the energy itself.
    assert coarse < 0.02
    assert fine < coarse / 8  # of fourth order: a sixteenth, or less where energy's fifth order leads


@MATRICES
def test_exact_damping_never_adds_energy(matrix: Array, rng: np.random.Generator) -> None:
    # At a thousandth of the speed, and with quadratic damping a thousand times as strong, damping takes the same share
    # of it as before, and Coriolis forces a thousandth: what is left of the step is its two halves of damping.
    parameters = body(matrix, LINEAR, 1e3 * QUADRATIC)
    for duration in (0.001, 0.01, 0.5):
        states = random_states(rng, 100)
        states[:, 7:] *= 1e-3
        after = run(states, 1, parameters, dt=2.0 * duration)
        assert (energy(matrix, after) < energy(matrix, states)).all()


@MATRICES
def test_a_step_with_damping_never_adds_energy(matrix: Array, rng: np.random.Generator) -> None:
    parameters = body(matrix, LINEAR, QUADRATIC)
    for dt, speed in ((0.02, 1.0), (0.1, 0.2)):
        states = random_states(rng, 50)
        states[:, 7:] *= speed  # broadside at 3 m/s, the water turns a body by several radians within 0.1 s
        after = run(states, 1, parameters, dt=dt)
        assert (energy(matrix, after) <= energy(matrix, states) * (1 + 1e-6)).all()  # the error of Runge-Kutta


@MATRICES
def test_a_body_flung_at_any_speed_loses_energy(matrix: Array, rng: np.random.Generator) -> None:
    # Up to 30 m/s and 30 rad/s about all axes, where a single Runge-Kutta step at dt = 0.02 would gain energy.
    parameters = body(matrix, LINEAR, QUADRATIC)
    for speed in (1.0, 3.0, 10.0):
        states = random_states(rng, 50)
        states[:, 7:] *= speed
        assert (energy(matrix, run(states, 50, parameters)) < energy(matrix, states)).all()


def test_thrust_and_weight_do_the_work_that_the_energy_shows(rng: np.random.Generator) -> None:
    # Without damping, energy changes by the wrench times the way: force along the path, moment along the turn.
    matrix, wrench, net_weight, dt = coupled_mass(), 0.3 * rng.normal(size=6), 1.5, 0.001
    parameters, state = body(matrix, NONE, NONE, net_weight), random_state(rng)
    states = path(state, 1000, parameters, wrench, dt)
    work = dt * (0.5 * (states[:-1, 7:] + states[1:, 7:]) @ wrench).sum()  # trapezoids: dt^2 / 12 of the power's bend
    total = energy(matrix, states) + net_weight * states[:, 2]
    assert total[-1] - total[0] == pytest.approx(work, abs=2e-5)


@MATRICES
def test_error_falls_with_the_square_of_the_step(matrix: Array, rng: np.random.Generator) -> None:
    state = random_state(rng)
    state[7:] *= 0.3  # faster turning brings Runge-Kutta's fourth order into sight
    parameters = body(matrix, LINEAR, QUADRATIC, net_weight=1.0, righting=2.3)
    wrench = rng.normal(size=6)
    wrench[3:] *= 0.2
    ends = [run(state, round(0.5 / dt), parameters, wrench, dt=dt) for dt in (0.01, 0.005, 0.0025, 0.00125)]
    changes = np.abs(np.diff(ends, axis=0)).max(axis=1)
    orders = np.log2(changes[:-1] / changes[1:])
    assert np.all(np.abs(orders - 2.0) < 0.15)


@MATRICES
def test_motion_turns_with_the_world(matrix: Array, rng: np.random.Generator) -> None:
    state, wrench, current = random_state(rng), rng.normal(size=6), rng.normal(size=3)
    angle = 0.7  # about the vertical, the only axis that weight and buoyancy allow
    turn = np.array([np.cos(angle / 2), 0, 0, np.sin(angle / 2)])
    check_turning(state, wrench, current, turn, body(matrix, LINEAR, QUADRATIC, 3.0, 2.3))


@MATRICES
def test_a_neutral_body_without_righting_knows_no_direction(matrix: Array, rng: np.random.Generator) -> None:
    state, wrench, current, turn = random_state(rng), rng.normal(size=6), rng.normal(size=3), rng.normal(size=4)
    check_turning(state, wrench, current, turn / np.linalg.norm(turn), body(matrix, LINEAR, QUADRATIC))


def check_turning(state: Array, wrench: Array, current: Array, turn: Array, parameters: BodyParameters) -> None:
    def turned(state: Array) -> Array:
        return np.concatenate([rotation_matrix(turn) @ state[:3], multiply(turn, state[3:7]), state[7:]])

    after = run(state, 50, parameters, wrench, current)
    after_turned = run(turned(state), 50, parameters, wrench, rotation_matrix(turn) @ current)
    np.testing.assert_allclose(after_turned, turned(after), atol=1e-12)  # rounding


def test_coupled_equations_are_the_diagonal_ones_where_nothing_couples(rng: np.random.Generator) -> None:
    # A coupling of 1e-13 takes the general way through the code.
    nearly = np.diag(MASS)
    nearly[0, 1] = nearly[1, 0] = 1e-13
    state, wrench = random_state(rng), rng.normal(size=6)
    after = [run(state, 100, body(m, LINEAR, QUADRATIC, 1.0, 2.3), wrench) for m in (np.diag(MASS), nearly)]
    np.testing.assert_allclose(after[1], after[0], atol=1e-11)
