"""The integrator against published vehicle models that others wrote; tests/sim/data says whose, and how they were run.

Their numbers come from their own equations of motion, integrated to 1e-9 and better, so that what differs is our
splitting's error, which falls with the square of dt, and whatever the two models do not share.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from aquanav_tools.sim.batch.prediction import advance
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array

DATA = Path(__file__).parent / "data"
STILL = np.zeros(3)
SEA_WATER = 1026.0


def published(name: str) -> dict[str, Array]:
    read = json.loads((DATA / name).read_text())
    return {key: np.array(value) for key, value in read.items() if isinstance(value, list)}


def swim(vehicle: str, start: Array, wrenches: Array, dt: float, per_row: float, rows_per_wrench: int) -> Array:
    """The (N, 13) states at every `per_row` seconds."""
    parameters = load_vehicle(DATA / vehicle).motion_parameters(SEA_WATER)
    steps_per_row = round(per_row / dt)
    pushes = np.repeat(wrenches, rows_per_wrench * steps_per_row, axis=0)
    return advance(start[None], pushes, STILL, parameters, dt, len(pushes))[0, ::steps_per_row]


def bluerov2(dt: float) -> tuple[Array, Array]:
    """Ours and SMaRC's (41, 13) states, quaternions with the same sign."""
    reference = published("bluerov2_smarc.json")
    theirs = reference["states"]
    ours = swim("bluerov2_smarc.toml", theirs[0], reference["wrenches"], dt, 0.5, 4)
    ours[:, 3:7] *= np.sign(np.sum(ours[:, 3:7] * theirs[:, 3:7], axis=1))[:, None]
    return ours, theirs


def test_bluerov2_moves_as_in_smarcs_model() -> None:
    # 20 s in all six axes, to 0.6 m/s and 1.7 rad/s: every term of the model acts.
    ours, theirs = bluerov2(0.02)
    error = np.abs(ours - theirs).max(axis=0)
    assert np.ptp(theirs[:, :3], axis=0).min() > 1.0
    assert error[:3].max() < 0.02  # m, after 4 m and four turns about; the splitting's error at the environment's dt
    assert error[3:7].max() < 0.01
    assert error[7:10].max() < 0.002  # m/s
    assert error[10:].max() < 0.015  # rad/s


def test_the_difference_to_smarcs_model_is_the_splittings_error() -> None:
    (coarse, theirs), (fine, _) = bluerov2(0.02), bluerov2(0.01)
    ratio = np.abs(coarse - theirs).max(axis=0) / np.abs(fine - theirs).max(axis=0)
    np.testing.assert_allclose(ratio, 4.0, rtol=0.05)  # second order; the next term of its error is of fourth order
    extrapolated = (4.0 * fine - coarse) / 3.0
    assert np.abs(extrapolated - theirs).max() < 2e-5  # the fourth order's rest, and eight digits in the file


def test_remus100_rolls_and_pitches_as_in_fossens_simulator() -> None:
    # A centre of mass below the origin couples roll with sway and pitch with surge. At 0.02 m/s the lift and the
    # cross-flow drag, which our format does not carry, are forces of 0.1 N beside 304 N of weight; they and Fossen's
    # surge damping, which fades with speed, leave a millimetre or two of drift.
    theirs = published("remus100_fossen.json")["states"][::2]
    start = np.zeros(13)
    start[3:7] = np.roll(Rotation.from_euler("xyz", theirs[0, 3:6]).as_quat(), 1)
    ours = swim("remus100.toml", start, np.zeros((20, 6)), 0.01, 0.5, 1)
    angles = Rotation.from_quat(np.roll(ours[:, 3:7], -1, axis=1)).as_euler("xyz")
    error = np.abs(angles - theirs[:, 3:6]).max(axis=0)
    assert np.abs(theirs[:, 3:5]).max(axis=0).min() > np.radians(10)
    assert np.degrees(error[:2]).max() < 0.05  # roll and pitch, of 25 and 12 degrees
    assert np.degrees(error[2]) < 0.1  # heading, from the terms left out
    assert np.abs(ours[:, :3] - theirs[:, :3]).max() < 0.003
