"""Filling PPO's buffer: what Stable-Baselines3 does, with less around it.

Actions need the policy's network alone; how good each observation is, is asked once, for all of the buffer. SB3 asks at
each decision, which for few environments costs as much as all else.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import Executor
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback

from aquanav_tools.train.towers import Tower

MIN_HALF = 128
"""Observations for which a thread is worth its start."""


def towers_of(policy: Any) -> tuple[Tower, Tower]:
    """Return the layers of SB3's actor and critic, behind their features."""
    networks = policy.mlp_extractor
    return Tower([*networks.policy_net, policy.action_net]), Tower([*networks.value_net, policy.value_net])


class Answers:
    """A network's output for many observations: the helper computes the second half of it."""

    def __init__(self, twins: Sequence[Tower], helper: Executor) -> None:
        """Take the same network twice: each half writes to buffers of its own."""
        self._twins, self._helper = twins, helper

    def __call__(self, features: torch.Tensor) -> torch.Tensor:
        """Return the (N, K) output for (N, F) features."""
        first, second = self._twins
        if len(features) < MIN_HALF:
            return first.ahead(features)
        half = len(features) // 2
        later = self._helper.submit(second.ahead, features[half:])
        return torch.cat([first.ahead(features[:half]), later.result()])


def collect(learner: Any, callback: BaseCallback, buffer: RolloutBuffer, num_steps: int, helper: Executor) -> bool:
    """Fill the buffer with decisions of the policy as it is.

    Args:
        learner: SB3's PPO; its policy's feature extractor learns nothing.
        callback: Told of each step's "infos" and "new_obs"; may stop collecting.
        buffer: Written from its beginning.
        num_steps: Decisions of each environment.
        helper: Asks the networks about half of the observations.

    Returns:
        Whether the callback let it finish.
    """
    policy = learner.policy
    policy.set_training_mode(False)
    buffer.reset()
    act, value = (
        Answers([one, other], helper) for one, other in zip(towers_of(policy), towers_of(policy), strict=True)
    )
    later = torch.zeros(buffer.n_envs)
    callback.on_rollout_start()
    for _ in range(num_steps):
        observations = learner._last_obs
        actions, log_probs = choose(policy, learner.action_space, act(features_of(policy, observations)))
        new_observations, rewards, dones, infos = learner.env.step(_allowed(actions, learner.action_space))
        learner.num_timesteps += learner.env.num_envs
        callback.update_locals({"infos": infos, "new_obs": new_observations, "dones": dones, "rewards": rewards})
        if not callback.on_step():
            return False
        _look_beyond(learner, value, rewards, dones, infos)
        buffer.add(observations, actions, rewards, learner._last_episode_starts, later, log_probs)
        learner._last_obs, learner._last_episode_starts = new_observations, dones
    looks = buffer.observations
    buffer.values[:] = value(features_of(policy, looks.reshape(-1, looks.shape[-1]))).numpy().reshape(looks.shape[:2])
    last_values = value(features_of(policy, new_observations))
    buffer.compute_returns_and_advantage(last_values=last_values, dones=dones)
    callback.on_rollout_end()
    return True


def features_of(policy: Any, observations: Any) -> torch.Tensor:
    """Return (N, F) features of observations, without their gradients."""
    with torch.no_grad():
        features: torch.Tensor = policy.extract_features(torch.as_tensor(observations))
    return features


def choose(policy: Any, space: spaces.Space[Any], raw: torch.Tensor) -> tuple[np.ndarray, torch.Tensor]:
    """Return (N, ...) actions by chance and their (N,) log probabilities, with the draws that SB3 makes.

    Args:
        policy: SB3's.
        space: Of the actions: choices of equal number, or a box.
        raw: (N, K) output of the actor.
    """
    if isinstance(space, spaces.Box):
        with torch.no_grad():
            chance = policy.action_dist.proba_distribution(raw, policy.log_std)
            levels = chance.get_actions()
            return levels.numpy(), chance.log_prob(levels)
    num = len(space.nvec) if isinstance(space, spaces.MultiDiscrete) else 1
    logs = raw.reshape(len(raw), num, -1).log_softmax(dim=-1)
    shares = logs.exp()
    drawn = torch.stack([torch.multinomial(shares[:, n], 1, replacement=True) for n in range(num)], dim=1)
    log_probs = logs.gather(-1, drawn).sum(dim=(1, 2))
    return drawn.squeeze(-1).numpy(), log_probs


def _allowed(actions: np.ndarray, space: spaces.Space[Any]) -> np.ndarray:
    if isinstance(space, spaces.Box):
        return np.clip(actions, space.low, space.high)
    return actions.ravel() if isinstance(space, spaces.Discrete) else actions


def _look_beyond(learner: Any, value: Answers, rewards: np.ndarray, dones: np.ndarray, infos: list[Any]) -> None:
    """Note the episodes that ended; where time ran out, add to the reward what was still to come."""
    ended = [infos[n] for n in np.flatnonzero(dones)]
    if not ended:
        return
    learner._update_info_buffer(ended, dones[dones])
    for n in np.flatnonzero(dones):
        if infos[n].get("TimeLimit.truncated", False) and infos[n].get("terminal_observation") is not None:
            last = infos[n]["terminal_observation"]
            rewards[n] += learner.gamma * value(features_of(learner.policy, last[None])).item()
