"""What the oracle advised: the memory that imitation learns from.

A policy that learned of the last decisions alone would forget what to do where it no longer comes; so it learns of all
that it has been advised so far, or of the most that the memory holds (data set aggregation: Ross, Gordon and Bagnell, A
Reduction of Imitation Learning and Structured Prediction to No-Regret Online Learning, 2011, arXiv:1011.0686).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch


class AdviceMemory:
    """The last decisions of a lesson with the oracle's choices; the oldest make room for others."""

    arrays = ("observations", "advice")
    """Names of those that a checkpoint keeps."""

    def __init__(self, size: int, width: int) -> None:
        """Make room for `size` decisions, in which `width` values are observed."""
        self.buffer_size, self.pos, self.full = size, 0, False
        self.observations = np.zeros((size, width), dtype=np.float16)
        """Scaled to about 1, of which 16 bits resolve a two-thousandth."""
        self.advice = np.zeros((size, 3), dtype=np.int8)

    def __len__(self) -> int:
        return self.buffer_size if self.full else self.pos

    def add(self, observations: npt.NDArray[np.float32], advice: npt.NDArray[np.int64]) -> None:
        """Remember (N, V) observations and (N, 3) choices; of more than there is room for the last ones."""
        rows = (self.pos + np.arange(len(observations))) % self.buffer_size
        last = slice(-self.buffer_size, None)
        self.observations[rows[last]], self.advice[rows[last]] = observations[last], advice[last]
        self.full |= self.pos + len(observations) >= self.buffer_size
        self.pos = int(rows[-1] + 1) % self.buffer_size

    def draw(self, num: int) -> tuple[torch.Tensor, torch.Tensor]:
        """Return (num, V) observations and the (num, 3) choices there, at random."""
        rows = np.random.randint(len(self), size=num)  # NumPy's global generator, as for minibatches
        observations = torch.from_numpy(self.observations[rows].astype(np.float32))
        return observations, torch.from_numpy(self.advice[rows].astype(np.int64))
