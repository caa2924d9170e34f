"""Speeds of the trial against the balance of force and drag."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.sim.trial import try_out
from aquanav_tools.sim.vehicle import load_vehicle


def balance(force: float, linear: float, quadratic: float) -> float:
    """Positive root of quadratic * v^2 + linear * v = force."""
    return float((np.sqrt(linear**2 + 4 * quadratic * force) - linear) / (2 * quadratic))


def test_bluerov2_reaches_the_speeds_at_which_drag_balances_its_actions() -> None:
    trial = try_out(load_vehicle("bluerov2"))
    # Wu's drag; 3e-3 is the splitting's error at dt = 0.02.
    assert trial.ahead == pytest.approx(balance(22.0, 4.03, 18.18), rel=3e-3)
    assert trial.reverse == pytest.approx(balance(11.0, 4.03, 18.18), rel=3e-3)
    assert trial.rise == trial.sink == pytest.approx(balance(12.0, 5.18, 36.99), rel=3e-3)
    # 15 (1.5 - r) = 0.07 r + 1.55 r^2: the rate loop against drag. Turning at full thrust sets it sliding sideways.
    assert trial.turn == pytest.approx(balance(22.5, 15.07, 1.55), rel=0.1)


def test_original_reaches_the_speeds_of_its_table() -> None:
    trial = try_out(load_vehicle("original-auv"))
    assert trial.ahead == pytest.approx(1.96, abs=0.005)
    assert trial.reverse == pytest.approx(0.98, abs=0.005)
    assert trial.turn == pytest.approx(3.04, abs=0.005)
    assert trial.rise == pytest.approx(2.1, abs=0.1)  # "peak 2.1 m/s", read off a plot
    assert trial.sink == pytest.approx(3.9, abs=0.1)
