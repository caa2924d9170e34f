"""A boat on waves against closed forms of naval architecture, for one box and for the catamaran that ships."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import WaveSettings
from aquanav_tools.sim.batch.boat_motion import OpenWater
from aquanav_tools.sim.boat import Boat, Hull, load_boat
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.sim.vehicle_base import GRAVITY
from aquanav_tools.sim.waves import wave_parameters
from aquanav_tools.sim.windage import Windage
from aquanav_tools.types import Array

DENSITY, DT = 1025.0, 0.02
LENGTH, BEAM, DRAUGHT = 4.0, 1.5, 0.25
MASS = DENSITY * LENGTH * BEAM * DRAUGHT
BOX = Boat(
    name="box",
    mass=MASS,
    inertia=(500.0, 2500.0, 2800.0),
    added_mass=(0.0, 0.0, 0.6 * MASS),
    added_inertia=(100.0, 500.0, 0.0),
    linear_damping=(0.0,) * 6,
    normal_drag=0.0,
    friction=0.0,
    surge_force=100.0,
    reverse_fraction=0.5,
    yaw_moment=50.0,
    hulls=(Hull(LENGTH, BEAM, 0.8, 0.0, (0.0, 0.0, 0.2)),),  # its bottom is 0.2 m below the centre of mass
)
FLAT, STILL, NO_WIND = np.zeros((0, 7)), np.zeros(3), np.zeros(2)


def sail(
    boat: Boat,
    state: Array,
    seconds: float,
    action: tuple[float, float] = (0.0, 0.0),
    current: Array = STILL,
    wave: Array = FLAT,
    wind: Array = NO_WIND,
) -> Array:
    """Return the (N, 13) states of a boat, steps of DT apart, steer and thrust held."""
    water = OpenWater(boat, DENSITY, DT)
    water.set_sea(wave, np.zeros(len(wave)))
    water.current, water.wind = current, wind
    return water.voyage(state, round(seconds / DT), *action)


def period(values: Array) -> float:
    """Return the mean time from one upward crossing of zero to the next, s."""
    before = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
    crossings = before + values[before] / (values[before] - values[before + 1])
    assert len(crossings) > 5
    return float(np.diff(crossings).mean() * DT)


def tilted(state: Array, axis: int, angle: float) -> Array:
    turned = state.copy()
    turned[3], turned[4 + axis] = np.cos(0.5 * angle), np.sin(0.5 * angle)
    return turned


@pytest.mark.parametrize("boat", [BOX, load_boat("otter")], ids=["box", "otter"])
def test_a_boat_at_its_static_draught_stays_where_it_is(boat: Boat) -> None:
    start = boat.state_at(np.zeros(2), 0.3, DENSITY)
    moved = sail(boat, start, 2.0)[-1]
    assert abs(moved[2] - start[2]) < 1e-9
    wrench = OpenWater(boat, DENSITY, DT).loads(start)[0]
    np.testing.assert_allclose(wrench[:3], [0.0, 0.0, boat.mass * GRAVITY], atol=1e-6)


def test_draught_is_that_of_archimedes() -> None:
    assert BOX.draught(DENSITY) == pytest.approx(DRAUGHT)


def test_heave_has_the_period_of_the_waterplane() -> None:
    start = BOX.state_at(np.zeros(2), 0.0, DENSITY)
    start[2] += 0.02
    heights = sail(BOX, start, 20.0)[:, 2] - start[2] + 0.02
    expected = 2.0 * np.pi / np.sqrt(DENSITY * GRAVITY * LENGTH * BEAM / (1.6 * MASS))
    assert period(heights) == pytest.approx(expected, rel=2e-3)  # of a step in a period of 1.3 s: (w dt)^2 / 24
    assert heights[-200:].max() == pytest.approx(0.02, rel=0.01)  # nothing takes energy, nothing adds any


@pytest.mark.parametrize(("axis", "width", "along"), [(0, BEAM, LENGTH), (1, LENGTH, BEAM)], ids=["roll", "pitch"])
def test_roll_and_pitch_have_the_period_of_the_metacentric_height(axis: int, width: float, along: float) -> None:
    start = tilted(BOX.state_at(np.zeros(2), 0.0, DENSITY), axis, 0.01)
    angles = 2.0 * sail(BOX, start, 25.0)[:, 4 + axis]
    centre = 0.2  # the centre of mass above the bottom
    height = 0.5 * DRAUGHT + width**3 * along / 12.0 / (LENGTH * BEAM * DRAUGHT) - centre
    inertia = BOX.inertia[axis] + BOX.added_inertia[axis]
    expected = 2.0 * np.pi / np.sqrt(MASS * GRAVITY * height / inertia)
    assert period(angles) == pytest.approx(expected, rel=5e-3)  # the step, and 0.01 rad is not nothing


def test_speed_ahead_is_where_thrust_meets_the_drag_of_bow_and_skin() -> None:
    boat = replace(BOX, normal_drag=1.0, friction=0.004, linear_damping=(0.0, 0.0, 3e3, 3e3, 9e3, 0.0))
    states = sail(boat, boat.state_at(np.zeros(2), 0.0, DENSITY), 120.0, (0.0, 0.3))
    wetted = LENGTH * BEAM + 2.0 * LENGTH * DRAUGHT
    expected = np.sqrt(2.0 * 30.0 / (DENSITY * (1.0 * BEAM * DRAUGHT + 0.004 * wetted)))
    assert states[-1, 7] == pytest.approx(expected, rel=0.01)  # thrust and drag trim it by some milliradians
    assert abs(states[-1, 7] - states[-500, 7]) < 1e-3


def test_the_otter_makes_its_six_knots_but_for_the_drag_of_its_skin_and_bows() -> None:
    otter = load_boat("otter")
    start = otter.state_at(np.zeros(2), 0.0, DENSITY)
    assert start[2] == pytest.approx(0.2, abs=0.005)  # the centre of mass above the water
    speed = sail(otter, start, 20.0, (0.0, 1.0))[-1, 7]
    assert 0.85 * 3.09 < speed < 3.09


def test_a_drifting_boat_takes_on_the_current() -> None:
    boat = replace(BOX, normal_drag=1.0, friction=0.1)
    current = np.array([0.4, -0.2, 0.0])
    states = sail(boat, boat.state_at(np.zeros(2), 0.0, DENSITY), 200.0, current=current)
    speed = (states[-1, :2] - states[-51, :2]) / 1.0
    np.testing.assert_allclose(speed, current[:2], atol=0.02)  # drag is quadratic, so the last of it fades slowly


def test_a_beam_wind_drives_a_boat_to_where_drag_of_air_and_water_meet() -> None:
    windage = Windage(front=0.0, side=3.0, length=LENGTH, height=10.0, arm=0.0, turning=0.0)
    boat = replace(BOX, normal_drag=1.0, linear_damping=(0.0, 0.0, 3e3, 3e3, 9e3, 1e3), windage=windage)
    states = sail(boat, boat.state_at(np.zeros(2), 0.0, DENSITY), 120.0, wind=np.array([0.0, 12.0]))
    # 1.225 * 0.9 * 3 (12 - v)^2 = 1025 * 1 * 4 * 0.25 v^2
    share = np.sqrt(1.225 * 0.9 * 3.0 / (DENSITY * LENGTH * DRAUGHT))
    assert (states[-1, 1] - states[-51, 1]) / 1.0 == pytest.approx(12.0 * share / (1.0 + share), rel=0.02)
    assert abs(states[-1, 1] - states[-51, 1]) > 0.5


def test_a_boat_left_to_the_wind_turns_broadside_to_it() -> None:
    windage = Windage(front=1.0, side=3.0, length=LENGTH, height=1.0, arm=0.0)
    boat = replace(BOX, normal_drag=1.0, linear_damping=(0.0, 0.0, 3e3, 3e3, 9e3, 300.0), windage=windage)
    start = boat.state_at(np.zeros(2), 0.3, DENSITY)  # the wind comes from ahead, 17 degrees off the bow
    states = sail(boat, start, 120.0, wind=np.array([-10.0, 0.0]))
    heading = 2.0 * np.arctan2(states[-1, 6], states[-1, 3])
    assert heading == pytest.approx(0.5 * np.pi, abs=0.05)
    assert states[-1, 0] < -10.0  # and drifts with it


def test_in_long_waves_a_boat_rises_with_the_surface_and_in_short_ones_less() -> None:
    boat = replace(BOX, linear_damping=(0.0, 0.0, 6e3, 2e3, 8e3, 0.0))
    shares = []
    for seconds in (10.0, 1.2):  # 156 m long and 2.2 m, which is about half the boat
        wave = wave_parameters(WaveSettings(height=0.1, period=seconds), 0.0)[None]
        heights = sail(boat, boat.state_at(np.zeros(2), 0.0, DENSITY), 6.0 * seconds + 10.0, wave=wave)[:, 2]
        settled = heights[-round(2.0 * seconds / DT) :]
        shares.append((settled.max() - settled.min()) / 0.1)
    assert shares[0] == pytest.approx(1.0, abs=0.05)
    assert shares[1] < 0.5


def test_the_world_turned_turns_the_way() -> None:
    boat, action = load_boat("otter"), (0.3, 0.5)
    one = sail(boat, boat.state_at(np.zeros(2), 0.0, DENSITY), 5.0, action)[-1]
    other = sail(boat, boat.state_at(np.zeros(2), 0.5 * np.pi, DENSITY), 5.0, action)[-1]
    np.testing.assert_allclose([other[1], -other[0], other[2]], one[:3], atol=1e-8)
    np.testing.assert_allclose(other[7:], one[7:], atol=1e-8)


def test_the_water_is_left_alone_by_a_boat_in_the_air() -> None:
    start = BOX.state_at(np.zeros(2), 0.0, DENSITY)
    start[2] += 1.0
    assert not OpenWater(BOX, DENSITY, DT).loads(start)[0].any()


def test_drives_push_and_turn_as_their_file_says() -> None:
    otter, at_rest = OpenWater(load_boat("otter"), DENSITY, DT), np.eye(1, 13, 3)[0]
    np.testing.assert_allclose(otter.loads(at_rest, 0.5, 1.0)[2], [239.0, 0.0, 0.0, 0.0, 0.0, 0.5 * 47.2])
    np.testing.assert_allclose(otter.loads(at_rest, -1.0, -0.5)[2], [-0.5 * 0.557 * 239.0, 0.0, 0.0, 0.0, 0.0, -47.2])
    vehicle = load_vehicle("boat")
    assert isinstance(vehicle, OriginalVehicle)
    force, moment = vehicle.drive.force, vehicle.drive.steer_moment
    original = OpenWater(vehicle, DENSITY, DT)
    expected = moment if vehicle.drive.steers_at_rest else 0.5 * moment
    np.testing.assert_allclose(original.loads(at_rest, 1.0, 0.5)[2][[0, 5]], [0.5 * force, expected])


def test_boats_that_make_no_sense_are_refused() -> None:
    with pytest.raises(InputError, match="Did you mean 'otter'"):
        load_boat("oter")
    with pytest.raises(ValueError, match="mass must be positive"):
        replace(BOX, mass=-1.0)
    with pytest.raises(ValueError, match="bow must be shorter"):
        Hull(2.0, 1.0, 1.0, 2.0)
