"""Collecting PPO's rollouts: what Stable-Baselines3 does, with fewer passes through the networks.

An action needs the actor alone. The critic's values are computed once, for the whole rollout; SB3 computes them at each
step, which for few environments costs as much as all else.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback

from aquanav_tools.train.distributions import action_distribution

MIN_SPLIT = 128
"""Observations from which on a second thread computes half of them: for fewer it is not worth its start."""
Network = Callable[[torch.Tensor], torch.Tensor]
"""Returns (N, K) output for (N, F) features."""


def collect_rollouts(
    learner: Any, callback: BaseCallback, buffer: RolloutBuffer, num_steps: int, helper: Executor
) -> bool:
    """Fill the buffer with decisions of the policy as it is.

    Args:
        learner: `ppo.ParallelPPO`.
        callback: Gets each step's "infos", "new_obs", "dones" and "rewards"; may stop the rollout.
        buffer: Written from its beginning.
        num_steps: Decisions of each environment.
        helper: A thread for half of the observations.

    Returns:
        Whether the callback let it finish.
    """
    policy = learner.policy
    policy.set_training_mode(False)
    buffer.reset()

    def infer(network: Network, observations: Any) -> torch.Tensor:
        return _infer(network, features_of(policy, observations), helper)

    values_later = torch.zeros(buffer.n_envs)
    callback.on_rollout_start()
    for step in range(num_steps):
        observations = learner._last_obs
        if learner.replay_buffer is not None:  # whatever the share is now: it is another at the update
            learner.advice[step] = learner.teacher()
        with torch.no_grad():
            distribution = action_distribution(policy, infer(learner.actor, observations))
            drawn = distribution.sample()
            drawn[learner.greedy] = distribution.mode[learner.greedy]
            log_probs = distribution.log_prob(drawn)
        actions = drawn.numpy()
        new_observations, rewards, dones, infos = learner.env.step(_allowed(actions, learner.action_space))
        learner.num_timesteps += learner.env.num_envs
        callback.update_locals({"infos": infos, "new_obs": new_observations, "dones": dones, "rewards": rewards})
        if not callback.on_step():
            return False
        ended = np.flatnonzero(dones)
        learner._update_info_buffer([infos[n] for n in ended], dones[ended])
        for n in _timed_out(ended, infos):  # the rewards that would have come count by their estimate
            rewards[n] += learner.gamma * infer(learner.critic, infos[n]["terminal_observation"][None]).item()
        buffer.add(observations, actions, rewards, learner._last_episode_starts, values_later, log_probs)
        learner._last_obs, learner._last_episode_starts = new_observations, dones
    seen = buffer.observations
    buffer.values[:] = infer(learner.critic, seen.reshape(-1, seen.shape[-1])).numpy().reshape(seen.shape[:2])
    buffer.compute_returns_and_advantage(last_values=infer(learner.critic, new_observations), dones=dones)
    callback.on_rollout_end()
    return True


def features_of(policy: Any, observations: Any) -> torch.Tensor:
    """Return (N, F) features of (N, ...) observations, without gradients: the feature extractor learns nothing."""
    with torch.no_grad():
        features: torch.Tensor = policy.extract_features(torch.as_tensor(observations))
    return features


def _infer(network: Network, features: torch.Tensor, helper: Executor) -> torch.Tensor:
    """Return the output without gradients; of many rows, `helper` computes the second half."""

    def run(rows: torch.Tensor) -> torch.Tensor:
        with torch.no_grad():  # holds for the thread that it is said in
            return network(rows)

    if len(features) < MIN_SPLIT:
        return run(features)
    half = len(features) // 2
    second = helper.submit(run, features[half:])
    return torch.cat([run(features[:half]), second.result()])


def _allowed(actions: np.ndarray, space: spaces.Space[Any]) -> np.ndarray:
    """Return actions as the environments take them."""
    if isinstance(space, spaces.Box):
        return np.clip(actions, space.low, space.high)
    return actions.ravel() if isinstance(space, spaces.Discrete) else actions


def _timed_out(ended: np.ndarray, infos: list[dict[str, Any]]) -> list[int]:
    """Return the environments, of those whose episode ended, where time ran out."""
    return [n for n in ended.tolist() if infos[n].get("TimeLimit.truncated") and "terminal_observation" in infos[n]]
