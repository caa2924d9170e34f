"""PPO whose update does the sums of Stable-Baselines3's with less work around them.

The result is that of `stable_baselines3.PPO` but for rounding, and what is saved is one of its zips. Observations are
scaled once per update instead of once per minibatch, as their statistics stand still meanwhile; a pass over the buffer
is shuffled at once; choices are scored without objects for their distributions; numbers for the log are read at the
end; and Adam is torch's fused one.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.utils import explained_variance
from torch.nn import functional

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
    """Stable-Baselines3's PPO with a faster update, for networks whose feature extractor learns nothing."""

    def train(self) -> None:
        """Learn from the decisions that were collected."""
        policy: Any = self.policy
        policy.set_training_mode(True)
        self._update_learning_rate(policy.optimizer)
        for group in policy.optimizer.param_groups:
            group["fused"] = True
        clip = float(self.clip_range(self._current_progress_remaining))  # type: ignore[operator]  # made a schedule
        decisions = self._decisions()
        parameters = list(policy.parameters())
        told: list[torch.Tensor] = []
        for _ in range(self.n_epochs):
            shuffled = decisions.rows(torch.from_numpy(np.random.permutation(len(decisions.returns))))
            for first in range(0, len(decisions.returns), self.batch_size):
                loss, losses = self._loss(shuffled.rows(slice(first, first + self.batch_size)), clip)
                policy.optimizer.zero_grad()
                loss.backward()  # type: ignore[no-untyped-call]
                torch.nn.utils.clip_grad_norm_(parameters, self.max_grad_norm)
                policy.optimizer.step()
                told.append(losses)
            self._n_updates += 1
        self._tell(torch.stack(told), clip)

    def _decisions(self) -> _Decisions:
        buffer, policy = self.rollout_buffer, self.policy
        flat = {
            name: torch.from_numpy(RolloutBuffer.swap_and_flatten(getattr(buffer, name)))
            for name in ("observations", "actions", "log_probs", "advantages", "returns")
        }
        with torch.no_grad():
            features = policy.extract_features(flat["observations"])
        assert isinstance(features, torch.Tensor)
        numbers = (flat[name].flatten() for name in ("log_probs", "advantages", "returns"))
        return _Decisions(features, flat["actions"], *numbers)

    def _loss(self, part: _Decisions, clip: float) -> tuple[torch.Tensor, torch.Tensor]:
        """Return the loss of a minibatch, and (6,) numbers for the log without gradients."""
        policy: Any = self.policy
        for_policy, for_value = policy.mlp_extractor(part.features)
        log_probs, entropy = score(policy, self.action_space, for_policy, part.actions)
        advantages = (part.advantages - part.advantages.mean()) / (part.advantages.std() + TINY)
        log_ratio = log_probs - part.old_log_probs
        ratio = log_ratio.exp()
        policy_loss = -torch.min(advantages * ratio, advantages * ratio.clamp(1.0 - clip, 1.0 + clip)).mean()
        value_loss = functional.mse_loss(part.returns, policy.value_net(for_value).flatten())
        entropy_loss = -entropy.mean()
        loss = policy_loss + self.ent_coef * entropy_loss + self.vf_coef * value_loss
        with torch.no_grad():
            divergence = (ratio - 1.0 - log_ratio).mean()
            clipped = ((ratio - 1.0).abs() > clip).float().mean()
        numbers = [entropy_loss, policy_loss, value_loss, divergence, clipped, loss]
        return loss, torch.stack([number.detach() for number in numbers])

    def _tell(self, told: torch.Tensor, clip: float) -> None:
        """Log what SB3 logs, by its names."""
        means = told.double().mean(dim=0).tolist()
        names = ("entropy_loss", "policy_gradient_loss", "value_loss", "approx_kl", "clip_fraction")
        for name, mean in zip(names, means[:-1], strict=True):
            self.logger.record(f"train/{name}", mean)
        buffer = self.rollout_buffer
        self.logger.record("train/loss", float(told[-1, -1]))
        self.logger.record(
            "train/explained_variance", explained_variance(buffer.values.flatten(), buffer.returns.flatten())
        )
        if hasattr(self.policy, "log_std"):
            self.logger.record("train/std", float(self.policy.log_std.detach().exp().mean()))
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        self.logger.record("train/clip_range", clip)


def score(
    policy: Any, space: spaces.Space[Any], latent: torch.Tensor, actions: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the (N,) log probabilities of actions, and the (N,) entropies of the distributions they came from.

    Args:
        policy: SB3's.
        space: Of the actions: choices of equal number, or a box.
        latent: (N, L) what the policy's last layer takes.
        actions: (N, A) as floats.
    """
    raw = policy.action_net(latent)
    if isinstance(space, spaces.Box):
        log_std = policy.log_std
        error = (actions - raw) * (-log_std).exp()
        log_probs = -(0.5 * error * error + log_std + 0.5 * math.log(2.0 * math.pi)).sum(dim=-1)
        entropy = (0.5 + 0.5 * math.log(2.0 * math.pi) + log_std).sum().expand(len(actions))
        return log_probs, entropy
    chosen = actions.long().reshape(len(actions), -1, 1)
    logs = raw.reshape(len(actions), chosen.shape[1], -1).log_softmax(dim=-1)
    return logs.gather(-1, chosen).sum(dim=(1, 2)), -(logs.exp() * logs).sum(dim=(1, 2))
