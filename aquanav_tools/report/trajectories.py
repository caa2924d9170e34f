"""Trails of episodes, and where their collisions crowd, drawn into a picture of any place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from aquanav_tools.report.figures import BAD, INK
from aquanav_tools.report.relief import View
from aquanav_tools.report.trajectory import TrajectorySummary
from aquanav_tools.types import Array

FEW_CONTACTS = 20
"""Beyond this number the crosses shrink, or they would hide the trails."""
CRASH = BAD


def draw_trajectories(axes: Any, trajectories: Sequence[TrajectorySummary], view: View) -> Any:
    """Draw every trajectory's trail and return the lines, whose colours the clearance bar explains."""
    from matplotlib.collections import LineCollection

    lines = [view.project(trajectory.positions) for trajectory in trajectories]
    is_alone = len(trajectories) == 1
    if is_alone:
        axes.plot(*lines[0].T, color=INK, linewidth=3.6, alpha=0.6, zorder=5, solid_capstyle="round")
    segments = np.concatenate([np.stack([line[:-1], line[1:]], axis=1) for line in lines])
    clearances = np.concatenate([trajectory.clearances[1:] for trajectory in trajectories])
    collection = LineCollection(
        list(segments), cmap="plasma", linewidths=2.2 if is_alone else 1.1, zorder=6, capstyle="round"
    )
    collection.set_array(clearances)
    # No segment at all: the policies failed before they chose an action.
    collection.set_clim(0.0, max(float(np.percentile(clearances, 95.0)), 0.1) if len(clearances) else 0.1)
    axes.add_collection(collection)
    contacts = np.concatenate(
        [line[trajectory.contact_states] for line, trajectory in zip(lines, trajectories, strict=True)]
    )
    size = float(np.clip(46.0 * FEW_CONTACTS / max(len(contacts), 1), 4.0, 46.0))
    axes.scatter(*contacts.T, marker="x", s=size, color=CRASH, linewidths=0.26 * np.sqrt(size), zorder=8)
    beginnings = np.array([line[0] for line in lines])
    axes.scatter(*beginnings.T, s=34 if is_alone else 14, color="white", edgecolors=INK, linewidths=0.8, zorder=8)
    return collection


def draw_crowds(axes: Any, contacts: Array, spot: float) -> Any:
    """Draw how many (C, 2) contacts fall into each hexagonal spot, `spot` metres wide, and return the spots."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    across = max(int((right - left) / spot), 1)
    spots = axes.hexbin(
        *contacts.T, gridsize=(across, max(int((top - bottom) / spot / np.sqrt(3.0)), 1)), mincnt=1, cmap="YlOrRd",
        extent=(left, right, bottom, top), linewidths=0.3, edgecolors=INK, zorder=7,
    )  # fmt: skip
    spots.set_clim(0.0, max(float(spots.get_array().max()), 1.0))
    return spots


def draw_colour_bar(figure: Any, height: float, coloured: Any, label: str, left: float = 0.38) -> None:
    """Draw what colours mean at the foot of a figure of some height, inches, from a share of its width on."""
    axes = figure.add_axes((left, 0.42 / height, 0.2, 0.10 / height))
    bar = figure.colorbar(coloured, cax=axes, orientation="horizontal")
    bar.set_label(label, color=INK, fontsize=9, labelpad=1)
    bar.outline.set_visible(False)
    axes.tick_params(labelsize=8, colors=INK, length=2, pad=1)
