"""Worlds of one cave share a Bullet client. The truth is a world in a client of its own: the same to the bit."""

from __future__ import annotations

import dataclasses
import functools
import gc
import multiprocessing
import threading
from itertools import pairwise

import numpy as np
import pytest

from aquanav_tools.cave.synthetic import caves as synthetic
from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.actuators import actuator_model
from aquanav_tools.sim.bullet import BulletWorld, _arenas
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.types import Array, Mesh, Pose, yaw_quaternion
from tests.caves import TUBE_LENGTH, TUBE_RADIUS, tube_scenario

VEHICLES = [load_vehicle(name) for name in ("bluerov2", "bluerov2-heavy")]
STILL = np.zeros(3)
DECISIONS = 160
ROUGHNESS = 0.02


def rough(tube: Scenario) -> Scenario:
    """Return the tube with a wall of many bumpy triangles, whose mesh, and so whose client, no other scenario has."""
    smooth = synthetic.tube(TUBE_RADIUS, TUBE_LENGTH, 48, 61).truth
    bumps = ROUGHNESS * np.random.default_rng(0).uniform(-1.0, 1.0, smooth.vertices.shape)
    return dataclasses.replace(tube, collision=Mesh(smooth.vertices + bumps, smooth.faces))


class Dive:
    """A vehicle that scrapes along the wall at random, ever the same for a seed; half way it starts again."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        vehicle = VEHICLES[seed % 2]
        self.world = BulletWorld(scenario, vehicle)
        self.states: list[Array] = []
        self.num_contacts = 0
        self._actuators = actuator_model(vehicle, 0.02, 5)
        self._rng = np.random.default_rng(seed)
        self._start = Pose(np.array([5.0 + 0.1 * seed, 1.4 + 0.42 * (seed % 3 == 0), 0.0]), yaw_quaternion(0.8))

    def go_on(self) -> None:
        if len(self.states) in (0, DECISIONS // 2):
            self.world.reset(self._start)
            self._actuators.reset()
        commands = self._actuators.apply(*self._rng.integers(-1, 2, 2), 1.0)
        self.num_contacts += sum(self.world.step(commands, STILL))
        self.states.append(self.world.state.copy())

    def alone(self) -> Array:
        for _ in range(DECISIONS):
            self.go_on()
        self.world.close()
        return np.array(self.states)


def alone(seed: int) -> Array:
    """Return the states of a dive in a client of its own."""
    return Dive(rough(tube_scenario()), seed).alone()


truth = functools.cache(alone)


@pytest.mark.parametrize("num", [1, 4, 16])
def test_worlds_in_one_client_move_as_in_clients_of_their_own_bit_for_bit(
    tube: Scenario, num: int, rng: np.random.Generator
) -> None:
    shared, before = rough(tube), len(_arenas)
    dives = [Dive(shared, seed) for seed in range(num)]
    assert len(_arenas) == before + 1
    for which in rng.permutation(np.repeat(np.arange(num), DECISIONS)):
        dives[which].go_on()
    for seed, dive in enumerate(dives):
        assert dive.num_contacts > DECISIONS  # of 5 steps each
        np.testing.assert_array_equal(dive.states, truth(seed))
        dive.world.close()


def test_worlds_that_come_and_go_do_not_disturb_the_others(tube: Scenario) -> None:
    shared = rough(tube)
    dive = Dive(shared, 0)
    guests: list[Dive] = []
    for decision in range(DECISIONS):
        dive.go_on()
        if decision % 20 == 0:
            guests.append(Dive(shared, decision + 1))
        if decision % 30 == 0:
            guests.pop(0).world.close()
        for guest in guests:
            guest.go_on()
    np.testing.assert_array_equal(dive.states, truth(0))
    for each in (dive, *guests):
        each.world.close()


def test_an_episode_that_begins_at_the_wall_repeats_whatever_came_before(tube: Scenario) -> None:
    world, ahead = BulletWorld(rough(tube), VEHICLES[0]), np.tile([22.0, 0, 0, 0, 0, 1.0], (5, 1))
    repeats = []
    for yaw in (0.4, 1.1, 2.9):
        world.reset(Pose(np.array([10.0, 1.82, 0.0]), yaw_quaternion(0.2)))
        assert all(world.step(ahead, STILL))
        repeats.append([world.step(ahead, STILL) and world.state.copy() for _ in range(20)])
        world.reset(Pose(np.array([12.0, 1.5, 0.3]), yaw_quaternion(yaw)))
        assert any(any(world.step(ahead, STILL)) for _ in range(30))
    np.testing.assert_array_equal(repeats[1], repeats[0])
    np.testing.assert_array_equal(repeats[2], repeats[0])
    world.close()


def test_worlds_in_threads_do_not_disturb_each_other(tube: Scenario) -> None:
    shared = rough(tube)
    dives = [Dive(shared, seed) for seed in range(3)]
    results: dict[int, Array] = {}
    threads = [
        threading.Thread(target=lambda seed, dive: results.update({seed: dive.alone()}), args=item)
        for item in enumerate(dives)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for seed in range(3):
        np.testing.assert_array_equal(results[seed], truth(seed))


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_workers_move_as_the_process_that_started_them(tube: Scenario, method: str) -> None:
    open_dive = Dive(rough(tube), 0)
    open_dive.go_on()  # a forked worker inherits a client that is in use
    with multiprocessing.get_context(method).Pool(2) as pool:
        first, second = pool.map(alone, [0, 1])
    np.testing.assert_array_equal(first, truth(0))
    np.testing.assert_array_equal(second, truth(1))
    open_dive.world.close()


def test_a_client_is_freed_with_its_last_world(tube: Scenario) -> None:
    shared, before = rough(tube), len(_arenas)
    first, second, forgotten = (BulletWorld(shared, VEHICLES[0]) for _ in range(3))
    finer = dataclasses.replace(shared.settings, limits=dataclasses.replace(shared.settings.limits, dt=0.01))
    other = BulletWorld(dataclasses.replace(shared, settings=finer), VEHICLES[0])
    assert len(_arenas) == before + 2  # another time step is another client
    counts = [len(_arenas)]
    for world in (other, first, second):
        world.close()
        counts.append(len(_arenas))
    del forgotten
    gc.collect()
    counts.append(len(_arenas))
    assert [a - b for a, b in pairwise(counts)] == [1, 0, 0, 1]


def test_a_closed_world_says_so(tube: Scenario) -> None:
    world = BulletWorld(tube, VEHICLES[0])
    world.close()
    for use in (
        lambda: world.reset(Pose(np.zeros(3), yaw_quaternion(0.0))),
        lambda: world.step(np.zeros((5, 6)), STILL),
    ):
        with pytest.raises(InputError, match="was closed"):
            use()
