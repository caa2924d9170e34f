"""What the paper leaves open: rays that err or get no echo, and commands and observations that come late."""

from __future__ import annotations

from collections import deque
from typing import Generic, TypeVar

import numpy as np
import numpy.typing as npt

from aquanav_tools.sim.spheres import NOTHING
from aquanav_tools.types import Array

T = TypeVar("T")
Rays = npt.NDArray[np.float32]
Tags = npt.NDArray[np.int64]


def disturb_rays(
    rays: Rays, tags: Tags, lengths: Array, noise: float, dropout: float, rng: np.random.Generator
) -> tuple[Rays, Tags]:
    """Return distances and tags as a real sensor would give them.

    Only an echo errs: a ray that meets nothing keeps its full length, and none reads beyond it or below zero.

    Args:
        rays: (R,) distances, m.
        tags: (R,) what the rays met.
        lengths: (R,) of the rays, m.
        noise: Standard deviation of an echo's distance, m.
        dropout: Probability that a ray gets no echo.
        rng: Always draws as many numbers, whatever is measured.
    """
    errors, chances = rng.standard_normal(len(rays)), rng.random(len(rays))
    is_lost = (rays >= lengths.astype(np.float32)) | (chances < dropout)
    measured = np.where(is_lost, lengths, np.clip(rays + noise * errors, 0.0, lengths))
    return measured.astype(np.float32), np.where(chances < dropout, NOTHING, tags)


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
