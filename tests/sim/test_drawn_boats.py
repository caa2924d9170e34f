"""Boats with drawn dynamics: each is the boat whose file says so, floats as Archimedes has it, and repeats."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.envs.boat_batch import BoatBatch
from aquanav_tools.envs.surface_env import SurfaceEnv
from aquanav_tools.envs.surface_task import boat_of
from aquanav_tools.envs.vector_env import SurfaceVectorEnv
from aquanav_tools.errors import InputError
from aquanav_tools.sea.generate import MapSettings
from aquanav_tools.sim.boat import DENSITY, Boat, load_boat
from aquanav_tools.sim.original import OriginalVehicle
from aquanav_tools.sim.randomisation import AFLOAT, FLOATING, SENSED, read_randomisation
from aquanav_tools.types import Array
from tests.envs.test_surface_env import bay_with, block

SMALL = MapSettings(length=70.0, width=40.0, boat_width=1.1)
STATE = ("positions", "orientations", "velocities")


def written(ranges: str, folder: Path) -> str:
    """Return the file of some ranges."""
    path = folder / "ranges.toml"
    path.write_text(ranges)
    return str(path)


def states(decisions: int = 40, bay: Any = None, **options: Any) -> Array:
    """Return the (D, 13) states of a boat that goes ahead and turns, in a breeze."""
    batch = BoatBatch(bay_with() if bay is None else bay, 1, next_step=True, sea="breeze", **options)
    batch.reset([5])
    rows = []
    for n in range(decisions):
        batch.command([[n // 10 % 3, 2 if n < 25 else 0]])
        batch.step()
        rows.append(np.concatenate([batch.copy_of(name)[0] for name in STATE]))
    return np.array(rows)


def times(factor: float, values: tuple[float, ...]) -> Any:
    return tuple(factor * value for value in values)


OTTER = load_boat("otter")
FACTORS: dict[str, tuple[float, dict[str, Any]]] = {
    "mass": (1.3, {"mass": 1.3 * OTTER.mass}),
    "inertia": (0.8, {"inertia": times(0.8, OTTER.inertia)}),
    "added_mass": (
        0.6,
        {"added_mass": times(0.6, OTTER.added_mass), "added_inertia": times(0.6, OTTER.added_inertia)},
    ),
    "linear_damping": (1.4, {"linear_damping": times(1.4, OTTER.linear_damping)}),
    "quadratic_damping": (0.5, {"normal_drag": 0.5 * OTTER.normal_drag, "friction": 0.5 * OTTER.friction}),
    "thrust": (1.2, {"surge_force": 1.2 * OTTER.surge_force, "yaw_moment": 1.2 * OTTER.yaw_moment}),
    "reverse": (0.7, {"reverse_fraction": 0.7 * OTTER.reverse_fraction}),
}


@pytest.mark.parametrize("name", FACTORS)
@pytest.mark.parametrize("place", ["open water", "a rock ahead"])
def test_a_drawn_boat_moves_as_one_whose_file_says_so(name: str, place: str, tmp_path: Path) -> None:
    """Also where it is pushed off a rock."""
    bay = bay_with(*([] if place == "open water" else [block(-38.6, 3.0, 20.0)]))
    factor, fields = FACTORS[name]
    ranges = written(f"{name} = [{factor}, {factor}]\n", tmp_path)
    drawn, file = states(bay=bay, randomisation=ranges), states(bay=bay, vehicle=dataclasses.replace(OTTER, **fields))
    np.testing.assert_allclose(drawn, file, atol=1e-12)
    assert np.abs(drawn - states(bay=bay)).max() > 1e-3


@pytest.mark.parametrize(
    ("name", "part", "fields"),
    [
        ("mass", "body", ("mass",)),
        ("inertia", "body", ("inertia",)),
        ("linear_damping", "body", ("linear_drag",)),
        ("quadratic_damping", "body", ("angular_drag",)),
        ("thrust", "drive", ("force", "steer_moment")),
        ("reverse", "drive", ("reverse_fraction",)),
    ],
)
def test_so_does_the_originals_boat(name: str, part: str, fields: tuple[str, ...], tmp_path: Path) -> None:
    boat = boat_of("boat")
    assert isinstance(boat, OriginalVehicle)
    before = getattr(boat, part)
    values = {field: (np.array(getattr(before, field)) * 0.8).tolist() for field in fields}
    values = {field: tuple(value) if isinstance(value, list) else value for field, value in values.items()}
    other = dataclasses.replace(boat, **{part: dataclasses.replace(before, **values)})
    drawn = states(vehicle="boat", randomisation=written(f"{name} = [0.8, 0.8]\n", tmp_path))
    np.testing.assert_allclose(drawn, states(vehicle=other), atol=1e-12)
    assert np.abs(drawn - states(vehicle="boat")).max() > 1e-3


@pytest.mark.parametrize("vehicle", ["otter", "boat"])
def test_ranges_that_draw_nothing_leave_the_boat_as_its_file_has_it(vehicle: str, tmp_path: Path) -> None:
    ranges = written("lag = [0.5, 2.0]\nvolume = [0.9, 1.1]\nweak_thruster = 1.0\n", tmp_path)
    env = SurfaceEnv(bay_with(), vehicle=vehicle, randomisation=ranges)
    assert not [key for key in env.reset(seed=0)[1] if key.startswith("dynamics/")], "boats have none of these"
    np.testing.assert_array_equal(states(vehicle=vehicle, randomisation=ranges), states(vehicle=vehicle))


@pytest.mark.parametrize(("ranges", "mass"), [("mass = [1.5, 1.5]", 82.5), ("payload = [20.0, 20.0]", 75.0)])
def test_a_heavier_boat_begins_and_stays_where_archimedes_has_it(ranges: str, mass: float, tmp_path: Path) -> None:
    """Two hulls of three quarters of 2 m x 0.25 m displace it; the centre of mass is 0.27 m above their bottom."""
    env = SurfaceEnv(bay_with(), sea="still", randomisation=written(ranges, tmp_path))
    begun = env.reset(seed=0)[1]["position"][2]
    draught = mass / (DENSITY * 2 * 0.75 * 2.0 * 0.25)
    assert begun == pytest.approx(0.27 - draught, abs=1e-9)
    for _ in range(50):
        info = env.step([1, 1])[4]
    assert info["position"][2] == pytest.approx(begun, abs=1e-6)
    assert info["orientation"] == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-6)


@pytest.mark.parametrize(("axis", "offset"), [("x", 0.01), ("y", -0.01)])
def test_an_offset_of_the_centre_of_mass_trims_and_heels_by_the_metacentric_height(
    axis: str, offset: float, tmp_path: Path
) -> None:
    """A block of L x B, whose metacentre is B^2 / 12 T (or L^2 / 12 T) above its centre of buoyancy."""
    from tests.sim.test_afloat import BEAM, BOX, DRAUGHT, LENGTH

    boat = dataclasses.replace(BOX, linear_damping=(0.0, 0.0, 6e3, 4e3, 1e4, 0.0))
    env = SurfaceEnv(
        bay_with(), sea="still", vehicle=boat,
        randomisation=written(f"centre_of_mass_{axis} = [{offset}, {offset}]\n", tmp_path),
    )  # fmt: skip
    env.reset(seed=0)
    for _ in range(400):
        info = env.step([1, 1])[4]
    w, x, y, z = info["orientation"]
    bow_up, left_up = 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)
    width = LENGTH if axis == "x" else BEAM
    height = 0.5 * DRAUGHT + width**2 / (12.0 * DRAUGHT) - 0.2  # the centre of mass is 0.2 m above the bottom
    sunk = bow_up if axis == "x" else left_up
    assert np.tan(np.arcsin(-sunk)) == pytest.approx(offset / height, rel=0.01)
    assert abs(left_up if axis == "x" else bow_up) < 1e-6


@pytest.mark.parametrize("gain", [0.9, 1.2])
def test_beams_read_their_gain_and_bias(gain: float, tmp_path: Path) -> None:
    """At most the beam's length."""
    ranges = written(f"ray_gain = [{gain}, {gain}]\nray_bias = [0.5, 0.5]", tmp_path)
    observation, info = SurfaceEnv(bay_with(block(-25.0, 3.0, 25.0)), sea="still", randomisation=ranges).reset(seed=0)
    assert (info["rays"] < 30.0).all() and np.ptp(info["rays"]) > 10.0
    np.testing.assert_allclose(30.0 * observation[:7], np.minimum(gain * info["rays"] + 0.5, 30.0), atol=1e-4)


def test_delays_are_drawn_for_each_episode(tmp_path: Path) -> None:
    """A late boat lies still for as many decisions, and sees what another saw so long ago."""
    ranges = written("action_delay = [0, 2]\nobservation_delay = [0, 3]\n", tmp_path)
    envs = SurfaceVectorEnv(60, bay_with(), sea="still", randomisation=ranges)
    seen, infos = envs.reset(seed=0)
    acts, sees = (infos[f"dynamics/{kind}_delay"].astype(int) for kind in ("action", "observation"))
    assert set(acts) == {0, 1, 2} and set(sees) == {0, 1, 2, 3}
    thrust, speeds = [seen[:, 15]], [infos["velocity"][:, 0]]
    for _ in range(6):
        seen, *_, infos = envs.step(np.tile([1, 2], (60, 1)))
        thrust.append(seen[:, 15])
        speeds.append(infos["velocity"][:, 0])
    assert np.array_equal(np.argmax(np.array(thrust) > 0.0, axis=0), 1 + sees)
    assert np.array_equal(np.argmax(np.array(speeds) > 0.01, axis=0), 1 + acts)


@pytest.mark.parametrize("num", [1, 7, 256])
@pytest.mark.parametrize("vehicle", ["otter", "boat"])
def test_a_boat_has_the_dynamics_that_it_has_alone(num: int, vehicle: str, rng: np.random.Generator) -> None:
    """To the bit, over several episodes, in what info tells of them, and against a rock."""
    bay = bay_with(block(-38.8, 3.0, 20.0))
    options: dict[str, Any] = {"randomisation": "wide", "vehicle": vehicle, "sea": "breeze", "bay": bay}
    options["max_decisions"] = 7
    seeds, chosen = rng.integers(1 << 32, size=num).tolist(), rng.permutation(num)[:2]
    together = SurfaceVectorEnv(num, num_threads=2, **options)
    alone = [SurfaceVectorEnv(1, num_threads=1, **options) for _ in chosen]
    one = SurfaceEnv(**options)
    together.reset(seed=seeds)
    for env, n in zip(alone, chosen, strict=True):
        env.reset(seed=[seeds[n]])
    one.reset(seed=seeds[chosen[0]])
    drawn, touched = set(), 0
    for _ in range(24):
        actions = np.stack([rng.integers(0, 3, num), np.minimum(rng.integers(1, 5, num), 2)], axis=1)
        *rows, infos = together.step(actions)
        for env, n in zip(alone, chosen, strict=True):
            *own, info = env.step(actions[n : n + 1])
            for whole, part in zip(rows, own, strict=True):
                np.testing.assert_array_equal(np.asarray(whole)[n], np.asarray(part)[0])
            for name in info:
                np.testing.assert_array_equal(infos[name][n], info[name][0], name)
            drawn.add(float(info["dynamics/mass"][0]))
            touched += int(info["collision"][0])
        if one.info["outcome"] == "running":
            seen, reward, *_, last = one.step(actions[chosen[0]])
            np.testing.assert_array_equal(rows[0][chosen[0]], seen)
            assert (reward, last["dynamics/thrust"]) == (rows[1][chosen[0]], infos["dynamics/thrust"][chosen[0]])
    assert len(drawn) >= 3 and touched > 0
    for env in (together, *alone):
        env.close()


def test_numbers_are_drawn_evenly_from_their_ranges_and_anew_for_each_episode() -> None:
    num = 2000
    batch = BoatBatch(7, num, next_step=True, sea="still", randomisation="wide", observation="paper")
    batch.reset(list(range(num)))
    first = {name: values.copy() for name, values in batch.dynamics.items()}
    ranges = read_randomisation("wide").ranges
    assert set(first) == set(FLOATING) and set(SENSED) < set(AFLOAT) < set(FLOATING)
    for name in set(first) - {"action_delay", "observation_delay"}:
        low, high = ranges[name]
        values = (first[name] - low) / (high - low)
        assert 0.0 <= values.min() < 0.01 and 0.99 < values.max() <= 1.0, name
        assert values.mean() == pytest.approx(0.5, abs=5 * 0.289 / np.sqrt(num)), name
    batch.reset(list(range(num, 2 * num)))
    assert (batch.dynamics["mass"] != first["mass"]).all()


def test_a_batch_of_drawn_boats_goes_back_to_where_it_was(rng: np.random.Generator) -> None:
    one, other = (
        BoatBatch(SMALL, 5, next_step=False, max_decisions=9, sea="breeze", randomisation="wide") for _ in range(2)
    )
    one.reset([1, 2, 3, 4, 5])
    actions = rng.integers(0, 3, (30, 5, 2))
    for n in range(13):
        one.command(actions[n])
        one.step()
    other.restore(one.state())
    for n in range(13, 30):
        for each in (one, other):
            each.command(actions[n])
            each.step()
        for name in ("observations", "positions", "rewards"):
            np.testing.assert_array_equal(one.copy_of(name), other.copy_of(name))
        for name, values in one.dynamics.items():
            np.testing.assert_array_equal(values, other.dynamics[name])


def test_a_boat_that_would_sink_or_topple_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"the boat otter weighs up to 385 kg, and its hulls carry 308 kg\. Lower"):
        SurfaceEnv(randomisation=written("mass = [1.0, 7.0]", tmp_path))
    with pytest.raises(InputError, match=r"the hull ends 1\.00 m from its middle"):
        SurfaceEnv(randomisation=written("centre_of_mass_y = [0.0, 3.0]", tmp_path))
    with pytest.raises(InputError, match=r"no randomisation 'wild'.*Known are late, mild, wide"):
        SurfaceEnv(randomisation="wild")


def test_hulls_carry_their_outline_times_their_height() -> None:
    from tests.sim.test_afloat import BEAM, BOX, LENGTH

    assert BOX.volume == pytest.approx(LENGTH * BEAM * 0.8)
    assert isinstance(OTTER, Boat) and OTTER.volume == pytest.approx(2 * 0.75 * 2.0 * 0.25 * 0.4)
