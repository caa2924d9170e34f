"""What training keeps of an episode: one summary at its end."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field
from typing import Any

import gymnasium
import numpy as np

RENAMED = {"clean_success_rate": "collision_free_success"}
"""Numbers by the names that they have in the files of older runs, and have now."""
SUMMARY = "summary"
"""Key of the summary in the info of an episode's last step."""
WINDOW = 100
"""Episodes that a point of the learning curve averages over."""


@dataclass(frozen=True)
class EpisodeSummary:
    """One episode in a few numbers."""

    reward: float
    """Sum over the episode."""
    length: int
    """Decisions."""
    num_collisions: int
    """Contacts begun."""
    is_success: bool
    """Whether it reached the goal."""
    is_cut_short: bool = False
    """Whether time was up early, by chance: see `train.batched`."""


class SummaryWrapper(gymnasium.Wrapper[Any, Any, Any, Any]):
    """Drops the info but for a summary at the episode's end: vectorised environments copy every info deeply."""

    def reset(self, **arguments: Any) -> tuple[Any, dict[str, Any]]:
        """Begin an episode."""
        self._reward, self._length = 0.0, 0
        obs, _ = self.env.reset(**arguments)
        return obs, {}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Take a decision; the last one's info has the summary."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        self._reward += float(reward)
        self._length += 1
        if not (terminated or truncated):
            return obs, float(reward), False, False, {}
        summary = EpisodeSummary(
            self._reward, self._length, int(info["num_collisions"]), bool(info["outcome"] == "success")
        )
        return obs, float(reward), terminated, truncated, {SUMMARY: summary}


@dataclass(frozen=True)
class CurvePoint:
    """The last episodes at some time of the training."""

    lesson: int
    """From 1."""
    steps: int
    """Decisions so far, over all lessons."""
    seconds: float
    """Wall time so far."""
    episodes: int
    """Episodes so far."""
    mean_reward: float
    """Per episode; nan before the first has ended, as are the rest."""
    mean_length: float
    """Decisions per episode."""
    success_rate: float
    """Fraction that reached the goal."""
    collision_free_success: float
    """Fraction that reached the goal without a collision."""
    mean_collisions: float
    """Contacts begun per episode."""
    cut_short_rate: float = 0.0
    """Fraction that was cut short by chance, and counts as any other that did not reach the goal."""
    learner: dict[str, float] = field(default_factory=dict)
    """What the algorithm tells of its last update: losses, entropy and the like, by the names SB3 gives them."""

    @property
    def caveat(self) -> str:
        """Why the rates look worse than the policy is; empty where they do not."""
        if not self.cut_short_rate > 0.0:  # nan where no episode has ended
            return ""
        return (
            f"{self.cut_short_rate:.0%} of these episodes were cut short and count as not reaching the goal: on the "
            "batch, a vehicle's first episode in a lesson ends after a random time, so that not all begin at once. "
            "aquanav-eval cuts none."
        )

    @property
    def row(self) -> dict[str, float]:
        """All numbers by their names."""
        values = asdict(self)
        learner = values.pop("learner")
        return {**values, **learner}


class LearningCurve:
    """Averages over the last episodes, point by point."""

    def __init__(self) -> None:
        self.points: list[CurvePoint] = []
        self.num_episodes = 0
        self._recent: deque[EpisodeSummary] = deque(maxlen=WINDOW)

    def begin_lesson(self) -> None:
        """Forget the last episodes: they were of another lesson."""
        self._recent.clear()

    def add(self, infos: Iterable[dict[str, Any]]) -> None:
        """Take the summaries out of a step's infos."""
        for info in infos:
            if SUMMARY in info:
                self._recent.append(info[SUMMARY])
                self.num_episodes += 1

    def mark(self, lesson: int, steps: int, seconds: float, learner: dict[str, float]) -> CurvePoint:
        """Add a point for the last episodes and return it."""
        means = np.full(6, np.nan)
        if self._recent:
            means = np.mean([_numbers(episode) for episode in self._recent], axis=0)
        reward, length, success, collision_free, collisions, cut_short = (round(float(mean), 4) for mean in means)
        point = CurvePoint(
            lesson,
            steps,
            round(seconds, 2),
            self.num_episodes,
            mean_reward=reward,
            mean_length=length,
            success_rate=success,
            collision_free_success=collision_free,
            mean_collisions=collisions,
            cut_short_rate=cut_short,
            learner=learner,
        )
        self.points.append(point)
        return point

    def as_table(self) -> dict[str, Any]:
        """Return all of it as plain values."""
        recent = [asdict(episode) for episode in self._recent]
        return {"points": [asdict(point) for point in self.points], "episodes": self.num_episodes, "recent": recent}

    @staticmethod
    def from_table(table: dict[str, Any]) -> LearningCurve:
        """Return the curve that `as_table` described."""
        curve = LearningCurve()
        curve.points = [CurvePoint(**with_new_names(point)) for point in table["points"]]
        curve.num_episodes = table["episodes"]
        curve._recent.extend(EpisodeSummary(**episode) for episode in table["recent"])
        return curve


def with_new_names(row: dict[str, Any]) -> dict[str, Any]:
    """Return the numbers of a point or a trial, which an older version may have written, by their names now."""
    return {RENAMED.get(name, name): value for name, value in row.items()}


def _numbers(episode: EpisodeSummary) -> tuple[float, ...]:
    """Return what a CurvePoint averages, in its order."""
    return (
        episode.reward,
        float(episode.length),
        float(episode.is_success),
        float(episode.is_success and episode.num_collisions == 0),
        float(episode.num_collisions),
        float(episode.is_cut_short),
    )
