"""Untrained Stable-Baselines3 models to save and load."""

from __future__ import annotations

from typing import Any

import gymnasium
import torch
from gymnasium import spaces
from stable_baselines3 import DQN, PPO, SAC, TD3
from stable_baselines3.common.base_class import BaseAlgorithm

ACTIONS = {
    "multidiscrete": spaces.MultiDiscrete([3, 3, 3]),
    "discrete": spaces.Discrete(27),
    "continuous": spaces.Box(-1.0, 1.0, (3,)),
}


class Still(gymnasium.Env[Any, Any]):
    """An environment in which nothing happens: only its spaces matter here."""

    def __init__(self, action_space: spaces.Space[Any], num_observations: int = 44) -> None:
        self.observation_space = spaces.Box(-1.0, 1.0, (num_observations,))
        self.action_space = action_space


def make_model(
    kind: type[BaseAlgorithm] = PPO,
    action: str | spaces.Space[Any] = "multidiscrete",
    num_observations: int = 44,
    **policy_kwargs: Any,
) -> BaseAlgorithm:
    """A network as aquanav-train makes it, unless `policy_kwargs` say otherwise."""
    kwargs = policy_kwargs or {"net_arch": [128, 128, 128], "activation_fn": torch.nn.SiLU}
    space = ACTIONS[action] if isinstance(action, str) else action
    return model_for(kind, Still(space, num_observations), **kwargs)


def model_for(kind: type[BaseAlgorithm], env: gymnasium.Env[Any, Any], **policy_kwargs: Any) -> BaseAlgorithm:
    """An untrained model that learns from very few steps."""
    name = "MlpLstmPolicy" if kind.__name__ == "RecurrentPPO" else "MlpPolicy"
    few: dict[str, Any] = {"buffer_size": 64, "learning_starts": 8} if kind in (DQN, SAC, TD3) else {"n_steps": 16}
    few |= {} if kind.__name__ == "A2C" else {"batch_size": 8}
    return kind(name, env, policy_kwargs=policy_kwargs, seed=0, device="cpu", **few)
