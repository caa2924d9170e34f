"""Observations scaled by what was seen while learning, as a part of the network: no policy can be run without it."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

LIMIT = 5.0
"""Standard deviations at which scaled observations are clipped, as in the original (ML-Agents)."""
HIDDEN = 1e9
"""Variance of a value that is kept from the network: what is left of it is below 1e-4 standard deviations."""
EPSILON = 1e-8
"""Added to the variance: an observation that never changed is not divided by zero."""


class NormalisedObservations(BaseFeaturesExtractor):
    """Subtracts the running mean, divides by the running standard deviation, and clips at LIMIT.

    Both are buffers of the network, so that they are saved and loaded with its weights. They change only by `take_in`:
    while actions are chosen and learned from, they stand still.
    """

    mean: torch.Tensor
    variance: torch.Tensor
    count: torch.Tensor

    def __init__(self, observation_space: spaces.Box) -> None:
        """Begin with mean 0 and variance 1: observations pass as they are."""
        size = math.prod(observation_space.shape)
        super().__init__(observation_space, features_dim=size)
        self.register_buffer("mean", torch.zeros(size))
        self.register_buffer("variance", torch.ones(size))
        self.register_buffer("count", torch.zeros((), dtype=torch.int64))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return (N, size) scaled observations."""
        return torch.clamp((observations.flatten(1) - self.mean) * self.scale, -LIMIT, LIMIT)

    @property
    def scale(self) -> torch.Tensor:
        """(size,) by which centred observations are multiplied."""
        return torch.rsqrt(self.variance + EPSILON)

    def take_in(self, observations: np.ndarray) -> None:
        """Add (N, size) observations to the mean and variance of all that were seen.

        Source: Chan, Golub and LeVeque, Updating formulae and a pairwise algorithm for computing sample variances
        (1979).
        """
        batch = observations.reshape(len(observations), -1).astype(np.float64)
        seen, total = int(self.count), int(self.count) + len(batch)
        mean, variance = (buffer.numpy().astype(np.float64) for buffer in (self.mean, self.variance))
        shift = batch.mean(axis=0) - mean
        squares = seen * variance + len(batch) * batch.var(axis=0) + shift**2 * seen * len(batch) / total
        self.mean.copy_(torch.from_numpy(mean + shift * len(batch) / total))
        self.variance.copy_(torch.from_numpy(squares / total))
        self.count.fill_(total)

    def hide(self, indices: Sequence[int]) -> None:
        """Keep values from the network; to be repeated after each `take_in`."""
        self.variance[list(indices)] = HIDDEN
