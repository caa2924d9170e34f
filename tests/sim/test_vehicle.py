from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.prediction import Predictor
from aquanav_tools.sim.fossen import Body, FossenVehicle, WaterCoefficients
from aquanav_tools.sim.vehicle import VEHICLE_DIR, known_vehicles, load_vehicle
from aquanav_tools.types import Pose, yaw_quaternion
from tests.sim.batch.worlds import Dive

STILL = np.zeros(3)


def write(folder: Path, old: str, new: str, vehicle: str = "bluerov2") -> Path:
    """A shipped vehicle's file with one piece of text replaced."""
    text = (VEHICLE_DIR / f"{vehicle}.toml").read_text()
    assert old in text
    path = folder / "mine.toml"
    path.write_text(text.replace(old, new))
    return path


def test_bluerov2_has_the_size_of_the_standard_frame() -> None:
    capsule = load_vehicle("bluerov2").capsule
    assert capsule.length == pytest.approx(0.457)
    assert capsule.radius == pytest.approx(0.338 / 2, abs=0.005)


def test_total_mass_adds_what_the_water_adds() -> None:
    # Wu (2018): 11.5 kg and 0.16 kg m^2, and the added mass of table 5.2.
    expected = [11.5 + 5.5, 11.5 + 12.7, 11.5 + 14.57, 0.28, 0.28, 0.28]
    np.testing.assert_allclose(load_vehicle("bluerov2").total_mass, expected)


def test_a_centre_of_mass_off_the_origin_adds_what_steiner_says() -> None:
    # A mass m at distance d adds m d^2 to the inertia about either axis across, and couples them with m d.
    matrix = Body(10.0, 0.01, (1.0, 1.0, 1.0), 0.0, (0.0, 0.0, -0.2)).rigid_mass()
    np.testing.assert_allclose(np.diag(matrix), [10, 10, 10, 1.4, 1.4, 1.0])
    # Rolling (left side up) about the origin swings the mass below it to the left, pitching (nose down) astern.
    velocity_of_mass = np.cross([1.0, 0.0, 0.0], [0.0, 0.0, -0.2])
    np.testing.assert_allclose(matrix[:3, 3], 10.0 * velocity_of_mass)
    np.testing.assert_allclose(matrix, matrix.T)


def test_a_vehicle_without_ballast_weighs_what_the_water_does_not_carry() -> None:
    body = Body(13.5, 0.0134, (0.26, 0.23, 0.37), 0.01, ballasted=False)
    net_weight, arm = body.restoring(1000.0)
    assert net_weight == pytest.approx(0.1 * 9.81)
    np.testing.assert_allclose(arm, [0, 0, 13.4 * 9.81 * 0.01])
    assert Body(13.5, 0.0134, (0.26, 0.23, 0.37), 0.01).restoring(1025.0)[0] == 0.0


def test_every_shipped_vehicle_loads_under_its_own_name() -> None:
    assert set(known_vehicles()) >= {"bluerov2", "bluerov2-heavy", "boat", "original-auv"}
    assert all(load_vehicle(name).name == name for name in known_vehicles())


@pytest.mark.parametrize("name", known_vehicles())
def test_every_shipped_vehicle_swims_ahead_at_the_speed_it_is_listed_with(name: str, tube: Scenario) -> None:
    vehicle = load_vehicle(name)
    listed = float(vehicle.summary().split(" m/s")[0].split()[-1])
    start = vehicle.state_at(Pose(np.array([10.0, 0.0, 0.0]), yaw_quaternion(0.0)))
    ahead = np.broadcast_to([0.0, 0.0, 1.0], (1, 1500, 3))
    state = Predictor(vehicle, 1000.0, 0.02, 5).predict(start[None], np.zeros(1), ahead, STILL).states[0, -1]
    assert np.linalg.norm(state[7:10]) == pytest.approx(listed, rel=0.01)  # the list has two digits


@pytest.mark.parametrize("name", known_vehicles())
def test_every_shipped_vehicle_repeats_its_dive_bit_for_bit_walls_included(name: str, tube: Scenario) -> None:
    dive, dives = Dive(tube, load_vehicle(name)), []
    for _ in range(2):
        rng = np.random.default_rng(3)
        dive.begin([10.0, 0.2, 0.0], yaw_quaternion(0.1))
        touched = [dive.step(*rng.uniform(-1, 1, 3)) for _ in range(150)]
        dives.append((dive.state, touched))
    dive.close()
    np.testing.assert_array_equal(dives[0][0], dives[1][0])
    assert dives[0][1] == dives[1][1]
    assert np.isfinite(dives[0][0]).all()
    assert np.hypot(*dives[0][0][1:3]) < 2.0  # inside the tube


def test_a_vehicle_of_ones_own_loads_from_its_path(tmp_path: Path) -> None:
    vehicle = load_vehicle(write(tmp_path, "mass = 11.5 ", "mass = 12 "))
    assert isinstance(vehicle, FossenVehicle)
    assert vehicle.body.mass == 12.0


def test_added_mass_may_be_a_matrix(tmp_path: Path) -> None:
    rows = np.diag([5.5, 12.7, 14.57, 0.12, 0.12, 0.12])
    rows[1, 5] = rows[5, 1] = 0.4
    text = f"added_mass_matrix = {rows.tolist()}"
    vehicle = load_vehicle(write(tmp_path, "added_mass = [5.5, 12.7, 14.57, 0.12, 0.12, 0.12]", text))
    assert isinstance(vehicle, FossenVehicle)
    assert vehicle.mass_matrix[1, 5] == vehicle.mass_matrix[5, 1] == 0.4
    np.testing.assert_allclose(vehicle.total_mass, load_vehicle("bluerov2").total_mass)


def test_unknown_name_suggests_the_closest() -> None:
    with pytest.raises(InputError, match=r"no vehicle 'bluerov'.*'bluerov2'"):
        load_vehicle("bluerov")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass = 11.5 ", "mass = -1.0 ", "body: mass must be positive, got -1"),
        ("inertia = [0.16, 0.16, 0.16]", "inertia = [0.16, 0.16]", "inertia must have 3 values, not 2"),
        ("inertia = [0.16, 0.16, 0.16]", "inertia = [0.16, 0.16, 0.4]", "inertia about z is 0.4, more than"),
        ("inertia = [0.16, 0.16, 0.16]", "inertia = [0.0, 0.16, 0.16]", "inertia must be positive, got 0"),
        ("volume = 0.0117", "volume = 0.117", "volume is 0.117 m^3, which displaces 117 kg"),
        ("linear_damping = [4.03", "linear_damping = [-4.03", "linear_damping must not be negative, got -4.03"),
        ("added_mass = [5.5", "added_mass = [-5.5", "water: added_mass must not be negative, got -5.5"),
        ("added_mass = [5.5, ", "added_mass = [", "added_mass must have 6 values, not 5"),
        ("added_mass = ", "# added_mass = ", "water: added_mass (6 values) or added_mass_matrix"),
        ("trim_rate", "trim_rates", "unknown key 'trim_rates'. Did you mean 'trim_rate'"),
        ("radius = 0.17", "radius = 0.0", "radius > 0"),
        ("mass = 11.5 ", "mass = nan ", "mass must be positive, got nan"),
        ("level_gain = 30.0", "", "lacks the key 'level_gain'"),
        ('name = "bluerov2"', 'name = "x"\nmodel = "fosen"', "model is 'fosen'. Did you mean 'fossen'"),
    ],
)
def test_senseless_values_are_refused_by_name(tmp_path: Path, old: str, new: str, message: str) -> None:

    with pytest.raises(InputError, match=re.escape(message)):
        load_vehicle(write(tmp_path, old, new))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("stabiliser = 0.2", "stabiliser = 1.2", "stabiliser must be at least 0 and below 1, got 1.2"),
        ("power = 250.0 ", "power = 800.0 ", "ballast: power must lie between min_power and max_power, got 800"),
        ("angular_drag = 0.8", "angular_drag = -0.8", "body: angular_drag must not be negative"),
        ("steer_moment = 450.0", "steer_moment = 0.0", "drive: steer_moment must be positive"),
        ("182.04]", "482.04]", "body: inertia about z is 482.04, more than"),
        ("floaters = [[0.4062, 0.291, 0.0]", "floaters = [[0.4062, 0.291]", "floaters[0] must have 3 values, not 2"),
    ],
)
def test_senseless_values_of_the_originals_body_are_refused(tmp_path: Path, old: str, new: str, message: str) -> None:

    with pytest.raises(InputError, match=re.escape(message)):
        load_vehicle(write(tmp_path, old, new, "original-auv"))


def test_a_message_on_thrusters_names_file_and_field(tmp_path: Path) -> None:
    path = write(tmp_path, "surge_force = 60.0", "surge_force = 90.0", "bluerov2-heavy")
    with pytest.raises(InputError, match=r"mine\.toml: thrusters cannot produce full ahead of 90"):
        load_vehicle(path)


@pytest.mark.parametrize(
    ("row", "column", "value", "message"),
    [(0, 1, 1.0, "must be symmetric, but row"), (0, 0, -5.5, "must be positive definite, but has the eigenvalue -5.5")],
)
def test_added_mass_that_gives_energy_away_is_refused(row: int, column: int, value: float, message: str) -> None:
    matrix = np.diag([5.5, 12.7, 14.57, 0.12, 0.12, 0.12])
    matrix[row, column] = value
    rows = tuple(tuple(line) for line in matrix.tolist())
    with pytest.raises(ValueError, match=message):
        WaterCoefficients((0.0,) * 6, (0.0,) * 6, added_mass_matrix=rows)  # type: ignore[arg-type]


def test_strong_coupling_can_make_positive_diagonals_indefinite() -> None:
    matrix = np.diag([5.0, 5.0, 5.0, 1.0, 1.0, 1.0])
    matrix[1, 5] = matrix[5, 1] = 3.0  # 5 * 1 < 3^2
    rows = tuple(tuple(line) for line in matrix.tolist())
    with pytest.raises(ValueError, match=r"positive definite, but has the eigenvalue -0\.6"):
        WaterCoefficients((0.0,) * 6, (0.0,) * 6, added_mass_matrix=rows)  # type: ignore[arg-type]
