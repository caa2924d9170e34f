"""Distributions of actions, with the sums and draws of Stable-Baselines3's.

Its one for several choices makes a distribution of each, on arrays of three columns: in PPO's update that costs as much
as a hidden layer. Here all choices are one array with the decisions last, along which torch vectorises.
"""

from __future__ import annotations

from typing import Any

import torch
from gymnasium import spaces
from torch.distributions import Independent, Normal


class Choices:
    """Independent choices among as many options each; methods as those of torch's distributions."""

    def __init__(self, logits: torch.Tensor, num_choices: int) -> None:
        """Take (N, num_choices * options) logits."""
        self._log_probs = logits.t().reshape(num_choices, -1, len(logits)).log_softmax(dim=1)

    def sample(self) -> torch.Tensor:
        """Return (N, num_choices) options."""
        drawn = [torch.multinomial(probs.t(), 1, replacement=True) for probs in self._log_probs.exp()]
        return torch.cat(drawn, dim=1)

    @property
    def mode(self) -> torch.Tensor:
        """(N, num_choices) likeliest options."""
        return self._log_probs.argmax(dim=1).t()

    def log_prob(self, actions: torch.Tensor) -> torch.Tensor:
        """Return (N,) log-probabilities of (N, num_choices) options, which may be whole floats."""
        chosen = actions.long().t().unsqueeze(1)
        return self._log_probs.gather(1, chosen).sum(dim=(0, 1))

    def entropy(self) -> torch.Tensor:
        """Return (N,) entropies."""
        return -(self._log_probs.exp() * self._log_probs).sum(dim=(0, 1))


def action_distribution(policy: Any, output: torch.Tensor) -> Choices | Independent[Any]:
    """Return the distribution of actions that an SB3 policy's actor stands for.

    Args:
        policy: With choices among as many options each, or with levels.
        output: (N, K) of the actor: logits, or means of the levels.
    """
    space = policy.action_space
    if isinstance(space, spaces.Box):
        levels = Normal(output, policy.log_std.exp(), validate_args=False)
        return Independent(levels, 1, validate_args=False)
    return Choices(output, len(space.nvec) if isinstance(space, spaces.MultiDiscrete) else 1)
