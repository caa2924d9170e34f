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

from aquanav_tools.errors import InputError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.synthetic import caves as synthetic
from aquanav_tools.types import Array, Mesh, yaw_quaternion
from tests.caves import TUBE_LENGTH, TUBE_RADIUS, tube_scenario
from tests.sim.batch.worlds import Dive

pytest.importorskip("pybullet", reason="PyBullet is not installed")
from aquanav_tools.sim.bullet import BulletContacts, _arenas  # there is none without PyBullet

VEHICLES = [load_vehicle(name) for name in ("bluerov2", "bluerov2-heavy")]
DECISIONS = 160
ROUGHNESS = 0.02


def rough(tube: Scenario) -> Scenario:
    """Return the tube with a wall of many bumpy triangles, whose mesh, and so whose client, no other scenario has."""
    smooth = synthetic.tube(TUBE_RADIUS, TUBE_LENGTH, 48, 61).truth
    bumps = ROUGHNESS * np.random.default_rng(0).uniform(-1.0, 1.0, smooth.vertices.shape)
    return dataclasses.replace(tube, collision=Mesh(smooth.vertices + bumps, smooth.faces))


class RandomDive:
    """A vehicle that scrapes along the wall at random, ever the same for a seed; half way it starts again."""

    def __init__(self, scenario: Scenario, seed: int) -> None:
        self.dive = Dive(scenario, VEHICLES[seed % 2])
        self.states: list[Array] = []
        self.num_contacts = 0
        self._rng = np.random.default_rng(seed)
        self._start = [5.0 + 0.1 * seed, 1.4 + 0.42 * (seed % 3 == 0), 0.0]

    def go_on(self) -> None:
        if len(self.states) in (0, DECISIONS // 2):
            self.dive.begin(self._start, yaw_quaternion(0.8))
        self.num_contacts += self.dive.step(*self._rng.integers(-1, 2, 2), 1.0)
        self.states.append(self.dive.state)

    def close(self) -> None:
        self.dive.close()

    def alone(self) -> Array:
        for _ in range(DECISIONS):
            self.go_on()
        self.close()
        return np.array(self.states)


def alone(seed: int) -> Array:
    """Return the states of a dive in a client of its own."""
    return RandomDive(rough(tube_scenario()), seed).alone()


truth = functools.cache(alone)


@pytest.mark.parametrize("num", [1, 4, 16])
def test_worlds_in_one_client_move_as_in_clients_of_their_own_bit_for_bit(
    tube: Scenario, num: int, rng: np.random.Generator
) -> None:
    gc.collect()  # what other tests have left open would go from the count any time
    shared, before = rough(tube), len(_arenas)
    dives = [RandomDive(shared, seed) for seed in range(num)]
    assert len(_arenas) == before + 1
    for which in rng.permutation(np.repeat(np.arange(num), DECISIONS)):
        dives[which].go_on()
    for seed, dive in enumerate(dives):
        assert dive.num_contacts > DECISIONS  # of 5 steps each
        np.testing.assert_array_equal(dive.states, truth(seed))
        dive.close()


def test_worlds_that_come_and_go_do_not_disturb_the_others(tube: Scenario) -> None:
    shared = rough(tube)
    dive = RandomDive(shared, 0)
    guests: list[RandomDive] = []
    for decision in range(DECISIONS):
        dive.go_on()
        if decision % 20 == 0:
            guests.append(RandomDive(shared, decision + 1))
        if decision % 30 == 0:
            guests.pop(0).close()
        for guest in guests:
            guest.go_on()
    np.testing.assert_array_equal(dive.states, truth(0))
    for each in (dive, *guests):
        each.close()


def test_an_episode_that_begins_at_the_wall_repeats_whatever_came_before(tube: Scenario) -> None:
    dive, ahead = Dive(rough(tube), VEHICLES[0]), (0.0, 1.0 / VEHICLES[0].full_steer, 1.0)
    repeats = []
    for yaw in (0.4, 1.1, 2.9):
        dive.begin([10.0, 1.82, 0.0], yaw_quaternion(0.2))
        assert dive.step(*ahead) == 5
        repeats.append([(dive.step(*ahead), dive.state)[1] for _ in range(20)])
        dive.begin([12.0, 1.5, 0.3], yaw_quaternion(yaw))
        assert any(dive.step(*ahead) for _ in range(30))
    np.testing.assert_array_equal(repeats[1], repeats[0])
    np.testing.assert_array_equal(repeats[2], repeats[0])
    dive.close()


def test_worlds_in_threads_do_not_disturb_each_other(tube: Scenario) -> None:
    shared = rough(tube)
    dives = [RandomDive(shared, seed) for seed in range(3)]
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
    open_dive = RandomDive(rough(tube), 0)
    open_dive.go_on()  # a forked worker inherits a client that is in use
    with multiprocessing.get_context(method).Pool(2) as pool:
        first, second = pool.map(alone, [0, 1])
    np.testing.assert_array_equal(first, truth(0))
    np.testing.assert_array_equal(second, truth(1))
    open_dive.close()


def test_a_client_is_freed_with_its_last_world(tube: Scenario) -> None:
    gc.collect()  # what other tests have left
    shared, before = rough(tube), len(_arenas)
    first, second, forgotten = (BulletContacts(shared, VEHICLES[0]) for _ in range(3))
    finer = dataclasses.replace(shared.settings, limits=dataclasses.replace(shared.settings.limits, dt=0.01))
    other = BulletContacts(dataclasses.replace(shared, settings=finer), VEHICLES[0])
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
    world = BulletContacts(tube, VEHICLES[0])
    world.close()
    for use in (world.reset, lambda: world.solve([0.0] * 13, False)):
        with pytest.raises(InputError, match="was closed"):
            use()
