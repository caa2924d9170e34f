"""Proximal policy optimisation (Stable-Baselines3) on one scenario, with the original benchmark's settings.

The original normalises observations with running statistics; ours are scaled to [-1, 1] already, so the policy is
whole without them. Rewards reach 500 at the goal, far from where the value network starts, so they are scaled by the
running spread of the returns while learning; the policy never sees rewards.
"""

from __future__ import annotations

import io
import time
from pathlib import Path
from typing import Any

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import DummyVecEnv, VecEnv, VecNormalize
from tqdm import tqdm

from aquanav_tools.envs.cave_env import CaveEnv
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.task import choices_of
from aquanav_tools.train.episodes import CurvePoint, LearningCurve, SummaryWrapper
from aquanav_tools.train.record import RunRecord
from aquanav_tools.train.settings import TrainSettings


def train(
    scenario: Scenario, settings: TrainSettings, seed: int, output_dir: Path, *, show_progress: bool = False
) -> CurvePoint:
    """Learn a policy and write policy.zip, train.json and curve.csv.

    Args:
        scenario: Where to learn.
        settings: How.
        seed: Of the environments, the network and the sampling. The same seed gives the same policy on one machine.
        output_dir: Folder of the files; made when absent.
        show_progress: Whether to show a bar with the time left on stderr.

    Returns:
        The last point of the learning curve.
    """
    torch.set_num_threads(1)  # more threads are slower on a busy machine, for networks this small
    envs = _make_envs(scenario, settings)
    try:
        model = _make_model(envs, settings, seed)
        keeper = _Keeper(RunRecord(output_dir, scenario, settings, seed), show_progress)
        model.learn(settings.steps, callback=keeper)
        return keeper.curve.points[-1]
    finally:
        envs.close()


def _make_envs(scenario: Scenario, settings: TrainSettings) -> VecEnv:
    def make_env() -> SummaryWrapper:
        return SummaryWrapper(
            CaveEnv(scenario, observation=settings.observation, action=settings.action, **choices_of(settings))
        )

    envs = DummyVecEnv([make_env] * settings.num_envs)
    return VecNormalize(envs, norm_obs=False, norm_reward=True, gamma=settings.discount)


def _make_model(envs: VecEnv, settings: TrainSettings, seed: int) -> PPO:
    return PPO(
        "MlpPolicy",
        envs,
        learning_rate=LinearSchedule(settings.learning_rate, 0.0, 1.0),
        n_steps=settings.buffer // settings.num_envs,
        batch_size=settings.batch,
        n_epochs=settings.epochs,
        gamma=settings.discount,
        gae_lambda=settings.trace,
        clip_range=settings.clip,
        ent_coef=settings.entropy,
        policy_kwargs={"net_arch": list(settings.hidden), "activation_fn": torch.nn.SiLU},
        seed=seed,
        device="cpu",
    )


class _Keeper(BaseCallback):
    """Follows the training: learning curve, progress bar, checkpoints."""

    def __init__(self, record: RunRecord, show_progress: bool) -> None:
        super().__init__()
        self.curve = LearningCurve()
        self._record = record
        self._settings = record.settings
        self._show_progress = show_progress
        self._started = time.perf_counter()
        self._next_checkpoint = record.settings.checkpoint_every

    def _on_training_start(self) -> None:
        self._bar: Any = tqdm(total=self._settings.steps, unit="step", disable=not self._show_progress)

    def _on_step(self) -> bool:
        self.curve.add(self.locals["infos"])
        self._bar.update(self.training_env.num_envs)
        return True

    def _on_rollout_end(self) -> None:
        """Mark the curve before each update; checkpoint when it is time."""
        point = self.curve.mark(self.num_timesteps, self._seconds)
        self._bar.set_postfix_str(f"reward {point.mean_reward:.0f}, success {point.success_rate:.0%}")
        if self.num_timesteps >= self._next_checkpoint:
            self._save(is_finished=False)
            self._next_checkpoint = self.num_timesteps + self._settings.checkpoint_every

    def _on_training_end(self) -> None:
        self._save(is_finished=True)
        self._bar.close()

    @property
    def _seconds(self) -> float:
        return time.perf_counter() - self._started

    def _save(self, *, is_finished: bool) -> None:
        policy = io.BytesIO()
        self.model.save(policy)
        self._record.write(
            policy.getvalue(), self.curve, steps=self.num_timesteps, seconds=self._seconds, is_finished=is_finished
        )
