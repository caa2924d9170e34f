"""Drawn dynamics: a body with what was drawn is the body whose file says so, and draws depend on the seed alone."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.envs.vector_env import CaveVectorEnv
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.fossen import FossenVehicle
from aquanav_tools.sim.randomisation import Randomisation, read_randomisation
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array
from tests.sim.batch.worlds import make_world
from tests.sim.test_water import flowing

AHEAD = np.array([0.3, 0.4, 1.0])


def fossen(name: str = "bluerov2") -> FossenVehicle:
    vehicle = load_vehicle(name)
    assert isinstance(vehicle, FossenVehicle)
    return vehicle


def swim(tube: Scenario, vehicle: Any, ranges: Randomisation | None = None, num: int = 1) -> tuple[Any, Array]:
    """Return a world after 1.5 s of thrust, steering and ballast, and its (N, 13) states."""
    world = make_world(tube, vehicle, num, randomisation=ranges)
    for _ in range(15):
        world.as_numpy("commands")[:] = AHEAD
        world.step()
    names = ("positions", "orientations", "velocities")
    return world, np.concatenate([world.as_numpy(name) for name in names], axis=1)


def written(vehicle: FossenVehicle, **drawn: float) -> FossenVehicle:
    """Return the vehicle whose file says what was drawn."""
    body, water, actuators = vehicle.body, vehicle.water, vehicle.actuators
    inertia = tuple(drawn.get("inertia", 1.0) * value for value in body.inertia)
    body = dataclasses.replace(body, mass=drawn.get("mass", 1.0) * body.mass, inertia=inertia, ballasted=True)
    factors = {name: drawn.get(name, 1.0) for name in ("added_mass", "linear_damping", "quadratic_damping")}
    scaled = {name: tuple(factor * value for value in getattr(water, name)) for name, factor in factors.items()}
    actuators = dataclasses.replace(actuators, surge_force=drawn.get("thrust", 1.0) * actuators.surge_force)
    return dataclasses.replace(vehicle, body=body, water=dataclasses.replace(water, **scaled), actuators=actuators)


@pytest.mark.parametrize(
    "drawn",
    [
        {"mass": 1.1, "inertia": 0.9},
        {"added_mass": 0.6},
        {"linear_damping": 0.5, "quadratic_damping": 1.4},
    ],
)
@pytest.mark.parametrize("name", ["bluerov2", "bluerov2-heavy"])
def test_a_drawn_body_moves_as_one_whose_file_says_so(tube: Scenario, name: str, drawn: dict[str, float]) -> None:
    ranges = Randomisation(**{key: (value, value) for key, value in drawn.items()})  # type: ignore[arg-type]
    _, states = swim(tube, fossen(name), ranges)
    _, expected = swim(tube, written(fossen(name), **drawn))
    _, nominal = swim(tube, fossen(name))
    np.testing.assert_allclose(states, expected, atol=1e-12)
    assert np.abs(states - nominal).max() > 1e-3


@pytest.mark.parametrize("name", ["bluerov2", "bluerov2-heavy", "original-auv"])
def test_ranges_that_draw_nothing_leave_the_vehicle_as_its_file_has_it(tube: Scenario, name: str) -> None:
    _, states = swim(tube, load_vehicle(name), Randomisation())
    _, expected = swim(tube, load_vehicle(name))
    np.testing.assert_array_equal(states, expected)


def test_thrust_and_net_buoyancy_are_forces_over_mass(tube: Scenario) -> None:
    """After one short step from rest, before drag counts, speed is force times time by mass."""
    vehicle = fossen()
    quick = dataclasses.replace(tube.settings.limits, dt=1e-4, substeps=1)
    short = dataclasses.replace(tube, settings=dataclasses.replace(tube.settings, limits=quick))
    world = make_world(short, vehicle, 1, randomisation=Randomisation(thrust=(1.2, 1.2), net_buoyancy=(0.25, 0.25)))
    world.as_numpy("commands")[:] = [0.0, 0.0, 1.0]
    world.step()
    surge, _, heave, *_ = world.as_numpy("velocities")[0]
    mass = vehicle.total_mass
    assert surge == pytest.approx(1.2 * vehicle.actuators.surge_force / mass[0] * 1e-4, rel=1e-3)
    assert heave == pytest.approx(0.25 * vehicle.actuators.heave_force / mass[2] * 1e-4, rel=1e-3)


def test_a_centre_of_mass_ahead_lets_the_nose_sink_until_buoyancys_arm_balances_it(tube: Scenario) -> None:
    base = fossen()
    drifting = dataclasses.replace(base, autopilot=dataclasses.replace(base.autopilot, level_gain=0.0))
    world = make_world(tube, drifting, 1, randomisation=Randomisation(centre_of_mass_x=(0.004, 0.004)))
    for _ in range(600):
        world.as_numpy("commands")[:] = 0.0
        world.step()
    w, x, y, z = world.as_numpy("orientations")[0]
    nose_up = 2.0 * (x * z - w * y)  # sine of how far the nose points up
    assert np.arcsin(-nose_up) == pytest.approx(np.arctan(0.004 / drifting.body.buoyancy_height), rel=0.02)


def test_a_dead_thruster_is_one_of_them_and_the_others_push_on(tube: Scenario) -> None:
    ranges = Randomisation(weak_thruster=1.0, weak_thruster_gain=(0.0, 0.0))
    vehicle, num = fossen("bluerov2-heavy"), 4000
    world = make_world(tube, vehicle, num, randomisation=ranges)
    which = world.dynamics["weak_thruster"].astype(int)
    wrenches = world._drawn_crafts._thrusters.numpy()["wrench"]  # type: ignore[union-attr]
    dead = np.abs(wrenches).max(axis=2) == 0.0
    assert (dead.sum(axis=1) == 1).all()
    np.testing.assert_array_equal(dead.argmax(axis=1) + 1, which)
    counts = np.bincount(which, minlength=9)[1:]
    expected = num / 8
    assert ((counts - expected) ** 2 / expected).sum() < 29.9  # chi-square with 7 degrees of freedom, p = 1e-4


def test_numbers_are_drawn_evenly_from_their_ranges_and_anew_for_each_episode(tube: Scenario) -> None:
    num = 4000
    world = make_world(tube, fossen(), num, randomisation=read_randomisation("wide"))
    first = {name: values.copy() for name, values in world.dynamics.items()}
    for name, (low, high) in read_randomisation("wide").ranges.items():
        if name in first and not name.endswith("delay"):
            values = (first[name] - low) / (high - low)
            assert 0.0 <= values.min() < 0.01 and 0.99 < values.max() <= 1.0, name
            assert values.mean() == pytest.approx(0.5, abs=5 * 0.289 / np.sqrt(num)), name
    relation = np.corrcoef(np.array([first["mass"], first["inertia"], first["thrust"], first["ray_bias"]]))
    assert np.abs(relation - np.eye(4)).max() < 0.08
    assert set(np.unique(first["action_delay"])) == {0.0, 1.0}
    world.reset(np.arange(num) + num)
    assert (world.dynamics["mass"] != first["mass"]).all()


@pytest.mark.parametrize("vehicle", ["bluerov2-heavy", "original-auv"])
def test_episodes_that_end_out_of_turn_have_the_bodies_of_their_seeds(
    tube: Scenario, vehicle: str, rng: np.random.Generator
) -> None:
    """They are drawn ahead; a world that begins with these seeds draws them all at once."""
    num, chosen = 6, load_vehicle(vehicle)
    ranges = read_randomisation("wide")
    world, other = (make_world(tube, chosen, num, randomisation=ranges) for _ in range(2))
    for turn in range(12):
        has_ended, last = rng.random(num) < 0.4, world.dynamics["mass"].copy()
        if turn == 8:
            has_ended[:] = True
            world.reset(rng.integers(1 << 32, size=num))  # not what was drawn ahead
        else:
            world.as_numpy("outcomes")[has_ended] = 1
            world.step()
        np.testing.assert_array_equal(world.dynamics["mass"] != last, has_ended)
        other.reset(world.as_numpy("seeds").view(np.uint32))
        for name, values in world.dynamics.items():
            np.testing.assert_array_equal(values, other.dynamics[name], err_msg=name)
        for name in ("ray_gain", "ray_bias", "action_delays", "observation_delays"):
            np.testing.assert_array_equal(world.as_numpy(name), other.as_numpy(name), err_msg=name)
        a, b = (one._drawn_crafts for one in (world, other))
        assert a is not None and b is not None
        for part in ("dragged", "controls", "hull"):
            for name in a.array.numpy()[part].dtype.names:
                if name != "floaters":
                    np.testing.assert_array_equal(a.array.numpy()[part][name], b.array.numpy()[part][name])
        np.testing.assert_array_equal(a.array.numpy()["body"]["arm"], b.array.numpy()["body"]["arm"])
        np.testing.assert_array_equal(a._matrices.numpy(), b._matrices.numpy())
        np.testing.assert_array_equal(a._thrusters.numpy()["wrench"], b._thrusters.numpy()["wrench"])


@pytest.mark.parametrize("num", [1, 7, 1024])
@pytest.mark.parametrize("vehicle", ["bluerov2", "bluerov2-heavy", "original-auv"])
def test_a_vehicle_has_the_dynamics_that_it_has_alone(num: int, vehicle: str, rng: np.random.Generator) -> None:
    """To the bit, over several episodes, and in what info tells of them."""
    options: dict[str, Any] = {"randomisation": "wide", "vehicle": vehicle, "current": "half", "max_decisions": 7}
    seeds, chosen = rng.integers(1 << 32, size=num).tolist(), rng.permutation(num)[:2]
    together = CaveVectorEnv(num, flowing(), num_threads=2, **options)
    alone = [CaveEnv(flowing(), contacts="own", rays="field", **options) for _ in chosen]
    together.reset(seed=seeds)
    for env, n in zip(alone, chosen, strict=True):
        env.reset(seed=seeds[n])
    drawn = set()
    for _ in range(20):
        actions = rng.integers(0, 3, (num, 3))
        *rows, infos = together.step(actions)
        for env, n in zip(alone, chosen, strict=True):
            *own, info = env.step(actions[n])
            for whole, part in zip(rows, own, strict=True):
                np.testing.assert_array_equal(whole[n], part)
            assert infos["dynamics/mass"][n] == info["dynamics/mass"]
            drawn.add(info["dynamics/mass"])
    assert len(drawn) >= 3
    for each in (together, *alone):
        each.close()


def test_rays_read_their_gain_and_bias(tube: Scenario) -> None:
    plain, biased = (
        make_world(tube, fossen(), 1, randomisation=ranges)
        for ranges in (None, Randomisation(ray_gain=(0.9, 0.9), ray_bias=(0.05, 0.05)))
    )
    lengths, (true,) = plain._settings.fan.lengths.numpy(), plain.as_numpy("rays")
    seen = biased.as_numpy("observations")[0, : len(lengths)] * lengths
    expected = np.where(true < lengths, np.clip(0.9 * true + 0.05, 0.0, lengths), lengths)
    assert (true < lengths).any()
    np.testing.assert_allclose(seen, expected, atol=1e-5)


@pytest.mark.parametrize(
    ("ranges", "message"),
    [
        ({"mass": (0.0, 1.0)}, "mass of the randomisation is 0 to 1; a factor is more than 0"),
        ({"inertia": (1.2, 0.8)}, "inertia of the randomisation is 1.2 to 0.8; a range rises"),
        ({"quadratic_damping": (float("nan"), 1.0)}, "a range rises"),
        ({"payload": (-1.0, 1.0)}, "no load weighs less than nothing"),
        ({"net_buoyancy": (-2.0, 0.0)}, "ballast cannot hold the vehicle"),
        ({"weak_thruster": 1.5}, "weak_thruster is 1.5; it is a probability"),
        ({"weak_thruster_gain": (0.0, 2.0)}, "has 0 to 1 of its force"),
        ({"action_delay": (0, 1000)}, "a delay is 0 to 100 decisions"),
    ],
)
def test_ranges_that_make_no_sense_are_refused(ranges: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError) as error:
        Randomisation(**ranges)
    assert message in str(error.value)


def test_a_centre_of_mass_outside_of_the_hull_is_refused(tube: Scenario, tmp_path: Path) -> None:
    file = tmp_path / "far.toml"
    file.write_text("centre_of_mass_x = [-20.0, 20.0]\n")
    with pytest.raises(InputError, match=r"the hull ends 0\.\d+ m from its middle"):
        CaveEnv(tube, randomisation=str(file))


def test_ranges_extend_those_that_ship(tmp_path: Path) -> None:
    mild, late = read_randomisation("mild"), read_randomisation("late")
    assert late == dataclasses.replace(mild, action_delay=(0, 1))
    (tmp_path / "own.toml").write_text('extends = "mild"\nmass = [0.5, 0.6]\n')
    assert read_randomisation(tmp_path / "own.toml") == dataclasses.replace(mild, mass=(0.5, 0.6))
    (tmp_path / "own.toml").write_text('extends = "wild"\n')
    with pytest.raises(InputError, match=r"own.toml extends 'wild', and .* ship: late, mild, wide"):
        read_randomisation(tmp_path / "own.toml")


def test_an_unknown_name_or_key_is_told_with_the_nearest(tube: Scenario, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"no randomisation 'wild'.*Known are late, mild, wide"):
        CaveEnv(tube, randomisation="wild")
    file = tmp_path / "own.toml"
    file.write_text("mas = [0.9, 1.1]\n")
    with pytest.raises(InputError, match="Did you mean 'mass'"):
        CaveEnv(tube, randomisation=str(file))
