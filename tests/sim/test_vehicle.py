from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.sim.vehicle import VEHICLE_DIR, known_vehicles, load_vehicle

BLUEROV2 = (VEHICLE_DIR / "bluerov2.toml").read_text()


def write(folder: Path, old: str, new: str) -> Path:
    """The BlueROV2's file with one piece of text replaced."""
    assert old in BLUEROV2
    path = folder / "mine.toml"
    path.write_text(BLUEROV2.replace(old, new))
    return path


def test_bluerov2_has_the_size_of_the_standard_frame() -> None:
    capsule = load_vehicle("bluerov2").capsule
    assert capsule.length == pytest.approx(0.457)
    assert capsule.radius == pytest.approx(0.338 / 2, abs=0.005)


def test_total_mass_adds_what_the_water_adds() -> None:
    # Wu (2018): 11.5 kg and 0.16 kg m^2, and the added mass of table 5.2.
    expected = [11.5 + 5.5, 11.5 + 12.7, 11.5 + 14.57, 0.28, 0.28, 0.28]
    np.testing.assert_allclose(load_vehicle("bluerov2").total_mass, expected)


def test_every_shipped_vehicle_loads_under_its_own_name() -> None:
    assert "bluerov2" in known_vehicles()
    assert all(load_vehicle(name).name == name for name in known_vehicles())


def test_a_vehicle_of_ones_own_loads_from_its_path(tmp_path: Path) -> None:
    assert load_vehicle(write(tmp_path, "mass = 11.5 ", "mass = 13 ")).body.mass == 13.0


def test_unknown_name_suggests_the_closest() -> None:
    with pytest.raises(InputError, match=r"no vehicle 'bluerov'.*'bluerov2'"):
        load_vehicle("bluerov")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("mass = 11.5 ", "mass = -1.0 ", "body: mass must be positive, got -1"),
        ("inertia = [0.16, 0.16, 0.16]", "inertia = [0.16, 0.16]", "inertia must have 3 values, not 2"),
        ("linear_damping = [4.03", "linear_damping = [-4.03", "linear_damping must not be negative, got -4.03"),
        ("trim_rate", "trim_rates", "unknown key 'trim_rates'. Did you mean 'trim_rate'"),
        ("radius = 0.17", "radius = 0.0", "radius > 0"),
        ("mass = 11.5 ", "mass = nan ", "mass must be positive, got nan"),
        ("level_gain = 30.0", "", "lacks the key 'level_gain'"),
    ],
)
def test_senseless_values_are_refused_by_name(tmp_path: Path, old: str, new: str, message: str) -> None:
    with pytest.raises(InputError, match=message.replace(".", r"\.")):
        load_vehicle(write(tmp_path, old, new))
