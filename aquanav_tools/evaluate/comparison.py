"""What a comparison of evaluations finds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.evaluate.paired import PairedRates, RunRates
from aquanav_tools.evaluate.sequential import Sequential
from aquanav_tools.evaluate.statistics import Estimate
from aquanav_tools.evaluate.summary import Summary
from aquanav_tools.types import Array

SIGNIFICANT = 0.05


@dataclass(frozen=True, eq=False)
class Method:
    """One side of a comparison: a policy, or the training runs of one method."""

    name: str
    runs: tuple[tuple[EpisodeMetrics, ...], ...]
    tasks: tuple[str, ...]
    """Scenario and condition of each column of the scores."""
    scores: Array
    """(runs, tasks) rates of collision-free success."""
    iqm: Estimate | None
    """Interquartile mean of the scores over training runs; None for a single run."""
    summary: Summary
    """Of the episodes of all runs."""
    tables: tuple[dict[str, Any], ...]
    """The results.json of each run, without its episodes."""

    @property
    def reward(self) -> str | None:
        """The reward that returns are of; None where runs differ in it."""
        names = {table["protocol"]["reward"] for table in self.tables}
        return names.pop() if len(names) == 1 else None


@dataclass(frozen=True)
class Comparison:
    """The first method against another."""

    first: str
    second: str
    improvement: float
    """Probability that a training run of the first scores higher than one of the second, ties half, mean over tasks."""
    num_pairs: int
    """Different episodes that both met; the next four need some, and a single run of each."""
    are_all: bool
    """Whether no other episodes that differ exist under these rules."""
    rates: PairedRates | None
    """Of collision-free success."""
    num_to_tell: int | None
    """Episodes that would tell the two apart, were the difference as seen; None where they are told apart, where none
    was seen, or without pairs."""
    won: Estimate | None
    """Share of the episodes in which the first had the higher SPL, ties half."""
    differences: dict[str, Estimate]
    """Mean of the first less the second, for some metrics."""
    runs: RunRates | None
    """Of collision-free success by training run; needs two or more of each method."""
    notes: tuple[str, ...]
    """What the reader must know: rules that differ, policies that failed by themselves."""
    sequential: Sequential | None = None
    """Where the pairs were flown until a verdict: what they said. Tests for a fixed number do not hold then."""
