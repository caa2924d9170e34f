"""PPO whose update does the sums of Stable-Baselines3's with less work around them.

The result is that of `stable_baselines3.PPO` but for rounding, and what is saved is one of its zips. The actor and the
critic are two networks that share nothing but the limit on their gradient: each learns in a thread of its own, with
its gradients written by hand (`towers.py`), so that the result does not depend on the threads. Observations are scaled
once per update instead of once per minibatch, as their statistics stand still meanwhile; a pass over the buffer is
shuffled at once; choices are scored without objects for their distributions; numbers for the log are read at the end;
and Adam is torch's fused one.
"""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
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

from aquanav_tools.train.collecting import collect, features_of, towers_of
from aquanav_tools.train.towers import Tower

TINY = 1e-8
"""Added to the advantages' spread, as in SB3."""


class _Decisions(NamedTuple):
    """What an update learns from; one row per decision."""

    features: torch.Tensor
    """(N, F) scaled observations."""
    actions: torch.Tensor
    old_log_probs: torch.Tensor
    advantages: torch.Tensor
    returns: torch.Tensor

    def rows(self, which: Any) -> _Decisions:
        """Return some of the rows."""
        return _Decisions(*(tensor[which] for tensor in self))


class LeanPPO(PPO):
    """Stable-Baselines3's PPO, faster, for swish networks whose feature extractor learns nothing."""

    def collect_rollouts(
        self, env: VecEnv, callback: BaseCallback, rollout_buffer: RolloutBuffer, n_rollout_steps: int
    ) -> bool:
        """Fill the buffer; return whether the callback let it finish."""
        with ThreadPoolExecutor(1) as helper:
            return collect(self, callback, rollout_buffer, n_rollout_steps, helper)

    def train(self) -> None:
        """Learn from the decisions that were collected."""
        policy: Any = self.policy
        policy.set_training_mode(True)
        self._update_learning_rate(policy.optimizer)
        for group in policy.optimizer.param_groups:
            group["fused"] = True
        clip = float(self.clip_range(self._current_progress_remaining))  # type: ignore[operator]  # made a schedule
        decisions, gradient = self._decisions(), _joint_gradient(policy)
        actor, critic = towers_of(policy)
        told: list[torch.Tensor] = []
        with ThreadPoolExecutor(1) as helper:
            for _ in range(self.n_epochs):
                shuffled = decisions.rows(torch.from_numpy(np.random.permutation(len(decisions.returns))))
                for first in range(0, len(decisions.returns), self.batch_size):
                    part = shuffled.rows(slice(first, first + self.batch_size))
                    valuing = helper.submit(self._judge, critic, part)
                    losses = self._act(actor, part, clip)
                    told.append(torch.stack([*losses, valuing.result()]))
                    gradient.mul_((self.max_grad_norm / (gradient.norm() + 1e-6)).clamp(max=1.0))
                    policy.optimizer.step()
                self._n_updates += 1
        self._tell(torch.stack(told), clip)

    def _decisions(self) -> _Decisions:
        buffer = self.rollout_buffer
        flat = {
            name: torch.from_numpy(RolloutBuffer.swap_and_flatten(getattr(buffer, name)))
            for name in ("observations", "actions", "log_probs", "advantages", "returns")
        }
        numbers = (flat[name].flatten() for name in ("log_probs", "advantages", "returns"))
        return _Decisions(features_of(self.policy, flat["observations"]), flat["actions"], *numbers)

    def _act(self, actor: Tower, part: _Decisions, clip: float) -> list[torch.Tensor]:
        """Write the actor's gradients for a minibatch; return entropy loss, policy loss, divergence, share clipped."""
        policy: Any = self.policy
        raw = actor.ahead(part.features).requires_grad_()
        log_probs, entropy = score(policy, self.action_space, raw, part.actions)
        advantages = (part.advantages - part.advantages.mean()) / (part.advantages.std() + TINY)
        log_ratio = log_probs - part.old_log_probs
        ratio = log_ratio.exp()
        policy_loss = -torch.min(advantages * ratio, advantages * ratio.clamp(1.0 - clip, 1.0 + clip)).mean()
        entropy_loss = -entropy.mean()
        learning = [raw, policy.log_std] if isinstance(self.action_space, spaces.Box) else [raw]
        gradient, *others = torch.autograd.grad(policy_loss + self.ent_coef * entropy_loss, learning)
        actor.back(gradient)
        if others:
            policy.log_std.grad.copy_(others[0])
        with torch.no_grad():
            divergence = (ratio - 1.0 - log_ratio).mean()
            clipped = ((ratio - 1.0).abs() > clip).float().mean()
        return [entropy_loss.detach(), policy_loss.detach(), divergence, clipped]

    def _judge(self, critic: Tower, part: _Decisions) -> torch.Tensor:
        """Write the critic's gradients for a minibatch; return the mean square of its error."""
        error = critic.ahead(part.features) - part.returns[:, None]
        critic.back(error * (2.0 * self.vf_coef / len(error)))
        return error.square().mean()

    def _tell(self, told: torch.Tensor, clip: float) -> None:
        """Log what SB3 logs, by its names, of (M, 5) numbers of M minibatches."""
        names = ("entropy_loss", "policy_gradient_loss", "approx_kl", "clip_fraction", "value_loss")
        for name, mean in zip(names, told.double().mean(dim=0).tolist(), strict=True):
            self.logger.record(f"train/{name}", mean)
        buffer = self.rollout_buffer
        last = dict(zip(names, told[-1].tolist(), strict=True))
        loss = last["policy_gradient_loss"] + self.ent_coef * last["entropy_loss"] + self.vf_coef * last["value_loss"]
        self.logger.record("train/loss", loss)
        self.logger.record(
            "train/explained_variance", explained_variance(buffer.values.flatten(), buffer.returns.flatten())
        )
        if hasattr(self.policy, "log_std"):
            self.logger.record("train/std", float(self.policy.log_std.detach().exp().mean()))
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/clip_range", clip)


def _joint_gradient(policy: nn.Module) -> torch.Tensor:
    """Return one tensor of which the gradient of each parameter is a part."""
    parameters = list(policy.parameters())
    sizes = [one.numel() for one in parameters]
    joint = torch.zeros(sum(sizes))
    for one, part in zip(parameters, torch.split(joint, sizes), strict=True):
        one.grad = part.view_as(one)
    return joint


def score(
    policy: Any, space: spaces.Space[Any], raw: torch.Tensor, actions: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the (N,) log probabilities of actions, and the (N,) entropies of the distributions they came from.

    Args:
        policy: SB3's.
        space: Of the actions: choices of equal number, or a box.
        raw: (N, K) output of the actor.
        actions: (N, A) as floats.
    """
    if isinstance(space, spaces.Box):
        log_std = policy.log_std
        error = (actions - raw) * (-log_std).exp()
        log_probs = -(0.5 * error * error + log_std + 0.5 * math.log(2.0 * math.pi)).sum(dim=-1)
        entropy = (0.5 + 0.5 * math.log(2.0 * math.pi) + log_std).sum().expand(len(actions))
        return log_probs, entropy
    chosen = actions.long().reshape(len(actions), -1, 1)
    logs = raw.reshape(len(actions), chosen.shape[1], -1).log_softmax(dim=-1)
    return logs.gather(-1, chosen).sum(dim=(1, 2)), -(logs.exp() * logs).sum(dim=(1, 2))
