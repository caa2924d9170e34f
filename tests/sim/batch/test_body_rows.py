"""Bodies with parameters of their own, as rows of an array: each moves as it does alone."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pytest

from aquanav_tools.sim.batch.motion import Body, body_rows, make_body
from aquanav_tools.sim.batch.prediction import advance
from aquanav_tools.sim.batch.runtime import find_device
from aquanav_tools.sim.body_parameters import BodyParameters, DraggedBodyParameters, ThrusterParameters
from aquanav_tools.sim.thrusters import Thrusters
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array
from tests.sim.bodies import DT, LINEAR, MASS, QUADRATIC, STILL, coupled_mass, random_states

NUM = 5
QUAD = Thrusters(((0.1, 0.2, 0.0), (0.1, -0.2, 0.0)), ((1.0, 0.0, 0.0), (0.0, 0.0, 1.0)), 20.0, 15.0, 0.1)


def random_bodies(rng: np.random.Generator, mass: Array, has_thrusters: bool) -> BodyParameters:
    """NUM bodies that differ in everything."""
    thrusters = None
    if has_thrusters:
        one, strength = QUAD.parameters(), rng.uniform(0.0, 1.2, (NUM, 2))
        limits = one.max_reverse * strength, one.max_forward * strength
        wrenches = rng.uniform(0.8, 1.2, (NUM, 1, 1)) * one.wrenches
        thrusters = ThrusterParameters(wrenches, one.allocation, *limits, np.linspace(0.0, 0.3, NUM))
    return BodyParameters(
        mass=rng.uniform(0.8, 1.2, (NUM, 1, 1)) * mass,
        linear_damping=rng.uniform(0.5, 1.0, (NUM, 6)) * LINEAR,
        quadratic_damping=QUADRATIC,
        net_weight=rng.normal(size=NUM),
        arm=rng.normal(size=(NUM, 3)),
        rate_gain=rng.uniform(0.0, 2.0, (NUM, 3)),
        level_gain=rng.uniform(0.0, 2.0, NUM),
        thrusters=thrusters,
    )


def row_of(parameters: Any, n: int, dims: dict[str, int]) -> Any:
    """Row n of fields that have as many axes more than `dims` says; those without are all rows'."""
    found = {}
    for field in fields(parameters):
        value = getattr(parameters, field.name)
        if isinstance(value, ThrusterParameters):
            own = {"wrenches": 2, "allocation": 2, "max_reverse": 1, "max_forward": 1, "time_constant": 0}
            found[field.name] = row_of(value, n, own)
        elif value is not None and np.ndim(value) > dims[field.name]:
            found[field.name] = value[n]
    return replace(parameters, **found)


DIMS = {"mass": 2, "linear_damping": 1, "quadratic_damping": 1, "net_weight": 0, "arm": 1, "rate_gain": 1}
DIMS |= {"level_gain": 0, "thrusters": 0}
KINDS = pytest.mark.parametrize(
    ("mass", "has_thrusters"),
    [(np.diag(MASS), False), (coupled_mass(), False), (coupled_mass(), True)],
    ids=["diagonal", "coupled", "thrusters"],
)


@KINDS
def test_each_row_moves_as_the_same_body_alone_bit_for_bit(
    mass: Array, has_thrusters: bool, rng: np.random.Generator
) -> None:
    parameters = random_bodies(rng, mass, has_thrusters)
    states, wrenches = random_states(rng, NUM), 5.0 * rng.normal(size=(NUM, 30, 6))
    states = np.concatenate([states, np.zeros((NUM, 2 if has_thrusters else 0))], axis=1)
    together = advance(states, wrenches, STILL, parameters, DT, 30)
    for n in range(NUM):
        alone = advance(states[n : n + 1], wrenches[n : n + 1], STILL, row_of(parameters, n, DIMS), DT, 30)
        np.testing.assert_array_equal(together[n], alone[0])
    assert np.ptp(together[:, -1, :3], axis=0).min() > 0.01


@KINDS
def test_a_row_holds_what_a_single_body_holds(mass: Array, has_thrusters: bool, rng: np.random.Generator) -> None:
    device, parameters = find_device("cpu"), random_bodies(rng, mass, has_thrusters)
    made = body_rows(parameters, DT, device)
    for n in range(NUM):
        single = make_body(row_of(parameters, n, DIMS), DT, device)
        for name in set(Body.vars) - {"matrix", "thrusters"}:
            np.testing.assert_array_equal(made.rows[name][n], np.array(getattr(single, name)))
        np.testing.assert_array_equal(made.matrices.numpy()[n], single.matrix.numpy())
        np.testing.assert_array_equal(made.thrusters.numpy()[n], single.thrusters.numpy())


def test_each_of_the_originals_bodies_moves_as_alone_bit_for_bit(rng: np.random.Generator) -> None:
    vehicle = load_vehicle("original-auv")
    one = vehicle.motion_parameters(1000.0)
    assert isinstance(one, DraggedBodyParameters)
    parameters = replace(
        one,
        mass=one.mass * rng.uniform(0.9, 1.1, NUM),
        inertia=one.inertia * rng.uniform(0.9, 1.1, (NUM, 1)),
        angular_drag=one.angular_drag * rng.uniform(0.5, 1.0, NUM),
        centre_of_mass=one.centre_of_mass + 0.02 * rng.normal(size=(NUM, 3)),
        floaters=one.floaters + 0.02 * rng.normal(size=(NUM, *one.floaters.shape)),
    )
    dims = {"mass": 0, "inertia": 1, "linear_drag": 0, "angular_drag": 0, "max_turn_rate": 0, "centre_of_mass": 1}
    dims |= {"stabiliser_rate": 0, "floaters": 2, "is_afloat": 0}
    states = np.concatenate([random_states(rng, NUM), np.full((NUM, 1), 19.62)], axis=1)
    wrenches = np.array([1000.0, 0.0, 250.0, 0.0, 0.0, 100.0]) * rng.uniform(0.5, 1.0, (NUM, 30, 6))
    together = advance(states, wrenches, STILL, parameters, DT, 30)
    for n in range(NUM):
        alone = advance(states[n : n + 1], wrenches[n : n + 1], STILL, row_of(parameters, n, dims), DT, 30)
        np.testing.assert_array_equal(together[n], alone[0])
        other = advance(states[n : n + 1], wrenches[n : n + 1], STILL, one, DT, 30)
        assert np.abs(alone[0, -1, :13] - other[0, -1, :13]).max() > 1e-3


def test_one_impossible_body_among_many_is_refused(rng: np.random.Generator) -> None:
    masses = np.tile(np.diag(MASS), (NUM, 1, 1))
    masses[3, 2, 2] = -1.0
    with pytest.raises(ValueError, match="Masses must be positive"):
        BodyParameters(masses, LINEAR, QUADRATIC)
