"""The integrator against closed forms.

The step is a Strang splitting of exact parts: its error falls with dt^2. Where a closed form is compared, the dt^2 term
is taken out by a second run at half the step, and the tolerance is the rest, of fourth order; the error at the
environment's step alone is bounded beside it.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipk

from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array, rotation_matrix
from tests.sim.bodies import (
    DT,
    LINEAR,
    MASS,
    NONE,
    QUADRATIC,
    at_rest,
    body,
    coupled_mass,
    extrapolated,
    path,
    random_state,
    run,
)

FORCE = np.array([22.0, 22.0, 22.0, 0.4, 0.4, 0.4])
"""Per axis, N and N m: leads to 0.6 to 1 m/s and 0.5 rad/s."""


def terminal_speed(force: float, axis: int) -> float:
    """Positive root of quadratic * v^2 + linear * v = force."""
    a, b = LINEAR[axis], QUADRATIC[axis]
    return float((-a + np.sqrt(a * a + 4 * b * force)) / (2 * b))


def speed_from_rest(time: float, force: float, axis: int) -> float:
    """Closed form of m v' = force - a v - b v^2 with v(0) = 0, through the two roots of the right side."""
    root = np.sqrt(LINEAR[axis] ** 2 + 4 * QUADRATIC[axis] * force)
    fast = (-LINEAR[axis] + root) / (2 * QUADRATIC[axis])
    slow = (-LINEAR[axis] - root) / (2 * QUADRATIC[axis])
    left = np.exp(-root * time / MASS[axis]) * fast / slow
    return float((fast - slow * left) / (1 - left))


def along(axis: int, size: float) -> Array:
    wrench = np.zeros(6)
    wrench[axis] = size
    return wrench


def test_neutral_vehicle_at_rest_stays_at_rest() -> None:
    state = run(at_rest(), 100, body(MASS, LINEAR, QUADRATIC, righting=2.0))
    np.testing.assert_array_equal(state, at_rest())


@pytest.mark.parametrize("axis", range(6))
def test_constant_force_leads_to_the_terminal_speed(axis: int) -> None:
    parameters = body(MASS, LINEAR, QUADRATIC)

    def final_speed(dt: float) -> float:
        return float(run(at_rest(), round(20 / dt), parameters, along(axis, FORCE[axis]), dt=dt)[7 + axis])

    expected = terminal_speed(FORCE[axis], axis)
    assert final_speed(DT) == pytest.approx(expected, rel=2e-3)
    assert extrapolated(final_speed) == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize("axis", range(6))
@pytest.mark.parametrize("time", [0.2, 1.0, 3.0])
def test_speed_from_rest_rises_as_the_closed_form_says(axis: int, time: float) -> None:
    parameters = body(MASS, LINEAR, QUADRATIC)

    def speed(dt: float) -> float:
        return float(run(at_rest(), round(time / dt), parameters, along(axis, FORCE[axis]), dt=dt)[7 + axis])

    assert extrapolated(speed) == pytest.approx(speed_from_rest(time, FORCE[axis], axis), rel=2e-6)


@pytest.mark.parametrize("axis", range(6))
def test_speed_decays_as_the_closed_form_says(axis: int) -> None:
    speed, duration = 2.0, 3.0
    state = at_rest()
    state[7 + axis] = speed
    state = run(state, 150, body(MASS, LINEAR, QUADRATIC))
    decay = np.exp(-LINEAR[axis] * duration / MASS[axis])
    expected = LINEAR[axis] * speed * decay / (LINEAR[axis] + QUADRATIC[axis] * speed * (1 - decay))
    assert state[7 + axis] == pytest.approx(expected, rel=1e-12)  # the damping flow is exact


def test_damping_without_a_linear_part_decays_with_one_over_time() -> None:
    state = at_rest()
    state[7] = 2.0
    state = run(state, 150, body(MASS, NONE, QUADRATIC))
    assert state[7] == pytest.approx(2.0 / (1.0 + QUADRATIC[0] / MASS[0] * 2.0 * 3.0), rel=1e-12)


def test_buoyant_vehicle_ascends_as_the_closed_form_says() -> None:
    # With quadratic drag alone, m w' = F - b w^2: w = w_end tanh(t / T), z = w_end T ln cosh(t / T).
    force, duration = 5.0, 4.0
    parameters = body(MASS, NONE, QUADRATIC, net_weight=-force)

    def motion(dt: float) -> Array:
        return run(at_rest(), round(duration / dt), parameters, dt=dt)[[2, 9]]

    end, time = np.sqrt(force / QUADRATIC[2]), MASS[2] / np.sqrt(force * QUADRATIC[2])
    expected = [end * time * np.log(np.cosh(duration / time)), end * np.tanh(duration / time)]
    np.testing.assert_allclose(extrapolated(motion), expected, rtol=2e-6)
    np.testing.assert_allclose(motion(DT), expected, rtol=1e-3)


def test_a_tumbling_ball_rises_as_if_it_did_not_tumble(rng: np.random.Generator) -> None:
    # Equal masses and equal linear drag know no direction: m V' = F - a V in the world, whatever the ball's turning.
    mass, drag, force, duration = 20.0, 8.0, 5.0, 3.0
    start = random_state(rng)
    parameters = body(np.full(6, mass), np.full(6, drag), NONE, net_weight=-force)

    def velocity(dt: float) -> Array:
        state = run(start, round(duration / dt), parameters, dt=dt)
        return rotation_matrix(state[3:7]) @ state[7:10]

    left, before = np.exp(-drag / mass * duration), rotation_matrix(start[3:7]) @ start[7:10]
    expected = before * left + np.array([0.0, 0.0, force / drag * (1.0 - left)])
    np.testing.assert_allclose(extrapolated(velocity), expected, atol=1e-6)


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("degrees", [10.0, 40.0, 120.0])
def test_righting_period_is_that_of_a_pendulum(axis: int, degrees: float) -> None:
    righting, amplitude = 2.3, np.radians(degrees)
    state = at_rest()
    state[3], state[4 + axis] = np.cos(amplitude / 2), np.sin(amplitude / 2)
    parameters = body(MASS, NONE, NONE, righting=righting)
    # A pendulum's period in closed form; scipy takes the parameter m = k^2.
    expected = 4 * np.sqrt(MASS[3 + axis] / righting) * ellipk(np.sin(amplitude / 2) ** 2)
    rates = path(state, round(5.5 * expected / DT), parameters)[:, 10 + axis]
    # The rate of turn becomes positive once per period, where its slope is steady.
    steps = np.flatnonzero((rates[:-1] < 0) & (rates[1:] >= 0))
    crossings = DT * (steps - rates[steps] / (rates[steps + 1] - rates[steps]))
    # Runge-Kutta errs by (omega dt)^4 / 120 = 1e-8 per period, and crossings are interpolated to dt^3.
    assert np.diff(crossings).mean() == pytest.approx(expected, rel=2e-6)


def test_two_axes_coupled_by_mass_share_an_impulse_as_the_matrix_says() -> None:
    # Without damping, force * time = M v; Coriolis terms are of the speed's square and the speeds are small.
    matrix, force, duration = coupled_mass(), np.array([1e-4, 0, 0, 0, 0, 2e-6]), 1.0
    state = run(at_rest(), 50, body(matrix, NONE, NONE), force)
    np.testing.assert_allclose(matrix @ state[7:], force * duration, atol=1e-9)


def test_coupled_masses_slow_down_as_the_matrix_exponential_says(rng: np.random.Generator) -> None:
    from scipy.linalg import expm

    # Linear damping alone: v(t) = exp(-M^-1 D t) v(0), where speeds are too small for Coriolis terms.
    matrix, speeds, duration = coupled_mass(), 1e-6 * rng.normal(size=6), 2.0
    start = at_rest()
    start[7:] = speeds

    def slowed(dt: float) -> Array:
        return run(start, round(duration / dt), body(matrix, 5.0 * LINEAR, NONE), dt=dt)[7:] * 1e6

    expected = expm(-np.linalg.solve(matrix, np.diag(5.0 * LINEAR)) * duration) @ speeds * 1e6
    assert np.abs(slowed(DT) - expected).max() < 1e-3
    np.testing.assert_allclose(extrapolated(slowed), expected, atol=1e-5)


def test_fast_body_does_not_diverge_at_a_coarse_step() -> None:
    state = at_rest()
    state[7] = 10.0
    speeds = path(state, 50, body(MASS, LINEAR, QUADRATIC), dt=0.1)[:, 7]
    assert (speeds[1:] > 0).all()
    assert (np.diff(speeds) < 0).all()


def test_drifting_vehicle_moves_with_the_current() -> None:
    current = np.array([0.3, -0.2, 0.1])
    parameters = body(MASS, LINEAR, QUADRATIC)
    state = at_rest()
    state[7:10] = current
    after = run(state, 100, parameters, current=current)
    np.testing.assert_allclose(after[:3], 2.0 * current, atol=1e-12)
    np.testing.assert_allclose(after[7:10], current, atol=1e-12)


def test_motion_in_a_current_is_that_in_still_water_carried_along(rng: np.random.Generator) -> None:
    # Forces depend on the velocity through the water alone, and water at a steady, equal speed is an inertial frame.
    current, wrench, state = np.array([0.4, -0.3, 0.2]), rng.normal(size=6), random_state(rng)
    parameters = body(coupled_mass(), LINEAR, QUADRATIC, net_weight=2.0, righting=2.3)
    moving = state.copy()
    moving[7:10] += rotation_matrix(state[3:7]).T @ current
    still, carried = run(state, 100, parameters, wrench), run(moving, 100, parameters, wrench, current)
    np.testing.assert_allclose(carried[:3], still[:3] + 2.0 * current, atol=1e-12)
    np.testing.assert_allclose(carried[3:7], still[3:7], atol=1e-12)
    np.testing.assert_allclose(carried[7:10], still[7:10] + rotation_matrix(still[3:7]).T @ current, atol=1e-12)


def test_current_carries_a_vehicle_along() -> None:
    current = np.array([0.3, 0.0, 0.0])
    after = run(at_rest(), 2000, body(MASS, LINEAR, QUADRATIC), current=current)
    np.testing.assert_allclose(after[7:10], current, atol=1e-3)


def test_autopilot_holds_the_heading_at_full_speed() -> None:
    vehicle = load_vehicle("bluerov2")
    wrench = np.array([22.0, 0, 0, 0, 0, 0])
    state = at_rest()
    state[8], state[12] = 0.01, 0.01  # a slight drift and turn
    with_autopilot = run(state, 500, vehicle.motion_parameters(1000.0), wrench)
    without = run(state, 500, body(MASS, LINEAR, QUADRATIC, righting=2.3), wrench)
    assert abs(with_autopilot[12]) < 0.05
    assert abs(without[12]) > 0.5  # the Munk moment turns it broadside
    assert with_autopilot[7] == pytest.approx(1.0, abs=0.02)


def test_autopilot_rights_a_tilt_within_half_a_second() -> None:
    vehicle = load_vehicle("bluerov2")
    state = at_rest()
    state[3:7] = [np.cos(0.3), np.sin(0.3) * 0.6, np.sin(0.3) * 0.8, 0]
    after = run(state, 25, vehicle.motion_parameters(1000.0))
    assert rotation_matrix(after[3:7])[2, 2] > np.cos(np.radians(5.0))


@pytest.mark.parametrize(("mass", "damping"), [(-1.0, 1.0), (0.0, 1.0), (1.0, -1.0), (np.nan, 1.0)])
def test_impossible_coefficients_are_refused(mass: float, damping: float) -> None:
    with pytest.raises(ValueError, match=r"Masses|Damping"):
        body(np.full(6, mass), np.full(6, damping), NONE)
