"""What batches in caves and in bays share: what is observed by parts, and the turns that the user's own code takes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from aquanav_tools.envs.action import ActionModel
from aquanav_tools.envs.batch import Floats, copied
from aquanav_tools.envs.dict_observation import DictObservation
from aquanav_tools.envs.extensions import Extensions
from aquanav_tools.sim.contacts import Contacts
from aquanav_tools.types import Array

OBSERVATIONS = ("observations", "final_observations")
"""Arrays that a `Dict` has one of for each part."""


class ExtendedBatch:
    """Base of `CaveBatch` and `BoatBatch`, which fill its attributes."""

    num: int
    contacts: Contacts = "own"
    world: Any
    """A `BatchWorld` or a `BoatWorld`."""
    _actions: ActionModel
    _own: Extensions
    _parts: DictObservation | None
    """None where one array is observed."""

    @property
    def dynamics(self) -> dict[str, Array]:
        """(N,) what each episode has drawn of its vehicle's dynamics, by name: see `sim.randomisation`."""
        drawn: dict[str, Array] = self.world.dynamics
        return drawn

    @property
    def term_names(self) -> tuple[str, ...]:
        """Of the columns of "terms"."""
        return self._own.term_names

    @property
    def failures(self) -> dict[int, str]:
        """Why code of the user's own failed in the last reset or step, by vehicle."""
        return self._own.failures

    def command(self, actions: Any) -> None:
        """Hand the actions of all vehicles to the next step."""
        self.set_commands(self._actions.commands(actions, self.num))

    def set_commands(self, commands: Floats) -> None:
        """Hand (N, 3) ballast, of which boats have none, steer and thrust in [-1, 1] to the next step."""
        self.world.write("commands", commands)

    def retire(self, vehicles: Sequence[int]) -> None:
        """Let no episode follow of these vehicles until the next reset; in caves they are moved all the same."""
        self.world.retire(vehicles)

    def step(self) -> None:
        """Carry out a decision of every vehicle."""
        self._own.before()
        self.world.step(self._judge)
        self._own.after()
        if self._parts is not None:
            self._parts.follow()

    def view_of(self, name: str) -> Any:
        """Return an array of a `Batch`, which later steps change; of a `Dict`, one for each part."""
        if self._parts is not None and name in OBSERVATIONS:
            return getattr(self._parts, name)
        own = self._own.arrays
        return own[name] if name in own else self.world.as_numpy(name)

    def copy_of(self, name: str) -> Any:
        """Return a copy of what `view_of` returns that later steps leave alone."""
        return copied(self.view_of(name))

    def close(self) -> None:
        """End the threads, and let go of the physics. Closing twice does nothing."""
        self._own.close()
        if self._parts is not None:
            self._parts.close()
        self.world.close()

    def _begin_observing(self) -> None:
        """Let the user's own code and the parts see the beginning of all episodes."""
        self._own.begin()
        if self._parts is not None:
            self._parts.begin()

    def _judge(self) -> None:
        """Look at what the decision led to, before the successors of ended episodes begin."""
        self._own.judge()
        if self._parts is not None:
            self._parts.judge()
