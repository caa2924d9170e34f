"""Kinds of policies, by what they can be asked."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from aquanav_tools.types import IntArray


class Policy(Protocol):
    """Chooses actions from observations."""

    def reset(self, seed: int) -> None:
        """Forget the last episode; draw random numbers, if any, from `seed`."""

    def act(self, observation: Any) -> Any:
        """Return the action for one observation: (O,), or a dictionary of arrays."""


@runtime_checkable
class PrivilegedPolicy(Protocol):
    """A policy that knows more than it observes: its vehicle, or the whole map."""

    def bind(self, env: Any) -> None:
        """Look at the environment in which an episode has been reset and is about to begin."""


@runtime_checkable
class Adapting(Protocol):
    """A policy for either task."""

    def adapt(self, space: spaces.Space[Any]) -> None:
        """Act in this space from now on."""


@runtime_checkable
class Vectorised(Policy, Protocol):
    """A policy that can compute logits for many vehicles at once."""

    def logits(self, observations: Any, slots: IntArray) -> npt.NDArray[np.float32]:
        """Return a row of anything for each of (N, O) observations, or a dictionary of them, of vehicles in (N,) slots.

        What is remembered of a vehicle belongs to its slot. A call that raises an error remembers nothing.
        """

    def decide(self, logits: npt.NDArray[np.float32]) -> Any:
        """Return the action that such a row stands for."""


@runtime_checkable
class BatchPrivileged(Protocol):
    """A policy that knows more than it observes of all vehicles of a batch."""

    def within(self, batch: Any) -> Vectorised:
        """Return what chooses for the vehicles of a batch of caves."""
