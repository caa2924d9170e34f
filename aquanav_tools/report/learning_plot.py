"""How a policy learned: return and success over the decisions it learned from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.report.figures import BLUE, GOOD, INK, MUTED, PORTAL, new_figure, save_figure

DPI = 140
SIZE_IN = (11.0, 3.6)
Series = Sequence[tuple[float, float]]
"""(decisions, value) pairs; values may be nan."""


@dataclass(frozen=True)
class Learning:
    """What is drawn of a training run."""

    reward: Series
    """Mean return of the last episodes."""
    success: Series
    """Share of the last episodes that reached the goal."""
    collision_free_success: Series
    """Share that did so without a collision."""
    validation: Series
    """Collision-free success in the validation scenarios."""
    lesson_ends: Sequence[float]
    """Decisions at which lessons ended, but for the last."""


def plot_learning(learning: Learning, path: Path) -> None:
    """Write the two plots beside each other as PNG."""
    figure = new_figure(*SIZE_IN)
    left, right = figure.subplots(1, 2)
    _draw(left, learning.reward, BLUE, "")
    left.set_title("Return per episode", loc="left", fontweight="bold")
    _draw(right, learning.success, BLUE, "success")
    _draw(right, learning.collision_free_success, GOOD, "without a collision")
    if learning.validation:
        right.plot(*_columns(learning.validation), "o", color=PORTAL, markersize=4, label="the latter in validation")
    right.set_ylim(-0.03, 1.03)
    right.set_title("Share of episodes", loc="left", fontweight="bold")
    right.legend(frameon=False, loc="upper left", fontsize=9)
    for axes in (left, right):
        for end in learning.lesson_ends:
            axes.axvline(end / 1e6, color=MUTED, linewidth=0.9, linestyle=":")
        axes.set_xlabel("million decisions")
        axes.spines[["top", "right"]].set_visible(False)
        axes.spines[["left", "bottom"]].set_color(MUTED)
        axes.tick_params(colors=INK)
    figure.tight_layout()
    save_figure(figure, path, DPI)


def _draw(axes: Any, series: Series, colour: str, label: str) -> None:
    axes.plot(*_columns(series), color=colour, linewidth=1.6, label=label)


def _columns(series: Series) -> tuple[Any, Any]:
    values = np.array(series, dtype=np.float64).reshape(-1, 2)
    return values[:, 0] / 1e6, values[:, 1]
