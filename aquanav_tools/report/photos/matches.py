"""Who matches whom: a matrix of verified matches, the groups that hang together, and how well each photo is tied."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.report.figures import BAD, INK, MUTED, PAPER, WATER, new_figure, save_figure
from aquanav_tools.types import Array, BoolArray, IntArray

DPI = 140
SIZE_IN = (11.0, 6.6)
MATRIX = (0.075, 0.095, 0.525, 0.875)
"""Left, bottom, width and height on the page."""
LINKED = 30
"""Matches that tie two photos: COLMAP wants as many to place one."""
STRONG = 100
"""Matches that tie them well: COLMAP wants as many to begin with a pair."""
FEW_NEIGHBOURS = 2
"""A photo with fewer well tied neighbours is drawn in red: it hangs by a thread."""
GROUP_COLOURS = ("#1f6f8b", "#fb8500", "#7b2cbf", "#2a9d8f", "#b5179e", "#6a994e")
ALONE = "#c9d3d8"
BLANK = "#f7fafb"
MAX_TICKS = 10


def groups_of(matches: IntArray) -> IntArray:
    """Return the (N,) number of the group that each photo hangs together with, 0 for the largest.

    Args:
        matches: (N, N) verified matches; below LINKED they tie nothing.
    """
    from scipy.sparse.csgraph import connected_components

    _, labels = connected_components(matches >= LINKED, directed=False)
    sizes = np.bincount(labels)
    rank = np.empty(len(sizes), np.int64)
    rank[np.argsort(-sizes, kind="stable")] = np.arange(len(sizes))
    numbers: IntArray = rank[labels]
    return numbers


def draw_matches(names: Sequence[str], matches: IntArray, is_placed: BoolArray, path: Path) -> None:
    """Write the matrix as PNG.

    Args:
        names: of the N photos in their order.
        matches: (N, N) verified matches, symmetric.
        is_placed: (N,) whether the photo is in the model.
        path: of the PNG.
    """
    figure = new_figure(*SIZE_IN)
    axes = figure.add_axes(MATRIX)
    left, bottom, _, height = MATRIX
    strip = figure.add_axes((left - 0.018, bottom, 0.011, height), sharey=axes)
    beside = figure.add_axes((0.695, 0.53, 0.29, 0.41), sharex=axes)
    groups = groups_of(matches)
    _draw_matrix(figure, axes, matches, is_placed)
    _draw_groups(strip, groups, is_placed)
    _draw_neighbours(beside, matches)
    _number_photos(axes, (axes, beside, strip), names)
    _explain(figure, groups, is_placed)
    save_figure(figure, path, DPI)


def _draw_matrix(figure: Any, axes: Any, matches: IntArray, is_placed: BoolArray) -> None:
    from matplotlib.colors import LinearSegmentedColormap, LogNorm

    count = len(matches)
    colours = LinearSegmentedColormap.from_list("matches", ["#cfe6ea", "#7fb9c4", "#1f6f8b", "#0c2a3a"])
    shown = np.ma.masked_less(matches, 1)
    most = max(float(matches.max(initial=0)), 10.0 * STRONG)
    norm = LogNorm(vmin=5, vmax=most, clip=True)
    axes.set_facecolor(BLANK)
    picture = axes.imshow(shown, cmap=colours, norm=norm, interpolation="nearest", aspect="auto")
    for row in np.flatnonzero(~is_placed):
        axes.axhline(row, color=BAD, linewidth=max(0.4, 60.0 / count) if count > 60 else 1.0, alpha=0.35)
        axes.axvline(row, color=BAD, linewidth=max(0.4, 60.0 / count) if count > 60 else 1.0, alpha=0.35)
    bar = figure.colorbar(picture, cax=figure.add_axes((0.613, 0.23, 0.011, 0.71)))
    ticks = [n for n in (10, 30, 100, 300, 1000, 3000, 10000) if n <= most]
    bar.set_ticks(ticks, labels=[str(n) for n in ticks])
    bar.ax.minorticks_off()
    bar.outline.set_visible(False)
    bar.ax.tick_params(labelsize=9, colors=INK, length=3)
    bar.ax.axhline(LINKED, color=PAPER, linewidth=1.4)
    figure.text(0.613, 0.205, "verified\nmatches,\nblank: none", color=MUTED, fontsize=9, va="top")


def _draw_groups(axes: Any, groups: IntArray, is_placed: BoolArray) -> None:
    """Draw a strip with a colour per group, beside the matrix; photos that hang together with none are grey."""
    from matplotlib.colors import to_rgb

    colours = np.array([to_rgb(_colour(group, groups)) for group in groups])
    axes.imshow(colours[:, None], aspect="auto", interpolation="nearest", extent=(0, 1, len(groups) - 0.5, -0.5))
    for row in np.flatnonzero(~is_placed):
        axes.plot(-0.6, row, marker=">", color=BAD, markersize=5, clip_on=False)
    axes.set_axis_off()


def _colour(group: int, groups: IntArray) -> str:
    is_alone = np.count_nonzero(groups == group) == 1
    return ALONE if is_alone or group >= len(GROUP_COLOURS) else GROUP_COLOURS[group]


def _draw_neighbours(axes: Any, matches: IntArray) -> None:
    """Draw how many photos each one is well tied to."""
    neighbours: Array = np.count_nonzero(matches >= STRONG, axis=1)
    colours = np.where(neighbours < FEW_NEIGHBOURS, BAD, "#1f6f8b")
    axes.bar(np.arange(len(neighbours)), np.maximum(neighbours, 0.15), width=0.85, color=list(colours), linewidth=0.0)
    axes.set_ylim(bottom=0.0)
    axes.yaxis.get_major_locator().set_params(integer=True, nbins=4)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)
    axes.grid(axis="y", color=WATER, linewidth=0.8)
    axes.set_axisbelow(True)
    axes.set_title(f"Neighbours with {STRONG} matches or more", loc="left", fontsize=10.5, color=INK, fontweight="bold")


def _number_photos(axes: Any, panels: Sequence[Any], names: Sequence[str]) -> None:
    every = next(n for n in (1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 5000) if len(names) / n <= MAX_TICKS)
    ticks = sorted({0, *range(every - 1, len(names), every)}) if every > 1 else list(range(len(names)))
    for one in panels:
        one.tick_params(colors=INK, labelsize=9, length=3)
    labels = [str(tick + 1) for tick in ticks]
    axes.set_yticks(ticks, labels)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.set_xlim(-0.5, len(names) - 0.5)
    axes.set_xticks(ticks, labels)
    axes.set_xlabel(f"photo, from 1 ({names[0]}) to {len(names)} ({names[-1]})", color=MUTED, fontsize=9)
    axes.tick_params(axis="y", pad=16)
    for spine in axes.spines.values():
        spine.set_color("#dbe4e8")


def _explain(figure: Any, groups: IntArray, is_placed: BoolArray) -> None:
    """Say which colour is which group."""
    from matplotlib.lines import Line2D

    sizes = np.bincount(groups)
    square: dict[str, Any] = {"marker": "s", "linestyle": "", "markersize": 8}
    entries = [
        Line2D([], [], color=_colour(group, groups), label=f"{size} photos that hang together", **square)
        for group, size in enumerate(sizes[: len(GROUP_COLOURS)])
        if size > 1
    ]
    if (sizes == 1).any():
        entries.append(Line2D([], [], color=ALONE, label=f"{np.count_nonzero(sizes == 1)} alone", **square))
    if not is_placed.all():
        label = f"{np.count_nonzero(~is_placed)} not in the model"
        entries.append(Line2D([], [], color=BAD, marker=">", linestyle="", markersize=6, label=label))
    figure.legend(
        handles=entries, loc="upper left", bbox_to_anchor=(0.685, 0.45), frameon=False, fontsize=10, labelcolor=INK,
        handletextpad=0.4, labelspacing=0.7,
    )  # fmt: skip
