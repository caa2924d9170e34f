"""What the paper leaves open: rays that err or get no echo, and commands and observations that come late."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING, Generic, TypeVar

import numpy as np
import numpy.typing as npt

from aquanav_tools.sim.sensors import NOTHING
from aquanav_tools.types import Array

if TYPE_CHECKING:
    from aquanav_tools.sim.batch.disturbance import RayErrors

T = TypeVar("T")
Rays = npt.NDArray[np.float32]
Tags = npt.NDArray[np.int64]


class RaySensorErrors:
    """The errors of one vehicle's rays, which follow from the episode's seed as those of a batch do."""

    def __init__(self, lengths: Array) -> None:
        """Prepare for (R,) rays of these lengths, m; `reset` next."""
        self._lengths, self._seed = lengths, 0
        self._errors: RayErrors | None = None
        self._sizes = (0.0, 0.0)

    def reset(self, rng: np.random.Generator, noise: float, dropout: float) -> None:
        """Begin an episode with `noise` (m) and `dropout` as in `TaskOptions`; where there are any, draw their seed."""
        if self._sizes != (noise, dropout):
            self._sizes, self._errors = (noise, dropout), None
            if noise > 0.0 or dropout > 0.0:
                from aquanav_tools.sim.batch.disturbance import RayErrors

                self._errors = RayErrors(1, self._lengths, noise, dropout)
        if self._errors is not None:
            self._seed = draw_ray_seed(rng)

    def disturb(self, rays: Rays, tags: Tags, decision: int) -> tuple[Rays, Tags]:
        """Return (R,) distances, m, and tags as a real sensor would give them after a number of decisions."""
        if self._errors is None:
            return rays, tags
        (measured,), (is_dropped,) = self._errors.disturb(rays[None], [self._seed], [decision])
        return measured, np.where(is_dropped, NOTHING, tags)


def draw_ray_seed(rng: np.random.Generator) -> int:
    """Return the seed of an episode's ray errors."""
    return int(rng.integers(1 << 32))


class Delay(Generic[T]):
    """A line in which values wait for a number of turns."""

    def __init__(self, turns: int) -> None:
        self._line: deque[T] = deque()
        self._turns = turns

    def fill(self, value: T) -> None:
        """Let every place of the line be taken by one value."""
        self._line = deque([value] * self._turns)

    def through(self, value: T) -> T:
        """Put a value in at the end of the line and return the one at its head."""
        self._line.append(value)
        return self._line.popleft()
