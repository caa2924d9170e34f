"""What an episode and an evaluation are worth.

success: the goal was reached, whatever was touched on the way. Collision-free success: reached without touching the
wall once; the headline, as in the original benchmark, where one collision is a failure. collisions: separate contacts.
clearance: from the hull to the nearest wall. SPL: success weighted by path length.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from aquanav_tools.evaluate.statistics import Proportion, wilson
from aquanav_tools.report.track import Track

OUTCOMES = ("success", "collision", "timeout")


@dataclass(frozen=True)
class EpisodeMetrics:
    """One episode in numbers: metres, seconds."""

    seed: int
    start: int
    outcome: str
    collisions: int
    min_clearance: float
    mean_clearance: float
    time: float
    path_length: float
    progress: float
    """Metres along the guide at the end."""
    spl: float
    reward: float
    cost: float

    @property
    def is_success(self) -> bool:
        """Whether it reached the goal."""
        return self.outcome == "success"

    @property
    def is_collision_free_success(self) -> bool:
        """Whether it reached the goal and never touched the wall."""
        return self.is_success and self.collisions == 0


@dataclass(frozen=True)
class Summary:
    """All episodes in numbers. Means are over episodes; rates carry 95 % Wilson intervals."""

    episodes: int
    success: Proportion
    collision_free_success: Proportion
    outcomes: dict[str, int]
    """Number of episodes per outcome."""
    collisions_per_episode: float
    min_clearance: float
    """Smallest over all episodes, m."""
    mean_clearance: float
    spl: float
    time: float
    path_length: float
    progress: float
    reward: float
    cost: float


def spl(is_success: bool, geodesic: float, path_length: float) -> float:
    """Return success weighted by path length, in [0, 1]: 0 for a failure, 1 for the shortest way.

    Source: Anderson et al., On evaluation of embodied navigation agents, arXiv 1807.06757 (2018).
    """
    return geodesic / max(geodesic, path_length, 1e-9) if is_success else 0.0


def measure(track: Track, geodesic: float) -> EpisodeMetrics:
    """Return the metrics of one episode whose start is `geodesic` metres from the goal."""
    return EpisodeMetrics(
        seed=track.seed,
        start=track.start_index,
        outcome=track.outcome,
        collisions=track.num_collisions,
        min_clearance=float(track.clearances.min()),
        mean_clearance=float(track.clearances.mean()),
        time=float(track.times[-1]),
        path_length=track.path_length,
        progress=float(track.progress[-1]),
        spl=spl(track.outcome == "success", geodesic, track.path_length),
        reward=float(track.rewards.sum()),
        cost=float(track.costs.sum()),
    )


def summarise(episodes: Sequence[EpisodeMetrics]) -> Summary:
    """Return the summary of at least one episode."""

    def mean(name: str) -> float:
        return float(np.mean([getattr(episode, name) for episode in episodes]))

    return Summary(
        episodes=len(episodes),
        success=wilson(sum(episode.is_success for episode in episodes), len(episodes)),
        collision_free_success=wilson(sum(episode.is_collision_free_success for episode in episodes), len(episodes)),
        outcomes={outcome: sum(episode.outcome == outcome for episode in episodes) for outcome in OUTCOMES},
        collisions_per_episode=mean("collisions"),
        min_clearance=min(episode.min_clearance for episode in episodes),
        mean_clearance=mean("mean_clearance"),
        spl=mean("spl"),
        time=mean("time"),
        path_length=mean("path_length"),
        progress=mean("progress"),
        reward=mean("reward"),
        cost=mean("cost"),
    )
