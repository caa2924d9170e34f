"""Which episodes an evaluation runs: fixed by its seed alone, so that policies meet the same episodes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class EpisodePlan:
    """How one episode begins."""

    seed: int
    """Seed of the environment and of the policy."""
    start_index: int | None
    """Which of the scenario's starts; None where the environment draws one."""


def plan_episodes(num_starts: int, num_episodes: int, seed: int, is_anywhere: bool = False) -> tuple[EpisodePlan, ...]:
    """Return the episodes of an evaluation; with `is_anywhere` their seeds alone say where they start.

    Episode i has seed `seed + i`. All starts take their turn before any comes again, each round in an order shuffled by
    `seed`, so that no start counts more than once above another. A shorter evaluation is the beginning of a longer one.
    """
    if is_anywhere:
        return tuple(EpisodePlan(seed + i, None) for i in range(num_episodes))
    rng = np.random.default_rng(seed)
    rounds = -(-num_episodes // num_starts)
    order = np.concatenate([rng.permutation(num_starts) for _ in range(rounds)])[:num_episodes]
    return tuple(EpisodePlan(seed + i, int(start)) for i, start in enumerate(order))
