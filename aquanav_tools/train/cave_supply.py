"""The drawn caves of a training: one sequence, of which each is built before its turn comes.

Cave k of a run is a function of the run's seed, its styles and k, whatever the timing; so is when it comes in
(`cave_rotation`). Only how long the learner waits for it depends on the machine, and that is measured.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.build.generated import build_generated
from aquanav_tools.build.generated_set import LOWER_PRIORITY, BuiltCave, CaveTask, build_set, builder_pool, built_by
from aquanav_tools.envs.starting import can_begin_anywhere
from aquanav_tools.envs.vehicles import dived_by, vehicle_of
from aquanav_tools.errors import InputError, ResourceError, ScenarioError
from aquanav_tools.machine import num_cores
from aquanav_tools.scenario.folder import read_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.scenario.shipped import generated_name, remove_version
from aquanav_tools.scenario.split import training_seed
from aquanav_tools.train.scaled_caves import scaled_to_fit

AHEAD = 8
"""Caves that are built, and read, before their turn: more than fail to be built in a row."""
MAX_ATTEMPTS = 10
"""Seeds that are tried for one cave of the sequence."""
PATIENCE = 15.0
"""Time that builders get to end what they are at, s: a cave takes some seconds."""


@dataclass(frozen=True)
class CaveSequence:
    """Which caves a run learns in, one after the other."""

    styles: tuple[str, ...]
    """They take turns."""
    seed: int
    """Of the run."""
    vehicle: str | None = None
    """What dives them; None for their own."""
    scales: tuple[float, float] = (1.0, 1.0)
    """By a factor between these each is made larger or smaller."""

    def scale(self, number: int) -> float:
        """Return the factor of a cave, drawn evenly in the logarithm."""
        low, high = np.log(self.scales)
        return float(np.exp(np.random.default_rng([self.seed, number]).uniform(low, high)))

    def task(self, number: int, attempt: int = 0) -> NumberedTask:
        """Return how to build a cave; with the attempts before it in vain, another one in its place."""
        style = self.styles[number % len(self.styles)]
        return NumberedTask(style, training_seed(style, self.seed, number, attempt), "", number, attempt)


@dataclass(frozen=True)
class NumberedTask(CaveTask):
    """A cave of a sequence that a worker builds."""

    number: int = 0
    attempt: int = 0


class CaveSupply:
    """Builds the caves of a sequence, ahead of need in processes of lower priority; a context manager."""

    def __init__(self, sequence: CaveSequence, num_workers: int) -> None:
        """Prepare; builders start when a cave is first asked for ahead (`expect`).

        Args:
            sequence: The caves.
            num_workers: Processes that build ahead; 0 takes as many as the learner leaves cores, and one at least.
        """
        self.sequence = sequence
        self.waited = 0.0
        """Wall time that `take` has waited, s."""
        self._num_workers = num_workers or max(1, num_cores() - 2)
        self._change = threading.Condition()
        self._ready: dict[int, Scenario] = {}
        self._failed: Exception | None = None
        self._next = self._end = 0
        self._is_closed = False
        self._thread: threading.Thread | None = None

    def __enter__(self) -> CaveSupply:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def at_once(self, numbers: Sequence[int], progress: Callable[[int, int], None] | None = None) -> list[Scenario]:
        """Return caves by their numbers; those that are not in the cache are built on all cores.

        Args:
            numbers: Which.
            progress: Called with how many are ready, and of how many.

        Raises:
            ResourceError: a worker ended twice over one cave, or the cache cannot be written to.
            InputError: MAX_ATTEMPTS caves in a row could not be built, or do not fit the vehicle.
        """
        found: dict[int, Scenario] = {}
        tasks = [self.sequence.task(number) for number in dict.fromkeys(numbers)]
        while tasks:
            again = []
            for task, built in build_set(tasks):
                assert isinstance(task, NumberedTask)
                scenario = self._read(task, built)
                if isinstance(scenario, NumberedTask):
                    again.append(scenario)
                    continue
                found[task.number] = scenario
                if progress is not None:
                    progress(len(found), len(set(numbers)))
            tasks = again
        return [found[number] for number in numbers]

    def expect(self, first: int) -> None:
        """Build ahead from a number on, the next of which are then taken in turn."""
        with self._change:
            for number in [number for number in self._ready if number < first]:
                del self._ready[number]
            self._next = max(self._next, first)
            if self._thread is None:
                self._thread = threading.Thread(target=self._work, name="caves ahead", daemon=True)
                self._thread.start()
            self._end = first + AHEAD
            self._change.notify_all()

    def take(self, number: int) -> Scenario:
        """Return the cave whose turn it is; wait for it where it is not ready. The same one until another is expected.

        Raises:
            AquanavError: building failed.
        """
        began = time.perf_counter()
        with self._change:
            while number not in self._ready and self._failed is None:
                self._change.wait()
            self.waited += time.perf_counter() - began
            if self._failed is not None:
                raise self._failed
            return self._ready[number]

    def close(self) -> None:
        """End the builders. Closing twice does nothing."""
        with self._change:
            self._is_closed = True
            self._change.notify_all()
        if self._thread is not None:
            self._thread.join(PATIENCE)

    def _work(self) -> None:
        """Keep builders busy until closed: the thread."""
        try:
            with builder_pool(self._num_workers, niceness=LOWER_PRIORITY) as pool:
                while self._waits_for_need():
                    again: list[NumberedTask] = []
                    busy: set[int] = set()
                    for task, built in built_by(pool, self._tasks(again, busy)):
                        assert isinstance(task, NumberedTask)
                        busy.discard(task.number)
                        self._keep(task, built, again)
        except _ClosedError:
            pass
        except Exception as error:  # told to the learner, which waits
            with self._change:
                self._failed = error
                self._change.notify_all()

    def _waits_for_need(self) -> bool:
        """Return True once there is something to build; False when closed."""
        with self._change:
            self._change.wait_for(lambda: self._is_closed or self._next < self._end)
            return not self._is_closed

    def _tasks(self, again: list[NumberedTask], busy: set[int]) -> Iterator[NumberedTask | None]:
        """Yield what to build next; None where that depends on what is being built; end where nothing is needed."""
        while True:
            task: NumberedTask | None = None
            with self._change:
                if self._is_closed:
                    raise _ClosedError
                if again:
                    task = again.pop()
                elif self._next < self._end:
                    task = self.sequence.task(self._next)
                    self._next += 1
            if task is not None:
                busy.add(task.number)
            elif not busy:
                return
            yield task

    def _keep(self, task: NumberedTask, built: BuiltCave, again: list[NumberedTask]) -> None:
        scenario = self._read(task, built)
        if isinstance(scenario, NumberedTask):
            again.append(scenario)
            return
        with self._change:
            self._ready[task.number] = scenario
            self._change.notify_all()

    def _read(self, task: NumberedTask, built: BuiltCave) -> Scenario | NumberedTask:
        """Return the cave that was built, or what is to be built in its place.

        Raises:
            ResourceError: its worker ended, twice.
            InputError: it was the last attempt.
        """
        name = generated_name(task.style, task.seed)
        if built.is_lost:
            raise ResourceError(
                f"The cave {name} could not be built: {built.fault}. The likely cause is too little memory. Caves that "
                "are built stay; the same command goes on."
            )
        try:
            if built.folder is None:
                raise InputError(built.fault)
            scenario, vehicle = _read_whole(task, built.folder), self.sequence.vehicle
            if scenario.flow is None:
                raise InputError(f"No water flows through {name}.")
            if self.sequence.scales == (1.0, 1.0):
                scenario = dived_by(scenario, vehicle)
            else:
                scenario = scaled_to_fit(scenario, self.sequence.scale(task.number), vehicle)
            return _with_starts(scenario, name)
        except InputError as error:
            if task.attempt + 1 == MAX_ATTEMPTS:
                raise InputError(
                    f"None of {MAX_ATTEMPTS} drawn caves can be learned in. The last, {name}: {error}"
                ) from error
            return self.sequence.task(task.number, task.attempt + 1)


def _with_starts(scenario: Scenario, name: str) -> Scenario:
    """Return a cave that a lesson can begin in anywhere.

    Raises:
        InputError: it is hardly wider than the vehicle.
    """
    if not can_begin_anywhere(scenario, vehicle_of(scenario).capsule):
        raise InputError(f"{name} is hardly wider than its vehicle: no start could be drawn anywhere in it.")
    return scenario


def _read_whole(task: NumberedTask, folder: Path) -> Scenario:
    """Return the scenario in a folder of the cache; it is built again where the folder is damaged, or was removed."""
    try:
        return read_scenario(folder)
    except ScenarioError:  # another cave in its place would depend on what befell the cache
        remove_version(folder)
        return read_scenario(build_generated(task.style, task.seed))


class _ClosedError(Exception):
    """Nothing more is to be built."""
