"""Plots over all episodes of an evaluation."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aquanav_tools.report.figures import BLUE, INK, MUTED, OUTCOME_COLOURS, new_figure, save_figure
from aquanav_tools.report.relief import plan_and_section
from aquanav_tools.report.track import Track

if TYPE_CHECKING:
    from aquanav_tools.scenario.schema import Scenario

DPI = 140
HALF_PAGE_IN = (6.4, 3.6)

Interval = tuple[float, float]


def plot_outcomes(rates: dict[str, tuple[float, Interval]], path: Path) -> None:
    """Write bars of rates in [0, 1] with their 95 % intervals: {label: (rate, (low, high))}."""
    figure = new_figure(*HALF_PAGE_IN)
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
    axes.set_title("How the episodes ended", loc="left", fontweight="bold")
    axes.tick_params(axis="y", length=0, labelsize=11)
    _finish(figure, axes, path)


def plot_clearance(tracks: Sequence[Track], path: Path) -> None:
    """Write the histogram of clearance over all states of all episodes, with the share of time in contact."""
    clearances = np.concatenate([track.clearances for track in tracks])
    figure = new_figure(*HALF_PAGE_IN)
    axes = figure.subplots()
    axes.hist(clearances, bins=40, weights=np.full(len(clearances), 100.0 / len(clearances)), color=BLUE)
    mean = float(clearances.mean())
    axes.axvline(mean, color=INK, linewidth=1.2, linestyle="--")
    axes.text(mean, axes.get_ylim()[1], f" mean {mean:.2f} m", va="top", fontsize=10)
    axes.set_xlabel("clearance from the hull to the nearest wall, m")
    axes.set_ylabel("share of time, %")
    axes.set_title("How close to the walls", loc="left", fontweight="bold")
    _finish(figure, axes, path)


def plot_progress(tracks: Sequence[Track], route_length: float, path: Path) -> None:
    """Write the progress along the guide over time, a line per episode, coloured by outcome; the goal is dashed."""
    figure = new_figure(*HALF_PAGE_IN)
    axes = figure.subplots()
    for track in tracks:
        colour = OUTCOME_COLOURS.get(track.outcome, MUTED)
        axes.plot(track.times, track.progress, color=colour, linewidth=1.1, alpha=0.65)
        axes.plot(track.times[-1], track.progress[-1], "o", color=colour, markersize=3.5)
    axes.axhline(route_length, color=INK, linewidth=1.0, linestyle="--")
    axes.text(0.0, route_length, "goal", va="bottom", fontsize=9)
    for outcome, colour in OUTCOME_COLOURS.items():
        if any(track.outcome == outcome for track in tracks):
            axes.plot([], [], color=colour, linewidth=2.0, label=outcome)
    axes.legend(frameon=False, loc="lower right", fontsize=9)
    axes.set_xlim(left=0.0)
    axes.set_ylim(0.0, 1.1 * route_length)
    axes.set_xlabel("time, s")
    axes.set_ylabel("progress along the route, m")
    axes.set_title("How they advanced", loc="left", fontweight="bold")
    _finish(figure, axes, path)


def plot_trails(scenario: Scenario, tracks: Sequence[Track], path: Path) -> None:
    """Write all trails in one plan view, coloured by clearance on one scale."""
    from matplotlib.collections import LineCollection

    plan, _ = plan_and_section(scenario.guide.centreline)
    figure = new_figure(13.0, 3.4)
    axes = figure.subplots()
    route = plan.project(scenario.guide.centreline)
    axes.plot(*route.T, color=MUTED, linewidth=1.0, linestyle=":")
    for panel in scenario.guide.panels:
        axes.plot(*plan.project(panel.polygon).T, color=MUTED, linewidth=0.8, alpha=0.35)
    points = [plan.project(track.positions) for track in tracks]
    segments = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in points])
    trails = LineCollection(list(segments), cmap="plasma", linewidths=1.2, alpha=0.8)
    clearances = np.concatenate([track.clearances[1:] for track in tracks])
    trails.set_array(clearances)
    trails.set_clim(0.0, max(float(np.percentile(clearances, 95.0)), 0.1))
    axes.add_collection(trails)
    contacts = np.concatenate([line[track.contact_states] for line, track in zip(points, tracks, strict=True)])
    axes.scatter(*contacts.T, marker="x", s=22, color=OUTCOME_COLOURS["collision"], linewidths=1.0, zorder=3)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("along the passage's main direction, m")
    axes.set_ylabel("across, m")
    axes.set_title("All trails, seen from above", loc="left", fontweight="bold")
    figure.colorbar(trails, ax=axes, pad=0.01, label="clearance, m")
    _finish(figure, axes, path)


def _finish(figure: Any, axes: Any, path: Path) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)
    axes.tick_params(colors=INK)
    figure.tight_layout()
    save_figure(figure, path, DPI)
