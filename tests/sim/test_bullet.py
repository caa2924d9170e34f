"""What the wall does to a vehicle: by PyBullet, and by our own contacts, which are held to the same."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest
import trimesh

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array, Mesh, rotation_matrix, yaw_quaternion
from tests.bullet import ENGINES, needs_bullet
from tests.caves import TUBE_RADIUS
from tests.sim.batch.worlds import Dive

VEHICLE = load_vehicle("bluerov2")
IDLE, AHEAD = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
LEVEL = yaw_quaternion(0.0)
EVERYWHERE = 1e6
"""Reach, m, with which Bullet is asked at every step."""


@pytest.fixture(params=ENGINES)
def dive(tube: Scenario, request: pytest.FixtureRequest) -> Iterator[Dive]:
    dive = Dive(tube, VEHICLE, request.param)
    yield dive
    dive.close()


def reach_everywhere(dive: Dive) -> None:
    crafts = dive.world._crafts.array.numpy()
    crafts["hull"]["reach"] = EVERYWHERE
    dive.world._crafts.array.assign(crafts)


def bump(dive: Dive, seed: int, decisions: int = 150) -> tuple[Array, int]:
    """Bump about at random from a start near the wall; return all states and the number of steps in contact."""
    rng = np.random.default_rng(seed)
    dive.begin([5.0, 1.4, 0.0], yaw_quaternion(0.8))
    states, num_contacts = [], 0
    for _ in range(decisions):
        num_contacts += dive.step(*rng.integers(-1, 2, 2), 1.0)
        states.append(dive.state)
    return np.array(states), num_contacts


@needs_bullet
def test_asking_bullet_far_from_the_wall_changes_nothing(tube: Scenario, rng: np.random.Generator) -> None:
    always, rarely = Dive(tube, VEHICLE), Dive(tube, VEHICLE)
    reach_everywhere(always)
    velocity = 0.3 * rng.normal(size=6)
    for one in (always, rarely):
        one.begin([10.0, 0.0, 0.0], yaw_quaternion(0.3))
        one.move(velocity)
        assert sum(one.step(*AHEAD) for _ in range(30)) == 0
    np.testing.assert_allclose(always.state, rarely.state, atol=1e-12)
    engine = always.world._link._engines[0]  # type: ignore[union-attr]
    pose = engine._arena.motion(engine._body)[:7]
    np.testing.assert_allclose(pose, always.state[:7], atol=1e-12)
    always.close()
    rarely.close()


def test_hull_stops_at_the_wall(dive: Dive) -> None:
    dive.begin([10.0, 1.2, 0.0], yaw_quaternion(np.pi / 2))
    for _ in range(60):
        dive.step(*AHEAD)
    x, y, z = dive.state[:3]
    nose = np.hypot(y, z) + 0.5 * VEHICLE.capsule.length
    assert x == pytest.approx(10.0, abs=0.1)
    assert nose == pytest.approx(TUBE_RADIUS, abs=0.02)
    assert dive.step(*AHEAD) == 5


def test_hull_keeps_out_of_the_wall_while_bumping_about(dive: Dive) -> None:
    states, num_contacts = bump(dive, 1, 400)
    assert num_contacts > 100
    axis = np.array([rotation_matrix(state[3:7])[:, 0] for state in states])
    half = 0.5 * VEHICLE.capsule.axis_length
    ends = np.concatenate([states[:, :3] + half * axis, states[:, :3] - half * axis])
    farthest = np.linalg.norm(ends[:, 1:], axis=1).max()
    assert farthest + VEHICLE.capsule.radius < TUBE_RADIUS + 0.02  # a step's move of 20 mm may overlap


def test_no_contact_is_reported_clear_of_the_wall(dive: Dive) -> None:
    dive.begin([10.0, TUBE_RADIUS - VEHICLE.capsule.radius - 0.03, 0.0], LEVEL)  # 3 cm, less 2 mm of facets
    assert dive.step(*IDLE) == 0


@pytest.mark.parametrize("contacts", ENGINES)
def test_contact_never_adds_energy(tube: Scenario, contacts: str) -> None:
    mass, rng = VEHICLE.total_mass, np.random.default_rng(4)
    drifting = dataclasses.replace(
        VEHICLE,
        autopilot=dataclasses.replace(VEHICLE.autopilot, level_gain=0.0),
        body=dataclasses.replace(VEHICLE.body, buoyancy_height=0.0),
    )
    dive = Dive(tube, drifting, contacts)
    num_contacts = 0
    for _ in range(30):
        dive.begin([10.0, 1.3, 0.0], yaw_quaternion(rng.uniform(-np.pi, np.pi)))
        dive.move(rng.normal(size=6))
        for _ in range(20):
            before = mass @ dive.state[7:13] ** 2
            num_contacts += dive.step(*IDLE)
            assert mass @ dive.state[7:13] ** 2 <= before * (1 + 1e-6)  # Runge-Kutta's error
    assert num_contacts > 100
    dive.close()


def test_same_actions_give_the_same_states_bit_for_bit(tube: Scenario, dive: Dive) -> None:
    contacts = "own" if dive.world._link is None else "bullet"
    first, num_contacts = bump(dive, 0)
    assert num_contacts > 50
    bump(dive, 9)  # another episode in between, ending in contact
    again, _ = bump(dive, 0)
    np.testing.assert_array_equal(again, first)
    other = Dive(tube, VEHICLE, contacts)
    bump(other, 7, 20)
    np.testing.assert_array_equal(bump(other, 0)[0], first)
    other.close()


@pytest.mark.parametrize("speed", [5.0, 20.0, 50.0])
def test_vehicle_never_ends_outside_however_fast(dive: Dive, speed: float) -> None:
    num_touched = 0
    for yaw in np.linspace(0.3, 2.8, 12):
        dive.begin([10.0, 0.5, 0.0], yaw_quaternion(yaw))
        dive.move(np.array([speed, 0, 0, 0, 0, 0]))
        for _ in range(40):
            num_touched += dive.step(*AHEAD) > 0
            assert np.hypot(*dive.state[1:3]) < TUBE_RADIUS
    assert num_touched > 12


@pytest.mark.parametrize("contacts", ENGINES)
def test_vehicle_slides_smoothly_over_the_edges_of_a_flat_floor(tube: Scenario, contacts: str) -> None:
    # Without GEOM_CONCAVE_INTERNAL_EDGE, or with faces that look away from the water, a quarter of Bullet's contact
    # normals tilt here and the vehicle hops by 4 mm.
    box = trimesh.creation.box((12.0, 2.0, 4.0)).subdivide_to_size(0.4)
    box.apply_translation([10.0, 0.0, 0.0])
    mesh = Mesh(np.array(box.vertices), np.array(box.faces, dtype=np.int64))
    no_rock = dataclasses.replace(
        tube.field, bricks=np.ones((1, 1, 1), dtype=np.int32), samples=np.ones((2, 9, 9, 9), dtype=np.float32)
    )
    middle_at_origin = dataclasses.replace(tube, collision=mesh, field=no_rock)
    dive = Dive(middle_at_origin, VEHICLE, contacts)
    reach_everywhere(dive)
    dive.begin([6.0, 0.13, -2.0 + VEHICLE.capsule.radius + 0.01], LEVEL)
    heights, num_contacts = [], 0
    for _ in range(60):
        num_contacts += dive.step(-1.0, 0.0, 1.0)  # the ballast sinks, and presses it to the floor
        heights.append(dive.state[2])
    assert num_contacts > 250
    assert dive.state[0] > 9.0
    assert np.ptp(heights[20:]) < 0.002
    dive.close()


def test_closing_twice_does_nothing(tube: Scenario) -> None:
    dive = Dive(tube, VEHICLE)
    dive.close()
    dive.close()
