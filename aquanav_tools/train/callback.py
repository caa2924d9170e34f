"""What happens between two updates: follow the curve, normalise, try out, and write checkpoints."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecNormalize

from aquanav_tools.errors import TrainingError
from aquanav_tools.policy.run_folder import BEST_FILE
from aquanav_tools.store import write_whole
from aquanav_tools.train.cave_rotation import FLOWN, WAITING, CaveRotation
from aquanav_tools.train.checkpoint import CHECKPOINT_FILE, Checkpoint, learner_state
from aquanav_tools.train.environments import Resumable
from aquanav_tools.train.episodes import CurvePoint
from aquanav_tools.train.journal import RunJournal
from aquanav_tools.train.learners import MAX_WEIGHT, has_finite_weights, update_normalisers
from aquanav_tools.train.pipeline import Pipeline
from aquanav_tools.train.record import RunRecord
from aquanav_tools.train.validation import Trials, Validation


class TrainingCallback(BaseCallback):
    """Looks after one lesson."""

    def __init__(
        self,
        pipeline: Pipeline,
        lesson: int,
        record: RunRecord,
        journal: RunJournal,
        trials: Trials,
        bar: Any,
        rotation: CaveRotation | None = None,
    ) -> None:
        super().__init__()
        self._rotation = rotation
        self._run, self._settings = pipeline.run, pipeline.lessons[lesson]
        self._lesson, self._is_last = lesson, lesson == len(pipeline.lessons) - 1
        self._record, self._journal, self._trials, self._bar = record, journal, trials, bar
        self._seen: list[np.ndarray] = []
        self._marked = 0

    def _on_training_start(self) -> None:
        self._marked = self.num_timesteps

    def _on_step(self) -> bool:
        self._journal.curve.add(self.locals["infos"])
        self._seen.append(self.locals["new_obs"])
        self._bar.update(self.training_env.num_envs)
        return True

    def _on_rollout_start(self) -> None:
        """Look after the update that was just finished: the next decision has not been chosen yet."""
        if self.num_timesteps - self._marked >= self._settings.rollout_size:
            self._after_update(is_lesson_over=False)

    def _on_training_end(self) -> None:
        self._after_update(is_lesson_over=True)

    def _after_update(self, *, is_lesson_over: bool) -> None:
        journal, before = self._journal, self._journal.steps
        journal.steps = journal.steps_before + self.num_timesteps
        self.check()
        if self._settings.normalise and self._seen:
            update_normalisers(self.model, np.concatenate(self._seen), self._settings)
        self._seen.clear()
        self._marked = self.num_timesteps
        statistics = {name: float(value) for name, value in self.logger.name_to_value.items()}
        if self._rotation is not None:
            statistics |= self._rotation.statistics
        self._show(journal.mark(self._lesson + 1, statistics))
        if is_lesson_over or _is_passed(self._run.validate_every, before, journal.steps):
            self._try_out()
        if is_lesson_over and self._trials.final is not None:
            self._measure(self._trials.final)
        if is_lesson_over or _is_passed(self._run.checkpoint_every, before, journal.steps):
            self._save(is_lesson_over)

    @property
    def kept(self) -> str:
        """What is said of the checkpoint where code of the user's own stops the run."""
        folder = self._record.folder
        if not (folder / CHECKPOINT_FILE).is_file():
            return f"Nothing was learned yet, and {folder} has no checkpoint. Correct the code and train again."
        return (
            f"Training stopped in the rollout after {self._journal.steps:,} decisions. The last good checkpoint and "
            f"its policy are in {folder}; correct the code, and the same command goes on from there."
        )

    def check(self) -> None:
        """Check that the network can still compute.

        Raises:
            TrainingError: it cannot.
        """
        if not has_finite_weights(self.model):
            raise TrainingError(
                f"Learning diverged: after {self._journal.steps} decisions, in lesson {self._lesson + 1}, weights are "
                f"not finite, or larger than {MAX_WEIGHT:g}. The learning rate of {self._settings.learning_rate:g} is "
                f"likely too high. {self._record.folder} keeps the last good checkpoint and its policy; train again "
                "with a smaller learning rate in another folder (-o)."
            )

    def _try_out(self) -> None:
        if self._trials.validation is None:
            return
        policy = self._policy()
        trial = self._trials.validation.trial(policy, self._lesson + 1, self._journal.steps)
        if self._journal.add_trial(trial):
            write_whole(self._record.folder / BEST_FILE, policy)

    def _measure(self, validation: Validation) -> None:
        """Measure the last policy in whole episodes, which the curve's last are not always."""
        self._bar.set_postfix_str("measuring the last policy")
        self._journal.final = validation.trial(self._policy(), self._lesson + 1, self._journal.steps)

    def _save(self, is_lesson_over: bool) -> None:
        scale: Any = self.training_env
        assert isinstance(scale, VecNormalize) and isinstance(scale.venv, Resumable)
        state = learner_state(self.model, scale.venv, scale)
        checkpoint = Checkpoint(self._lesson, is_lesson_over, state, self._journal.as_table())
        self._record.write(
            self._policy(),
            checkpoint,
            self._journal.curve,
            self._journal.trials,
            is_finished=is_lesson_over and self._is_last,
        )

    def _policy(self) -> bytes:
        stream = io.BytesIO()
        self.model.save(stream)
        return stream.getvalue()

    def _show(self, point: CurvePoint) -> None:
        self._bar.set_postfix_str(
            f"lesson {point.lesson}, reward {point.mean_reward:.0f}, success {point.success_rate:.0%}, "
            f"collision-free {point.collision_free_success:.0%}{_caves_text(point.learner)}"
        )


def _caves_text(learner: dict[str, float]) -> str:
    """Return what the bar says of drawn caves; nothing where there are none."""
    if FLOWN not in learner:
        return ""
    return f", {learner[FLOWN]:.0f} caves, {learner[WAITING]:.1%} of the time waiting for them"


def _is_passed(every: int, before: int, now: int) -> bool:
    """Return whether a multiple of `every` lies after `before`, up to `now`."""
    return now // every > before // every
