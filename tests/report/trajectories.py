"""Made-up episodes with known numbers."""

from __future__ import annotations

import numpy as np

from aquanav_tools.report.trajectory import Trajectory

RAYS = np.stack([np.cos(np.linspace(-1, 1, 28)), np.sin(np.linspace(-1, 1, 28)), np.zeros(28)], axis=1)


def straight_trajectory(num_decisions: int = 100, **overrides: object) -> Trajectory:
    """From x = 1 to x = 19 along the tube's axis at constant speed, 0.1 s per decision, one contact half way."""
    share = np.linspace(0.0, 1.0, num_decisions + 1)
    positions = np.stack([1.0 + 18.0 * share, np.zeros_like(share), np.zeros_like(share)], axis=1)
    collided = np.zeros(num_decisions + 1, dtype=bool)
    collided[num_decisions // 2 : num_decisions // 2 + 3] = True
    values: dict[str, object] = {
        "seed": 7,
        "start_index": 3,
        "outcome": "success",
        "times": 0.1 * np.arange(num_decisions + 1),
        "positions": positions,
        "orientations": np.tile([1.0, 0.0, 0.0, 0.0], (num_decisions + 1, 1)),
        "velocities": np.tile([18.0 / (0.1 * num_decisions), 0.0, 0.0, 0.0, 0.0, 0.0], (num_decisions + 1, 1)),
        "currents": np.zeros((num_decisions + 1, 3)),
        "rays": np.full((num_decisions + 1, 28), 2.5),
        "clearances": 0.5 + 0.5 * share,
        "collided": collided,
        "progress": 18.0 * share,
        "costs": collided.astype(float),
        "actions": np.ones((num_decisions, 3)),
        "commands": np.tile([0.0, 0.0, 1.0], (num_decisions, 1)),
        "rewards": np.full(num_decisions, 0.5),
        "reward_terms": {"movement": np.full(num_decisions, 0.6), "time": np.full(num_decisions, -0.1)},
        "num_collisions": 1,
    }
    return Trajectory(**{**values, **overrides})  # type: ignore[arg-type]
