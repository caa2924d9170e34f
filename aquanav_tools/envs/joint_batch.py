"""Several scenarios in one batch: each has its share of the vehicles, and these move as in a batch of their own."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.batch import Batch, Floats
from aquanav_tools.envs.cave_batch import slices_of
from aquanav_tools.errors import InputError
from aquanav_tools.sim.contacts import Contacts
from aquanav_tools.types import Array


class JointBatch:
    """A `Batch` of batches. Scenarios take their turns in threads, on which the results do not depend."""

    contacts: Contacts = "own"

    def __init__(
        self, makes: Sequence[Callable[..., Batch]], num: int, *, num_threads: int | None = None, **options: Any
    ) -> None:
        """Make a batch for each scenario.

        Args:
            makes: For each scenario, what returns its batch of a number of vehicles, `num_threads` and `options`.
            num: Vehicles, at least one for each scenario.
            num_threads: On the processor; None takes as many as the process may use.
            options: Of all batches.

        Raises:
            InputError: there are fewer vehicles than scenarios, or these do not take the same actions and observations.
        """
        available = len(os.sched_getaffinity(0)) if num_threads is None else num_threads
        if available < 1:
            raise InputError(f"num_threads must be at least 1, got {num_threads}.")
        self.num = num
        self.slices = slices_of(num, len(makes))
        """Vehicles of each scenario."""
        if len(self.slices) < len(makes):
            raise InputError(f"{len(makes)} scenarios need at least as many vehicles, got {num}.")
        per_batch = max(1, available // len(makes))
        sizes = [part.stop - part.start for part in self.slices]
        self.batches = [make(size, num_threads=per_batch, **options) for make, size in zip(makes, sizes, strict=True)]
        first = self.batches[0]
        self.parts, self.decision_seconds, self.ray_lengths = first.parts, first.decision_seconds, first.ray_lengths
        self.action_space, self.observation_space = first.action_space, first.observation_space
        for other in self.batches:
            if (
                other.action_space != first.action_space
                or other.observation_space.shape != first.observation_space.shape
            ):
                raise InputError("Caves and bays do not go into one batch: their actions and observations differ.")
            if other.dynamics.keys() != first.dynamics.keys():
                raise InputError(
                    f"The randomisation draws {', '.join(other.dynamics)} of one scenario's vehicle and "
                    f"{', '.join(first.dynamics)} of another's. In one batch take vehicles of one kind."
                )
        self._threads = ThreadPoolExecutor(min(available, len(makes)))

    @property
    def dynamics(self) -> dict[str, Array]:
        """(N,) what each episode has drawn of its vehicle's dynamics, by name."""
        drawn = [batch.dynamics for batch in self.batches]
        return {name: np.concatenate([part[name] for part in drawn]) for name in drawn[0]}

    @property
    def route_lengths(self) -> Array:
        """(N,) from which progress is counted, m."""
        return np.concatenate([batch.route_lengths for batch in self.batches])

    @property
    def path_lengths(self) -> Array:
        """(N,) length of the shortest way to the goal from where each episode began, m."""
        return np.concatenate([batch.path_lengths for batch in self.batches])

    def reset(
        self,
        seeds: Sequence[int],
        starts: Sequence[int | None] | None = None,
        conditions: dict[str, Any] | None = None,
    ) -> None:
        """Begin all episodes, each from a seed of its own."""
        for batch, part in zip(self.batches, self.slices, strict=True):
            values = {name: value[part] for name, value in (conditions or {}).items()}
            batch.reset(seeds[part], None if starts is None else starts[part], values)

    def randomise_time_limits(self, seed: int) -> None:
        """Let time run out earlier, by chance, in the episodes that have just begun; seeds count on as for `reset`."""
        for batch, part in zip(self.batches, self.slices, strict=True):
            batch.randomise_time_limits(seed + part.start)

    def command(self, actions: Any) -> None:
        """Hand the actions of all vehicles to the next step."""
        if len(actions) != self.num:
            raise InputError(f"Actions must be one for each of the {self.num} vehicles, got {np.shape(actions)}.")
        for batch, part in zip(self.batches, self.slices, strict=True):
            batch.command(actions[part])

    def set_commands(self, commands: Floats) -> None:
        """Hand (N, 3) ballast, steer and thrust in [-1, 1] to the next step."""
        for batch, part in zip(self.batches, self.slices, strict=True):
            batch.set_commands(commands[part])

    def retire(self, vehicles: Sequence[int]) -> None:
        """Say that no episode need follow of these vehicles until the next reset."""
        for batch, part in zip(self.batches, self.slices, strict=True):
            batch.retire([vehicle - part.start for vehicle in vehicles if part.start <= vehicle < part.stop])

    def step(self) -> None:
        """Carry out a decision of every vehicle."""
        list(self._threads.map(lambda batch: batch.step(), self.batches))

    def view_of(self, name: str) -> Any:
        """Return an array, a copy."""
        return np.concatenate([batch.view_of(name) for batch in self.batches])

    def copy_of(self, name: str) -> Any:
        """Return a copy of an array."""
        return self.view_of(name)

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of all that the future depends on, the scenario's number before each name."""
        parts = enumerate(batch.state() for batch in self.batches)
        return {f"{n}/{name}": values for n, state in parts for name, values in state.items()}

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Go back to where `state` was taken."""
        for n, batch in enumerate(self.batches):
            lead = f"{n}/"
            batch.restore({name.removeprefix(lead): state[name] for name in state if name.startswith(lead)})

    @property
    def term_names(self) -> tuple[str, ...]:
        """Of the columns of "terms"."""
        return self.batches[0].term_names

    @property
    def failures(self) -> dict[int, str]:
        """Why code of the user's own failed in the last reset or step, by vehicle."""
        pairs = zip(self.batches, self.slices, strict=True)
        return {part.start + row: why for batch, part in pairs for row, why in batch.failures.items()}

    def close(self) -> None:
        """End the threads."""
        self._threads.shutdown()
        for batch in self.batches:
            batch.close()
