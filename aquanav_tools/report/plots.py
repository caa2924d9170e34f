"""Plots over all episodes of an evaluation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.report.figures import BLUE, INK, MUTED, OUTCOME_COLOURS, new_figure, save_figure
from aquanav_tools.report.trajectory import TrajectorySummary
from aquanav_tools.types import Array

DPI = 140
SIZE_IN = (4.7, 3.5)

Interval = tuple[float, float]
Cases = tuple[Array, Sequence[str]]


def plot_outcomes(rates: dict[str, tuple[float, Interval]], path: Path, title: str = "How the episodes ended") -> None:
    """Write bars of rates in [0, 1] with their 95 % intervals: {label: (rate, (low, high))}."""
    figure = new_figure(*SIZE_IN)
    axes = figure.subplots()
    for row, (label, (rate, (low, high))) in enumerate(rates.items()):
        colour = OUTCOME_COLOURS.get(label, BLUE)
        axes.barh(row, rate, color=colour, height=0.58)
        axes.errorbar(rate, row, xerr=[[rate - low], [high - rate]], color=INK, capsize=4, linewidth=1.3)
        axes.text(min(high, 1.0) + 0.03, row, f"{rate:.0%}", va="center", fontsize=11, fontweight="bold")
    axes.set_yticks(range(len(rates)), list(rates))
    axes.invert_yaxis()
    axes.set_xlim(0.0, 1.14)
    axes.set_xticks(np.linspace(0.0, 1.0, 6), [f"{share:.0%}" for share in np.linspace(0.0, 1.0, 6)])
    axes.set_title(title, loc="left", fontweight="bold")
    axes.tick_params(axis="y", length=0, labelsize=11)
    _finish(figure, axes, path)


def plot_clearance(trajectories: Sequence[TrajectorySummary], path: Path) -> None:
    """Write the histogram of clearance over all states of all episodes."""
    clearances = np.concatenate([trajectory.clearances for trajectory in trajectories])
    figure = new_figure(*SIZE_IN)
    axes = figure.subplots()
    axes.hist(clearances, bins=40, weights=np.full(len(clearances), 100.0 / len(clearances)), color=BLUE)
    mean = float(clearances.mean())
    axes.axvline(mean, color=INK, linewidth=1.2, linestyle="--")
    axes.text(mean, axes.get_ylim()[1], f" mean {mean:.2f} m", va="top", fontsize=10)
    axes.set_xlabel("clearance from the hull to the nearest wall, m")
    axes.set_ylabel("share of time, %")
    axes.set_title("How close to the walls", loc="left", fontweight="bold")
    _finish(figure, axes, path)


def plot_progress(trajectories: Sequence[TrajectorySummary], route_length: float, path: Path) -> None:
    """Write the progress along the guide over time, a line per episode, coloured by outcome; the goal is dashed."""
    figure = new_figure(*SIZE_IN)
    axes = figure.subplots()
    for trajectory in trajectories:
        colour = OUTCOME_COLOURS.get(trajectory.outcome, MUTED)
        axes.plot(trajectory.times, trajectory.progress, color=colour, linewidth=1.1, alpha=0.65)
        axes.plot(trajectory.times[-1], trajectory.progress[-1], "o", color=colour, markersize=3.5)
    axes.axhline(route_length, color=INK, linewidth=1.0, linestyle="--")
    axes.text(0.0, route_length, "goal", va="bottom", fontsize=9)
    for outcome, colour in OUTCOME_COLOURS.items():
        if any(trajectory.outcome == outcome for trajectory in trajectories):
            axes.plot([], [], color=colour, linewidth=2.0, label=outcome)
    axes.legend(frameon=False, loc="lower right", fontsize=9)
    axes.set_xlim(left=0.0)
    axes.set_ylim(0.0, 1.1 * route_length)
    axes.set_xlabel("time, s")
    axes.set_ylabel("progress along the route, m")
    axes.set_title("How they advanced", loc="left", fontweight="bold")
    _finish(figure, axes, path)


def plot_cases(panels: Mapping[str, Cases], axes_names: tuple[str, str, str], path: Path) -> None:
    """Write a column of two scatter plots for each kind of cases: the first value against the second and the third.

    Args:
        panels: By title, the (N, 3) values of its cases and their N outcomes.
        axes_names: Of the three values, with units.
        path: The picture.
    """
    figure = new_figure(2.0 * SIZE_IN[0], 1.7 * SIZE_IN[1])
    grid = figure.subplots(2, len(panels), squeeze=False, sharex=True, sharey="row")
    for column, (title, (values, outcomes)) in enumerate(panels.items()):
        for row in (0, 1):
            axes = grid[row][column]
            for outcome, colour in OUTCOME_COLOURS.items():
                chosen = values[[found == outcome for found in outcomes]]
                size = 12 if outcome == "success" else 26  # failures lie above and are seen first
                axes.scatter(chosen[:, 0], chosen[:, row + 1], s=size, color=colour, alpha=0.7, label=outcome, lw=0)
            if column == 0:
                axes.set_ylabel(axes_names[row + 1])
        grid[0][column].set_title(title, loc="left", fontweight="bold")
        grid[1][column].set_xlabel(axes_names[0])
    grid[0][0].legend(frameon=False, fontsize=9, ncols=2, loc="lower left", bbox_to_anchor=(0.0, 1.12))
    for axes in grid.ravel():
        _finish_axes(axes)
    figure.tight_layout()
    save_figure(figure, path, DPI)


def _finish(figure: Any, axes: Any, path: Path) -> None:
    _finish_axes(axes)
    figure.tight_layout()
    save_figure(figure, path, DPI)


def _finish_axes(axes: Any) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)
    axes.tick_params(colors=INK)
