"""What a run keeps while it learns: its curve, its trials, its best policy's score, and how long it took."""

from __future__ import annotations

import dataclasses
import time
from dataclasses import dataclass, field
from typing import Any

from aquanav_tools.train.episodes import CurvePoint, LearningCurve, with_new_names
from aquanav_tools.train.events import EventFile
from aquanav_tools.train.validation import Trial

TRIAL_TAGS = ("collision_free_success", "success_rate", "mean_reward", "mean_collisions")


@dataclass
class RunJournal:
    """Grows with every update; `as_table` and `from_table` take it through a checkpoint."""

    events: EventFile
    steps: int = 0
    """Decisions so far, over all lessons."""
    steps_before: int = 0
    """Those of the lessons that are over."""
    curve: LearningCurve = field(default_factory=LearningCurve)
    trials: list[Trial] = field(default_factory=list)
    final: Trial | None = None
    """The last policy, when all was learned."""
    seconds_before: float = 0.0
    """Spent before this process went on."""
    _began: float = field(default_factory=time.perf_counter)

    @property
    def seconds(self) -> float:
        """Wall time of all processes that worked on this run."""
        return self.seconds_before + time.perf_counter() - self._began

    @property
    def best(self) -> Trial | None:
        """The best trial; the earliest of equals."""
        return max(self.trials, key=lambda trial: trial.score, default=None)

    def mark(self, lesson: int, learner: dict[str, float]) -> CurvePoint:
        """Add a point to the curve, here and for TensorBoard."""
        point = self.curve.mark(lesson, self.steps, self.seconds, learner)
        self._log_point(point)
        return point

    def add_trial(self, trial: Trial) -> bool:
        """Keep a trial; return whether it is the best so far."""
        self.trials.append(trial)
        self._log_trial(trial)
        return self.best is trial

    def as_table(self) -> dict[str, Any]:
        """Return all of it as plain values."""
        return {
            "steps": self.steps,
            "steps_before": self.steps_before,
            "seconds": round(self.seconds, 1),
            "curve": self.curve.as_table(),
            "trials": [dataclasses.asdict(trial) for trial in self.trials],
            "final": None if self.final is None else dataclasses.asdict(self.final),
        }

    @staticmethod
    def from_table(table: dict[str, Any], events: EventFile) -> RunJournal:
        """Return the journal that `as_table` described; its numbers are logged into an empty event file."""
        journal = RunJournal(
            events,
            table["steps"],
            table["steps_before"],
            LearningCurve.from_table(table["curve"]),
            [Trial(**with_new_names(trial)) for trial in table["trials"]],
            None if table["final"] is None else Trial(**with_new_names(table["final"])),
            table["seconds"],
        )
        for point in journal.curve.points:
            journal._log_point(point)
        for trial in journal.trials:
            journal._log_trial(trial)
        return journal

    def _log_point(self, point: CurvePoint) -> None:
        row = point.row
        steps = int(row.pop("steps"))
        scalars = {name if "/" in name else f"rollout/{name}": value for name, value in row.items() if value == value}
        self.events.add(steps, point.seconds, scalars)

    def _log_trial(self, trial: Trial) -> None:
        self.events.add(trial.steps, 0.0, {f"validation/{name}": getattr(trial, name) for name in TRIAL_TAGS})
