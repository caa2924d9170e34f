"""Bringing an environment back to where it was: its generator at the episode's start, and the actions since then.

The physics engine's own state cannot be written down, but it is deterministic: the same actions from the same start
lead to the same place, to the bit. Doing them again takes a fraction of a second for each environment.
"""

from __future__ import annotations

import json
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding

Snapshot = dict[str, Any]
"""Where an environment was: {"generator": JSON of the generator's state at the start, "actions": (T, ...) since}."""


class SnapshotEnv(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Remembers how its episode came about."""

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        if seed is not None:
            self.unwrapped.np_random, _ = seeding.np_random(seed)
        self._generator = json.dumps(self.unwrapped.np_random.bit_generator.state)
        self._actions: list[Any] = []
        return self.env.reset(options=options)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Take a decision."""
        self._actions.append(np.array(action))
        return self.env.step(action)

    def snapshot(self) -> Snapshot:
        """Return what `restore` needs to come back here; the episode must not be over."""
        return {"generator": self._generator, "actions": np.array(self._actions)}

    def restore(self, snapshot: Snapshot) -> Any:
        """Go back to a snapshot, also of another environment of the same task, and return the observation there."""
        self.unwrapped.np_random.bit_generator.state = json.loads(snapshot["generator"])
        observation, _ = self.reset()
        for action in snapshot["actions"]:
            observation = self.step(action)[0]
        return observation
