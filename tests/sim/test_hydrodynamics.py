"""The integrator against closed forms. Tolerances are the splitting's and Runge-Kutta's errors at dt = 0.02."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import ellipk

from aquanav_tools.sim.hydrodynamics import advance, mean_velocity, pack_parameters
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array, rotation_matrix

MASS = np.array([17.0, 24.2, 26.07, 0.28, 0.25, 0.31])
LINEAR = np.array([4.03, 6.22, 5.18, 0.07, 0.07, 0.07])
QUADRATIC = np.array([18.18, 21.66, 36.99, 1.55, 1.55, 1.55])
NONE = np.zeros(6)
STILL = np.zeros(3)
DT = 0.02


def at_rest() -> Array:
    state = np.zeros(13)
    state[3] = 1.0
    return state


def run(
    state: Array, steps: int, parameters: Array, wrench: Array = NONE, current: Array = STILL, dt: float = DT
) -> Array:
    for _ in range(steps):
        state = advance(state, wrench, current, parameters, dt)
    return state


def random_state(rng: np.random.Generator) -> Array:
    state = rng.normal(size=13)
    state[3:7] /= np.linalg.norm(state[3:7])
    return state


def multiply(a: Array, b: Array) -> Array:
    """Hamilton product, written from its definition by scalar and vector part."""
    return np.concatenate([[a[0] * b[0] - a[1:] @ b[1:]], a[0] * b[1:] + b[0] * a[1:] + np.cross(a[1:], b[1:])])


def terminal_speed(force: float, axis: int) -> float:
    """Positive root of quadratic * v^2 + linear * v = force."""
    a, b = LINEAR[axis], QUADRATIC[axis]
    return float((-a + np.sqrt(a * a + 4 * b * force)) / (2 * b))


def test_neutral_vehicle_at_rest_stays_at_rest() -> None:
    state = run(at_rest(), 100, pack_parameters(MASS, LINEAR, QUADRATIC, righting=2.0))
    np.testing.assert_array_equal(state, at_rest())


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_constant_force_leads_to_the_terminal_speed(axis: int) -> None:
    wrench = np.zeros(6)
    wrench[axis] = 22.0
    state = run(at_rest(), 1000, pack_parameters(MASS, LINEAR, QUADRATIC), wrench)
    assert state[7 + axis] == pytest.approx(terminal_speed(22.0, axis), rel=2e-3)


def test_speed_decays_as_the_closed_form_says() -> None:
    speed, duration = 2.0, 3.0
    state = at_rest()
    state[7] = speed
    state = run(state, 150, pack_parameters(MASS, LINEAR, QUADRATIC))
    decay = np.exp(-LINEAR[0] * duration / MASS[0])
    expected = LINEAR[0] * speed * decay / (LINEAR[0] + QUADRATIC[0] * speed * (1 - decay))
    assert state[7] == pytest.approx(expected, rel=1e-12)  # the damping flow is exact


def test_buoyant_vehicle_ascends_at_its_terminal_speed() -> None:
    state = run(at_rest(), 1000, pack_parameters(MASS, LINEAR, QUADRATIC, net_weight=-5.0))
    assert state[9] == pytest.approx(terminal_speed(5.0, 2), rel=2e-3)
    assert state[2] > 0


def test_righting_period_is_that_of_a_pendulum() -> None:
    righting, amplitude = 2.3, np.radians(40.0)
    state = at_rest()
    state[3:7] = [np.cos(amplitude / 2), np.sin(amplitude / 2), 0, 0]
    parameters = pack_parameters(MASS, NONE, NONE, righting=righting)
    crossings, before = [], 0.0
    for step in range(1, 800):
        state = advance(state, NONE, STILL, parameters, DT)
        if before < 0 <= state[10]:  # the roll rate turns positive once per period
            crossings.append(DT * (step - state[10] / (state[10] - before)))
        before = state[10]
    # A pendulum's period in closed form; scipy takes the parameter m = k^2.
    expected = 4 * np.sqrt(MASS[3] / righting) * ellipk(np.sin(amplitude / 2) ** 2)
    assert np.diff(crossings).mean() == pytest.approx(expected, rel=1e-4)  # linear interpolation of the crossing


def test_ideal_fluid_keeps_energy_and_impulse(rng: np.random.Generator) -> None:
    state = random_state(rng)
    parameters = pack_parameters(MASS, NONE, NONE)

    def energy(state: Array) -> float:
        return float(0.5 * MASS @ state[7:] ** 2)

    def impulse(state: Array) -> Array:  # Kelvin's, in the world
        return rotation_matrix(state[3:7]) @ (MASS[:3] * state[7:10])

    after = run(state, 500, parameters)
    # Runge-Kutta at turn rates of 1 to 2 rad/s; an explicit Euler step would gain more than the energy itself.
    assert energy(after) == pytest.approx(energy(state), rel=5e-4)
    np.testing.assert_allclose(impulse(after), impulse(state), atol=5e-4 * np.linalg.norm(impulse(state)))


def test_damping_never_adds_energy(rng: np.random.Generator) -> None:
    parameters = pack_parameters(MASS, LINEAR, QUADRATIC)
    for _ in range(50):
        state = random_state(rng)
        for dt in (0.02, 0.1):
            after = advance(state, NONE, STILL, parameters, dt)
            assert MASS @ after[7:] ** 2 <= MASS @ state[7:] ** 2 * (1 + 1e-6)  # the error of Runge-Kutta


def test_fast_body_does_not_diverge_at_a_coarse_step() -> None:
    state = at_rest()
    state[7] = 10.0
    parameters = pack_parameters(MASS, LINEAR, QUADRATIC)
    for _ in range(50):
        before, state = state, advance(state, NONE, STILL, parameters, 0.1)
        assert 0 < state[7] < before[7]


def test_error_falls_with_the_square_of_the_step(rng: np.random.Generator) -> None:
    state = random_state(rng)
    parameters = pack_parameters(MASS, LINEAR, QUADRATIC, net_weight=1.0, righting=2.3)
    wrench = rng.normal(size=6)
    wrench[3:] *= 0.2
    exact = run(state, 1000, parameters, wrench, dt=0.001)
    errors = [np.abs(run(state, round(1 / dt), parameters, wrench, dt=dt) - exact).max() for dt in (0.04, 0.02, 0.01)]
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert np.all(np.abs(orders - 2.0) < 0.3)


def test_motion_turns_with_the_world(rng: np.random.Generator) -> None:
    state, wrench, current = random_state(rng), rng.normal(size=6), rng.normal(size=3)
    angle = 0.7  # about the vertical, the only axis that weight and buoyancy allow
    turn = np.array([np.cos(angle / 2), 0, 0, np.sin(angle / 2)])
    parameters = pack_parameters(MASS, LINEAR, QUADRATIC, net_weight=3.0, righting=2.3)

    def turned(state: Array) -> Array:
        return np.concatenate([rotation_matrix(turn) @ state[:3], multiply(turn, state[3:7]), state[7:]])

    after = run(state, 50, parameters, wrench, current)
    after_turned = run(turned(state), 50, parameters, wrench, rotation_matrix(turn) @ current)
    np.testing.assert_allclose(after_turned, turned(after), atol=1e-12)


def test_drifting_vehicle_moves_with_the_current() -> None:
    current = np.array([0.3, -0.2, 0.1])
    parameters = pack_parameters(MASS, LINEAR, QUADRATIC)
    state = at_rest()
    state[7:10] = current
    after = run(state, 100, parameters, current=current)
    np.testing.assert_allclose(after[:3], 2.0 * current, atol=1e-12)
    np.testing.assert_allclose(after[7:10], current, atol=1e-12)


def test_current_carries_a_vehicle_along() -> None:
    current = np.array([0.3, 0.0, 0.0])
    after = run(at_rest(), 2000, pack_parameters(MASS, LINEAR, QUADRATIC), current=current)
    np.testing.assert_allclose(after[7:10], current, atol=1e-3)


def test_mean_velocity_leads_from_one_state_to_the_next(rng: np.random.Generator) -> None:
    for _ in range(20):
        before, after = random_state(rng), random_state(rng)
        velocity = mean_velocity(before, after, 0.5)
        angle = np.linalg.norm(velocity[3:]) * 0.5
        axis = velocity[3:] / np.linalg.norm(velocity[3:])
        turn = np.concatenate([[np.cos(angle / 2)], np.sin(angle / 2) * axis])
        np.testing.assert_allclose(before[:3] + 0.5 * velocity[:3], after[:3], atol=1e-12)
        np.testing.assert_allclose(abs(multiply(turn, before[3:7]) @ after[3:7]), 1.0, atol=1e-12)
        assert angle <= np.pi + 1e-12


def test_autopilot_holds_the_heading_at_full_speed() -> None:
    vehicle = load_vehicle("bluerov2")
    wrench = np.array([vehicle.actuators.surge_force, 0, 0, 0, 0, 0])
    state = at_rest()
    state[8], state[12] = 0.01, 0.01  # a slight drift and turn
    with_autopilot = run(state, 500, vehicle.motion_parameters(1000.0), wrench)
    without = run(state, 500, pack_parameters(MASS, LINEAR, QUADRATIC, righting=2.3), wrench)
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
        pack_parameters(np.full(6, mass), np.full(6, damping), NONE)
