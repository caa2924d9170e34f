"""What batches of vehicles in caves and of boats in bays have in common: training and evaluation see no more."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.errors import OwnCodeError
from aquanav_tools.sim.contacts import Contacts
from aquanav_tools.types import Array

Floats = npt.NDArray[np.float32]


class Batch(Protocol):
    """N vehicles at the task of one scenario. `reset`, then `command` or `set_commands`, and `step`, once per decision.

    Arrays go by name, a row for each vehicle: positions, orientations, velocities, currents (where the last decision
    began), clearances, touched (steps), collisions, remaining, start_indices, observations, final_observations, terms,
    rewards, terminated, truncated, outcomes; and last_outcomes, last_returns, last_lengths, last_collisions, of the
    last episode. Units are those of the environment with one vehicle.
    """

    num: int
    parts: tuple[str, ...]
    """Of an action: DIVING or AFLOAT."""
    action_space: spaces.Space[Any]
    observation_space: spaces.Space[Any]
    decision_seconds: float
    contacts: Contacts
    """Who solves them."""
    ray_lengths: Array
    """(R,) m."""

    @property
    def dynamics(self) -> dict[str, Array]:
        """(N,) what each episode has drawn of its vehicle's dynamics, by name; nothing without a randomisation."""

    @property
    def route_lengths(self) -> Array:
        """(N,) from which progress is counted: progress is this less what remains, m."""

    @property
    def path_lengths(self) -> Array:
        """(N,) length of the shortest way to the goal from where each episode began, m."""

    def reset(
        self,
        seeds: Sequence[int],
        starts: Sequence[int | None] | None = None,
        conditions: dict[str, Any] | None = None,
    ) -> None:
        """Begin all episodes.

        Args:
            seeds: (N,) of the first episodes: each is what it is alone, whatever else is in the batch.
            starts: (N,) the first episode's, from the scenario's list; None draws them.
            conditions: Options of the task, of those in `starting.CONDITIONS`, until the next reset: one value for all
                vehicles, or (N,) of them; (N, 2) of a range. The task's own where they are not named.
        """

    def randomise_time_limits(self, seed: int) -> None:
        """Let time run out earlier, by chance, in the episodes that have just begun: not in all of them at once."""

    def command(self, actions: Any) -> None:
        """Hand the (N, ...) actions of all vehicles to the next step; raises InputError where one is none."""

    def set_commands(self, commands: Floats) -> None:
        """Hand (N, 3) ballast, steer and thrust in [-1, 1] to the next step."""

    def retire(self, vehicles: Sequence[int]) -> None:
        """Say that no episode need follow of these vehicles until the next reset: a batch may spare itself the work."""

    def step(self) -> None:
        """Carry out a decision of every vehicle."""

    def view_of(self, name: str) -> Any:
        """Return an array, which later steps may change."""

    def copy_of(self, name: str) -> Any:
        """Return a copy of an array."""

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return copies of all that the future depends on beside the commands."""

    def restore(self, state: dict[str, npt.NDArray[Any]]) -> None:
        """Go back to where `state` was taken, also by another batch of as many vehicles in the same task."""

    def close(self) -> None:
        """End the threads. Closing twice does nothing."""

    @property
    def term_names(self) -> tuple[str, ...]:
        """Of the columns of "terms"."""

    @property
    def failures(self) -> dict[int, str]:
        """Why code of the user's own failed in the last reset or step, by vehicle."""


def copied(values: Any) -> Any:
    """Return a copy of an array, or of a dictionary of them."""
    return {name: part.copy() for name, part in values.items()} if isinstance(values, dict) else np.array(values)


def row_of(values: Any, row: int | Sequence[int]) -> Any:
    """Return a copy of a row, or of some rows, of an array, or of each array of a dictionary."""
    return {name: part[row].copy() for name, part in values.items()} if isinstance(values, dict) else values[row].copy()


def raise_failures(batch: Batch) -> None:
    """Raise an error that tells why code of the user's own failed in the last reset or step; nothing where none did.

    Raises:
        OwnCodeError: it failed, and for which vehicles.
    """
    failures = batch.failures
    if not failures:
        return
    rows, seeds = sorted(failures), batch.view_of("seeds")
    named = ", ".join(f"{row} (seed {int(seeds[row]) % (1 << 32)})" for row in rows[:3])
    more = f" and {len(rows) - 3} more" if len(rows) > 3 else ""
    raise OwnCodeError(f"{failures[rows[0]]} This was vehicle {named}{more}, of {batch.num}.", dict(failures))
