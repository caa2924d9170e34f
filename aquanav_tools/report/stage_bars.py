"""What every stage of a build cost: seconds and memory as bars."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.report.figures import BLUE, INK, MUTED, new_figure, save_drawing

DPI = 130
WIDTH_IN = 11.0
LINE_IN = 0.27
HEAD_IN = 0.5
MEMORY = "#8fb8c4"


def draw_stages(titles: Sequence[str], seconds: Sequence[float], memory_mb: Sequence[float], path: Path) -> None:
    """Write the bars as SVG at `path` and PNG beside it.

    Args:
        titles: of the stages, in their order.
        seconds: that each took.
        memory_mb: largest memory of the process up to the end of each.
        path: of the SVG.
    """
    height = HEAD_IN + LINE_IN * len(titles) + 0.15
    figure = new_figure(WIDTH_IN, height)
    bottom, tall = 0.15 / height, LINE_IN * len(titles) / height
    left = figure.add_axes((0.235, bottom, 0.42, tall))
    right = figure.add_axes((0.76, bottom, 0.165, tall))
    total = sum(seconds)
    _draw_bars(left, seconds, [f"{_time(value)}" for value in seconds], BLUE)
    _draw_bars(right, memory_mb, [f"{value / 1000:.1f} GB" for value in memory_mb], MEMORY)
    left.set_yticks(range(len(titles)), list(titles))
    right.set_yticks([])
    left.set_title(f"Time, {_time(total)} in all", loc="left", fontsize=10.5, color=INK, fontweight="bold")
    right.set_title("Memory, largest until then", loc="left", fontsize=10.5, color=INK, fontweight="bold")
    save_drawing(figure, path, DPI)


def _draw_bars(axes: Any, values: Sequence[float], labels: Sequence[str], colour: str) -> None:
    rows = np.arange(len(values))
    axes.barh(rows, values, color=colour, height=0.68)
    top = max([*values, 1e-9])
    for row, value, label in zip(rows, values, labels, strict=True):
        axes.text(value + 0.012 * top, row, label, va="center", fontsize=9, color=MUTED)
    axes.set_xlim(0.0, 1.16 * top)
    axes.set_ylim(len(values) - 0.5, -0.5)
    axes.set_xticks([])
    axes.spines[["top", "right", "bottom"]].set_visible(False)
    axes.spines["left"].set_color(MUTED)
    axes.tick_params(axis="y", length=0, labelsize=9.5, colors=INK)


def _time(seconds: float) -> str:
    if seconds < 10.0:
        return f"{seconds:.1f} s"
    return f"{seconds:.0f} s" if seconds < 120.0 else f"{seconds / 60:.1f} min"
