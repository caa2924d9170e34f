from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np
import pytest
import trimesh

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.actuators import actuator_model
from aquanav_tools.sim.batch.prediction import advance
from aquanav_tools.sim.bullet import BulletWorld
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array, Mesh, Pose, rotation_matrix, yaw_quaternion
from tests.caves import TUBE_RADIUS

VEHICLE = load_vehicle("bluerov2")
STILL = np.zeros(3)
AHEAD = np.tile([22.0, 0, 0, 0, 0, 0], (5, 1))
NOTHING = np.zeros((5, 6))


@pytest.fixture
def world(tube: Scenario) -> Iterator[BulletWorld]:
    world = BulletWorld(tube, VEHICLE)
    yield world
    world.close()


def pose(x: float, y: float, z: float, yaw: float = 0.0) -> Pose:
    return Pose(np.array([x, y, z], dtype=np.float64), yaw_quaternion(yaw))


def dive(world: BulletWorld, seed: int, decisions: int = 150) -> tuple[Array, int]:
    """Bump about at random from a start near the wall; return all states and the number of steps in contact."""
    rng = np.random.default_rng(seed)
    actuators = actuator_model(VEHICLE, 0.02, 5)
    world.reset(pose(5.0, 1.4, 0.0, 0.8))
    states, num_contacts = [], 0
    for _ in range(decisions):
        num_contacts += sum(world.step(actuators.apply(*rng.integers(-1, 2, 2), 1.0), STILL))
        states.append(world.state.copy())
    return np.array(states), num_contacts


def test_bullet_in_free_water_lands_on_our_pose(world: BulletWorld, rng: np.random.Generator) -> None:
    world._reach = np.inf  # ask Bullet at every step
    world.reset(pose(10, 0, 0, 0.3))
    world.state[7:] = 0.3 * rng.normal(size=6)
    expected = world.state.copy()
    for _ in range(50):
        assert not any(world.step(AHEAD, STILL))
    expected = advance(expected[None], AHEAD[0], STILL, VEHICLE.motion_parameters(1000.0), 0.02, 250)[0, -1]
    np.testing.assert_allclose(world.state, expected, atol=1e-12)  # compiled twice, rounded twice
    assert world._arena is not None
    solved = world._arena.motion(world._body)
    np.testing.assert_allclose(solved[:3], expected[:3], atol=1e-13)
    np.testing.assert_allclose(np.abs(solved[3:7] @ expected[[4, 5, 6, 3]]), 1.0, atol=1e-13)


def test_leaving_bullet_out_far_from_the_wall_changes_nothing(tube: Scenario) -> None:
    always, rarely = BulletWorld(tube, VEHICLE), BulletWorld(tube, VEHICLE)
    always._reach = np.inf
    (watched, num_watched), (free, num_free) = dive(always, 3, 100), dive(rarely, 3, 100)
    assert num_watched == num_free > 20
    np.testing.assert_allclose(free, watched, atol=1e-6)  # Bullet's warm start may differ in the last digits
    always.close()
    rarely.close()


def test_hull_stops_at_the_wall(world: BulletWorld) -> None:
    world.reset(pose(10, 0, 0, np.pi / 2))
    touched = [world.step(AHEAD, STILL) for _ in range(80)]
    assert not any(touched[0])
    assert all(touched[-1])
    nose = world.state[1] + VEHICLE.capsule.length / 2
    assert nose == pytest.approx(TUBE_RADIUS, abs=0.02)  # facets stand in by 2 mm; Bullet lets a step of 20 mm overlap
    assert np.abs(world.state[7:10]).max() < 0.05


def test_hull_keeps_out_of_the_wall_while_bumping_about(world: BulletWorld) -> None:
    states, num_contacts = dive(world, 1, 400)
    assert num_contacts > 100
    axis = np.array([rotation_matrix(state[3:7])[:, 0] for state in states])
    half = 0.5 * VEHICLE.capsule.axis_length
    ends = np.concatenate([states[:, :3] + half * axis, states[:, :3] - half * axis])
    farthest = np.linalg.norm(ends[:, 1:], axis=1).max()
    assert farthest + VEHICLE.capsule.radius < TUBE_RADIUS + 0.02  # Bullet lets a step's move of 20 mm overlap


def test_no_contact_is_reported_clear_of_the_wall(world: BulletWorld) -> None:
    world.reset(pose(10, TUBE_RADIUS - VEHICLE.capsule.radius - 0.03, 0))  # 3 cm, less 2 mm of facets
    assert not any(world.step(NOTHING, STILL))


def test_contact_never_adds_energy(world: BulletWorld) -> None:
    mass, rng = VEHICLE.total_mass, np.random.default_rng(4)
    drifting = dataclasses.replace(
        VEHICLE,
        autopilot=dataclasses.replace(VEHICLE.autopilot, level_gain=0.0),
        body=dataclasses.replace(VEHICLE.body, buoyancy_height=0.0),
    )
    world._parameters = drifting.motion_parameters(1000.0).packed()
    num_contacts = 0
    for _ in range(30):
        world.reset(pose(10, 1.3, 0, rng.uniform(-np.pi, np.pi)))
        world.state[7:] = rng.normal(size=6)
        for _ in range(20):
            before = mass @ world.state[7:] ** 2
            num_contacts += sum(world.step(NOTHING, STILL))
            assert mass @ world.state[7:] ** 2 <= before * (1 + 1e-6)  # Runge-Kutta's error
    assert num_contacts > 100


def test_same_actions_give_the_same_states_bit_for_bit(tube: Scenario, world: BulletWorld) -> None:
    first, num_contacts = dive(world, 0)
    assert num_contacts > 50
    dive(world, 9)  # another episode in between, ending in contact
    again, _ = dive(world, 0)
    np.testing.assert_array_equal(again, first)
    other = BulletWorld(tube, VEHICLE)
    dive(other, 7, 20)
    np.testing.assert_array_equal(dive(other, 0)[0], first)
    other.close()


def test_worlds_in_one_process_do_not_share_state(tube: Scenario, world: BulletWorld) -> None:
    alone, _ = dive(world, 2, 60)
    other = BulletWorld(tube, VEHICLE)
    actuators = actuator_model(VEHICLE, 0.02, 5)
    rng = np.random.default_rng(2)
    world.reset(pose(5.0, 1.4, 0.0, 0.8))
    other.reset(pose(5.1, 1.4, 0.0, 0.8))
    for state in alone:
        world.step(actuators.apply(*rng.integers(-1, 2, 2), 1.0), STILL)
        other.step(AHEAD, STILL)
        np.testing.assert_array_equal(world.state, state)
    other.close()


@pytest.mark.parametrize("speed", [5.0, 20.0, 50.0])
def test_vehicle_never_ends_outside_however_fast(world: BulletWorld, speed: float) -> None:
    num_touched = 0
    for yaw in np.linspace(0.3, 2.8, 12):
        world.reset(pose(10, 0.5, 0, yaw))
        world.state[7] = speed
        for _ in range(40):
            num_touched += any(world.step(AHEAD, STILL))
            assert np.hypot(world.state[1], world.state[2]) < TUBE_RADIUS
    assert num_touched > 12


def test_vehicle_slides_smoothly_over_the_edges_of_a_flat_floor(tube: Scenario) -> None:
    # Without GEOM_CONCAVE_INTERNAL_EDGE, or with faces that look away from the water, a quarter of the contact normals
    # tilt here and the vehicle hops by 4 mm.
    box = trimesh.creation.box((12.0, 2.0, 4.0)).subdivide_to_size(0.4)
    box.apply_translation([10.0, 0.0, 0.0])
    mesh = Mesh(np.array(box.vertices), np.array(box.faces, dtype=np.int64))
    no_rock = dataclasses.replace(
        tube.field, bricks=np.ones((1, 1, 1), dtype=np.int32), samples=np.ones((2, 9, 9, 9), dtype=np.float32)
    )
    floor = dataclasses.replace(tube, collision=mesh, field=no_rock)
    world = BulletWorld(floor, VEHICLE)
    world._reach = np.inf
    world.reset(pose(6.0, 0.13, -2.0 + VEHICLE.capsule.radius + 0.01))
    wrenches = np.tile([22.0, 0, -12.0, 0, 0, 0], (5, 1))
    heights, num_contacts = [], 0
    for _ in range(60):
        num_contacts += sum(world.step(wrenches, STILL))
        heights.append(world.state[2])
    assert num_contacts > 250
    assert world.state[0] > 9.0
    assert np.ptp(heights[10:]) < 0.001
    world.close()


def test_closing_twice_does_nothing(tube: Scenario) -> None:
    world = BulletWorld(tube, VEHICLE)
    world.close()
    world.close()
