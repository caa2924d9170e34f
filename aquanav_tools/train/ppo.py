"""Stable-Baselines3's PPO with a faster update: the same sums, but for rounding, and the same zips.

`ParallelPPO._update` is one minibatch: losses, gradients by autograd, their joint norm clipped, a step of Adam. Four
things make it faster than SB3's. Actor and critic share no weights, so that each computes its loss and gradients in a
thread of its own, with a result that does not depend on the threads. Observations are normalised once per update
instead of once per minibatch, as their statistics do not change meanwhile. Choices are one array (`distributions.py`).
Adam updates each array in one fused pass.

Source: Schulman et al., Proximal Policy Optimization Algorithms (2017, arXiv:1707.06347), equation 7.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import explained_variance
from stable_baselines3.common.vec_env import VecEnv
from torch import nn
from torch.nn.functional import mse_loss

from aquanav_tools.train.advice import AdviceMemory
from aquanav_tools.train.distributions import action_distribution
from aquanav_tools.train.rollout import collect_rollouts, features_of

GOLDEN = (5.0**0.5 - 1.0) / 2.0
EPSILON = 1e-8
"""Added to the standard deviation of advantages, as in SB3."""


class Batch(NamedTuple):
    """What an update learns from: a row per decision."""

    features: torch.Tensor
    """(N, F) normalised observations."""
    actions: torch.Tensor
    """(N, K) choices or levels."""
    log_probs: torch.Tensor
    """(N,) of the actions, when they were chosen."""
    advantages: torch.Tensor
    """(N,); in minibatches each has the mean 0 and the standard deviation 1."""
    returns: torch.Tensor
    """(N,)."""


class Advice(NamedTuple):
    """What imitation learns from: a row per decision."""

    features: torch.Tensor
    """(N, F) normalised observations."""
    choices: torch.Tensor
    """(N, 3) the oracle's."""


class Losses(NamedTuple):
    """Of a minibatch; all of PPO's own are 0 where the actor learns by imitation alone."""

    entropy: torch.Tensor
    """Its mean, with the other sign."""
    policy: torch.Tensor
    value: torch.Tensor
    imitation: torch.Tensor
    """Mean of the cross-entropy of the oracle's choices."""
    log_ratio: torch.Tensor
    """(N,) logarithms of how much more probable the actions have become since they were chosen."""


class ParallelPPO(PPO):
    """SB3's PPO for networks whose feature extractor learns nothing; no target_kl, no clip_range_vf, no gSDE."""

    def __init__(
        self,
        *args: Any,
        precision: str = "float32",
        imitation: tuple[float, float] = (0.0, 0.0),
        memory: int = 0,
        greedy: float = 0.0,
        **kwargs: Any,
    ) -> None:
        """Take SB3's arguments.

        Args:
            args: SB3's.
            precision: Of the products in the networks: float32, or bfloat16 (weights and losses stay float32).
            imitation: Share of the actor's loss that is imitation of the oracle, at the beginning and at the end.
            memory: Decisions that imitation learns from at most.
            greedy: Share of the environments that take the likeliest action, from which PPO itself does not learn.
            kwargs: SB3's.
        """
        self.precision, self._imitation, self._memory, self._greedy = precision, imitation, memory, greedy
        self.teacher: Callable[[], np.ndarray] | None = None
        """Returns the (N, 3) choices of now; given where the share is not 0 throughout."""
        self.replay_buffer: AdviceMemory | None = None
        """What imitation learns from, under the name by which checkpoints know what a learner remembers."""
        self.advice = np.zeros((0, 0, 3), dtype=np.int64)
        """(T, N, 3) the oracle's choices in the rollout, where it is asked."""
        self.greedy = torch.zeros(0, dtype=torch.bool)
        """(N,) environments that take the likeliest action."""
        super().__init__(*args, **kwargs)

    def _setup_model(self) -> None:
        super()._setup_model()
        # Evenly among caves and mirrors: multiples of the golden ratio. PPO needs one of the others.
        order = np.argsort(np.arange(self.n_envs) * GOLDEN % 1.0)
        self.greedy = torch.zeros(self.n_envs, dtype=torch.bool)
        self.greedy[order[: min(round(self._greedy * self.n_envs), self.n_envs - 1)]] = True
        if any(self._imitation):
            self.advice = np.zeros((self.n_steps, self.n_envs, 3), dtype=np.int64)
            self.replay_buffer = AdviceMemory(self._memory, spaces.flatdim(self.observation_space))

    @property
    def imitation_share(self) -> float:
        """Share of the actor's loss that is imitation now."""
        first, last = self._imitation
        return last + (first - last) * max(self._current_progress_remaining, 0.0)

    def _excluded_save_params(self) -> list[str]:
        ours = ("advice", "teacher", "replay_buffer", "greedy", "_imitation", "_memory", "_greedy")
        return [*super()._excluded_save_params(), *ours]

    def actor(self, features: torch.Tensor) -> torch.Tensor:
        """Return logits, or the means of levels, (N, K), for (N, F) features."""
        policy: Any = self.policy
        with self._autocast():
            output: torch.Tensor = policy.action_net(policy.mlp_extractor.policy_net(features))
        return output.float()

    def critic(self, features: torch.Tensor) -> torch.Tensor:
        """Return (N, 1) values for (N, F) features."""
        policy: Any = self.policy
        with self._autocast():
            output: torch.Tensor = policy.value_net(policy.mlp_extractor.value_net(features))
        return output.float()

    def _autocast(self) -> torch.autocast:
        return torch.autocast("cpu", torch.bfloat16, enabled=self.precision == "bfloat16", cache_enabled=False)

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Fill the buffer; return whether the callback let it finish."""
        with _one_thread() as helper:
            return collect_rollouts(self, callback, rollout_buffer, n_rollout_steps, helper)

    def train(self) -> None:
        """Learn from the rollout that was collected."""
        policy: Any = self.policy
        policy.set_training_mode(True)
        self._update_learning_rate(policy.optimizer)
        policy.optimizer.param_groups[0]["fused"] = True  # also where an older checkpoint says otherwise
        clip_range = float(self.clip_range(self._current_progress_remaining))  # type: ignore[operator]  # a schedule
        rollout = self._rollout()
        parameters = list(policy.parameters())
        with _one_thread() as critic_thread:
            losses = [
                self._update(batch, self._advised(len(batch.features)), clip_range, parameters, critic_thread)
                for _ in range(self.n_epochs)
                for batch in _minibatches(rollout, self.batch_size)
            ]
        self._n_updates += self.n_epochs
        self._log(_statistics(losses, clip_range), clip_range)

    def _rollout(self) -> Batch:
        """Return the decisions of the rollout to learn from; where all is imitation, they teach the critic alone."""
        buffer = self.rollout_buffer
        names = ("observations", "actions", "log_probs", "advantages", "returns")
        columns = [torch.from_numpy(_flat(getattr(buffer, name))) for name in names]
        observations, actions, log_probs, advantages, returns = columns
        if self.replay_buffer is not None:
            self.replay_buffer.add(observations.numpy(), _flat(self.advice))
        features = features_of(self.policy, observations)
        batch = Batch(features, actions, log_probs.flatten(), advantages.flatten(), returns.flatten())
        if not self.greedy.any() or self.imitation_share == 1.0:
            return batch
        by_chance = ~self.greedy.repeat_interleave(self.n_steps)
        return Batch(*(column[by_chance] for column in batch))

    def _advised(self, num: int) -> Advice | None:
        """Return so many decisions to imitate; None where nothing is imitated."""
        if self.replay_buffer is None or not self.imitation_share:
            return None
        observations, choices = self.replay_buffer.draw(num)
        return Advice(features_of(self.policy, observations), choices)

    def _update(
        self,
        batch: Batch,
        advised: Advice | None,
        clip_range: float,
        parameters: list[nn.Parameter],
        critic_thread: Executor,
    ) -> Losses:
        """Take one step of the optimiser."""
        policy: Any = self.policy
        policy.optimizer.zero_grad()
        critic = critic_thread.submit(self._backward_critic, batch)
        entropy_loss, policy_loss, imitation, log_ratio = self._backward_actor(batch, advised, clip_range)
        value_loss = critic.result()
        nn.utils.clip_grad_norm_(parameters, self.max_grad_norm)
        policy.optimizer.step()
        return Losses(entropy_loss, policy_loss, value_loss, imitation, log_ratio)

    def _backward_actor(self, batch: Batch, advised: Advice | None, clip_range: float) -> tuple[torch.Tensor, ...]:
        """Compute the actor's gradients; return `Losses` but the critic's."""
        share = 0.0 if advised is None else self.imitation_share
        policy_loss = entropy_loss = imitation = torch.zeros(())
        log_ratio = torch.zeros_like(batch.advantages)
        if advised is not None:
            imitation = -action_distribution(self.policy, self.actor(advised.features)).log_prob(advised.choices).mean()
            (share * imitation).backward()
        if share < 1.0:
            policy_loss, entropy_loss, log_ratio = self._actor_losses(batch, clip_range)
            ((1.0 - share) * policy_loss + self.ent_coef * entropy_loss).backward()  # type: ignore[no-untyped-call]
        return entropy_loss.detach(), policy_loss.detach(), imitation.detach(), log_ratio.detach()

    def _actor_losses(self, batch: Batch, clip_range: float) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Return PPO's loss, the entropy's, and the logarithms of the ratios, (N,)."""
        distribution = action_distribution(self.policy, self.actor(batch.features))
        log_ratio = distribution.log_prob(batch.actions) - batch.log_probs
        ratio = log_ratio.exp()
        clipped = ratio.clamp(1.0 - clip_range, 1.0 + clip_range)
        policy_loss = -torch.min(batch.advantages * ratio, batch.advantages * clipped).mean()
        return policy_loss, -distribution.entropy().mean(), log_ratio

    def _backward_critic(self, batch: Batch) -> torch.Tensor:
        """Compute the critic's gradients; return the mean square of its error."""
        values = self.critic(batch.features).flatten()
        loss = mse_loss(values, batch.returns)
        (self.vf_coef * loss).backward()  # type: ignore[no-untyped-call]
        return loss.detach()

    def _log(self, stats: dict[str, torch.Tensor], clip_range: float) -> None:
        """Log what SB3 logs, by its names, of the statistics of all minibatches."""
        for name, values in stats.items():
            self.logger.record(f"train/{name}", float(values.mean()))
        last = {name: float(values[-1]) for name, values in stats.items()}
        loss = last["policy_gradient_loss"] + self.ent_coef * last["entropy_loss"] + self.vf_coef * last["value_loss"]
        self.logger.record("train/loss", loss)
        buffer = self.rollout_buffer
        explained = explained_variance(buffer.values.flatten(), buffer.returns.flatten())
        self.logger.record("train/explained_variance", explained)
        if hasattr(self.policy, "log_std"):
            self.logger.record("train/std", float(self.policy.log_std.detach().exp().mean()))
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/clip_range", clip_range)


def _one_thread() -> ThreadPoolExecutor:
    """Return a thread whose matrix products start no threads of their own.

    What torch is told of threads holds for the one that says so. On a busy machine two that spin until the other has
    its turn made an update fifteen times as long.
    """
    return ThreadPoolExecutor(1, initializer=torch.set_num_threads, initargs=(1,))


def _flat(values: np.ndarray) -> np.ndarray:
    """Return (N, K) values of (steps, environments, K) ones, or of one for each, in the buffer's order."""
    flat: np.ndarray = RolloutBuffer.swap_and_flatten(values)
    return flat


def _minibatches(rollout: Batch, size: int) -> Iterator[Batch]:
    """Yield all decisions in a random order, `size` at a time; the last may be fewer."""
    order = torch.from_numpy(np.random.permutation(len(rollout.features)))
    columns = Batch(*(column.index_select(0, order) for column in rollout))
    for part in torch.split(columns.advantages, size):
        if len(part) > 1:  # a single one has no deviation and stays as it is
            deviation, mean = torch.std_mean(part)
            part.sub_(mean).div_(deviation + EPSILON)
    shuffled = (torch.split(column, size) for column in columns)
    return (Batch(*parts) for parts in zip(*shuffled, strict=True))


def _statistics(losses: list[Losses], clip_range: float) -> dict[str, torch.Tensor]:
    """Return (M,) statistics of M minibatches, by the names that SB3 logs them by.

    `approx_kl` is the Kullback-Leibler divergence from the policy that chose the actions, by Schulman's estimator
    (ratio - 1) - log; `clip_fraction` the share of decisions whose ratio of probabilities is out of the clip range.
    """
    sizes = [len(one.log_ratio) for one in losses]
    log_ratio = torch.cat([one.log_ratio for one in losses])
    change = log_ratio.exp() - 1.0

    def means(values: torch.Tensor) -> torch.Tensor:
        return torch.stack([part.mean() for part in torch.split(values, sizes)])

    return {
        "entropy_loss": torch.stack([one.entropy for one in losses]),
        "policy_gradient_loss": torch.stack([one.policy for one in losses]),
        "approx_kl": means(change - log_ratio),
        "clip_fraction": means((change.abs() > clip_range).float()),
        "value_loss": torch.stack([one.value for one in losses]),
        "imitation_loss": torch.stack([one.imitation for one in losses]),
    }
