"""PPO whose update does the sums of Stable-Baselines3's with less work around them.

The result is that of `stable_baselines3.PPO` but for rounding, and what is saved is one of its zips. The actor and the
critic are two networks that share nothing but the limit on their gradient: each learns in a thread of its own, with
gradients (`towers.py`, `objectives.py`) and steps (`descent.py`) written by hand, so that the result does not depend on
the threads. Observations are scaled once per update instead of once per minibatch, as their statistics stand still
meanwhile, and numbers for the log are read at the end.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.buffers import RolloutBuffer
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import explained_variance
from stable_baselines3.common.vec_env import VecEnv

from aquanav_tools.train.collecting import collect, features_of, towers_of
from aquanav_tools.train.descent import Descent, Meeting
from aquanav_tools.train.objectives import Told, want_choices, want_levels
from aquanav_tools.train.towers import Tower

Rows = torch.Tensor
"""Numbers of the decisions in a minibatch."""
Grade = Callable[[Rows], tuple[float, ...]]
"""Writes a network's gradients for a minibatch; returns numbers for the log."""


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
        clip = float(self.clip_range(self._current_progress_remaining))  # type: ignore[operator]  # made a schedule
        columns = self._columns()
        actor, critic = towers_of(policy)
        of_log_std = [policy.log_std] if isinstance(self.action_space, spaces.Box) else []
        gradients = [torch.zeros_like(one) for one in of_log_std]
        acting = Descent(policy.optimizer, [*actor.parameters, *of_log_std], [*actor.gradients, *gradients])
        valuing = Descent(policy.optimizer, critic.parameters, critic.gradients)
        batches, meeting = self._batches(), Meeting(self.max_grad_norm)
        with ThreadPoolExecutor(1) as helper:
            judged = helper.submit(_descend, 1, valuing, self._judge(critic, columns), batches, meeting)
            acted = _descend(0, acting, self._act(actor, columns, clip, gradients), batches, meeting)
            losses = judged.result()
        self._n_updates += self.n_epochs
        self._tell(np.hstack([acted, losses]), clip)

    def _columns(self) -> dict[str, torch.Tensor]:
        """Return what an update learns from: one row per decision, its features in place of its observation."""
        buffer = self.rollout_buffer
        names = ("observations", "actions", "log_probs", "advantages", "returns")
        columns = {name: torch.from_numpy(RolloutBuffer.swap_and_flatten(getattr(buffer, name))) for name in names}
        columns["features"] = features_of(self.policy, columns.pop("observations"))
        return columns

    def _batches(self) -> list[Rows]:
        """Return the minibatches of all passes, each pass in an order of its own; the last of a pass may be smaller."""
        num = self.rollout_buffer.buffer_size * self.rollout_buffer.n_envs
        passes = [torch.from_numpy(np.random.permutation(num)) for _ in range(self.n_epochs)]
        return [rows for order in passes for rows in torch.split(order, self.batch_size)]

    def _act(
        self, actor: Tower, columns: dict[str, torch.Tensor], clip: float, of_log_std: list[torch.Tensor]
    ) -> Grade:
        """Return what writes the actor's gradients, and `of_log_std` where actions are levels, and returns `Told`."""
        names = ("actions", "log_probs", "advantages")
        price = float(self.ent_coef)

        def grade(rows: Rows) -> Told:
            actions, old, advantages = (columns[name][rows].numpy() for name in names)
            raw = actor.ahead(columns["features"][rows])
            gradient = torch.empty_like(raw)
            decided = (actions, old.ravel(), advantages.ravel())
            if of_log_std:
                log_std: Any = self.policy.log_std
                spread = (log_std.detach().numpy(), *decided, clip, price)
                told = want_levels(raw.numpy(), *spread, gradient.numpy(), of_log_std[0].numpy())
            else:
                told = want_choices(raw.numpy(), *decided, actions.shape[1], clip, price, gradient.numpy())
            actor.back(gradient)
            return Told(*told)

        return grade

    def _judge(self, critic: Tower, columns: dict[str, torch.Tensor]) -> Grade:
        """Return what writes the critic's gradients, and returns the mean square of its error."""

        def grade(rows: Rows) -> tuple[float]:
            error = critic.ahead(columns["features"][rows]) - columns["returns"][rows].view(-1, 1)
            critic.back(error * (2.0 * self.vf_coef / len(error)))
            return (float(error.square().mean()),)

        return grade

    def _tell(self, told: np.ndarray, clip: float) -> None:
        """Log what SB3 logs, by its names, of (M, 5) numbers of M minibatches."""
        names = ("entropy_loss", "policy_gradient_loss", "approx_kl", "clip_fraction", "value_loss")
        for name, mean in zip(names, told.mean(axis=0).tolist(), strict=True):
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


def _descend(side: int, descent: Descent, grade: Grade, batches: Sequence[Rows], meeting: Meeting) -> np.ndarray:
    """Take one network through all minibatches; return what was told of each, (M, numbers)."""
    told = []
    try:
        for step, rows in enumerate(batches):
            told.append(grade(rows))
            descent.step(meeting.scale(step, side, descent.square()))
    except BaseException:
        meeting.give_up()  # else the other side would wait for ever
        raise
    descent.end()
    return np.array(told, dtype=float)
