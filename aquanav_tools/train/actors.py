"""What a policy computes when it acts without chance, as a chain of plain layers."""

from __future__ import annotations

from typing import Any

import torch
from gymnasium import spaces
from stable_baselines3.common.policies import ActorCriticPolicy, BasePolicy
from stable_baselines3.sac.policies import SACPolicy
from stable_baselines3.td3.policies import TD3Policy
from torch import nn

from aquanav_tools.errors import InputError


class Actor(nn.Module):
    """From (N, size) observations to (N, ...) actions, as `policy.predict(deterministic=True)` chooses them."""

    def __init__(self, policy: BasePolicy) -> None:
        """Take the layers of a trained policy; they are not copied.

        Raises:
            InputError: the policy has a memory.
        """
        super().__init__()
        self.layers = nn.ModuleList(_layers_of(policy))
        """NormalisedObservations, Flatten, Linear, and activations; the last one's values are logits or levels."""
        self.branches = _branches_of(policy.action_space)
        """Numbers of choices; empty where the action is levels in [-1, 1]."""
        self.num_levels = 0 if self.branches else int(policy.action_space.shape[0])  # type: ignore[index]
        self.is_single = isinstance(policy.action_space, spaces.Discrete)
        self.size = int(policy.observation_space.shape[0])  # type: ignore[index]  # a Box has a shape

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Return the most likely choice of each branch, or the mean of each level."""
        values = observations
        for layer in self.layers:
            values = layer(values)
        if not self.branches:
            return torch.clamp(values, -1.0, 1.0)
        choices = [torch.argmax(logits, dim=1) for logits in torch.split(values, self.branches, dim=1)]
        return choices[0] if self.is_single else torch.stack(choices, dim=1)


def _layers_of(policy: Any) -> list[nn.Module]:
    if type(policy) is ActorCriticPolicy:
        return [policy.pi_features_extractor, *policy.mlp_extractor.policy_net, policy.action_net]
    if type(policy) is SACPolicy:
        return [policy.actor.features_extractor, *policy.actor.latent_pi, policy.actor.mu, nn.Tanh()]
    if type(policy) is TD3Policy:
        return [policy.actor.features_extractor, *policy.actor.mu]
    raise InputError(f"A {type(policy).__name__} cannot be exported: it is more than a chain of layers.")


def _branches_of(space: spaces.Space[Any]) -> list[int]:
    if isinstance(space, spaces.MultiDiscrete):
        return [int(count) for count in space.nvec]
    return [int(space.n)] if isinstance(space, spaces.Discrete) else []
