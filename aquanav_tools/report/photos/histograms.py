"""How good the model of the cameras is: its errors, tracks and angles as histograms, and the sources of scale."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.report.figures import BAD, BLUE, INK, MUTED, WATER, new_figure, save_drawing
from aquanav_tools.types import Array, IntArray

DPI = 130
WIDTH_IN = 11.0
ROW_IN = 2.75
HEADROOM = 1.18
"""Kept above the highest bar for a note."""
NARROW_DEG = 1.5
"""Points under a narrower angle have a vague depth: COLMAP does not keep them for its poses."""
USUAL_FACTOR = 2.0
"""A photo with more than this times the median error is drawn in red."""
TAIL = 99.5
"""Histograms end at this percentile; what is beyond is counted in the last bar."""


@dataclass(frozen=True, eq=False)
class ModelQuality:
    """What there is to know about cameras and sparse points."""

    point_errors_px: Array
    """(P,) mean reprojection error of each point."""
    track_lengths: IntArray
    """(P,) photos that see each point."""
    angles_deg: Array
    """(P,) widest angle between two rays to each point."""
    photo_errors_px: Array
    """(C,) mean reprojection error in each photo, in the photos' order."""
    photo_numbers: IntArray
    """(C,) place of each of them in the sequence of all photos, from 1."""


@dataclass(frozen=True)
class ScaleSource:
    """What one source said about the scale, alone."""

    name: str
    percent: float
    """Its scale over the one used, less one, %."""
    interval: float
    """95 % interval, +- %."""
    is_used: bool


@dataclass(frozen=True, eq=False)
class Misfits:
    """How far each item of a source of positions is from where the model has it."""

    name: str
    metres: Array
    """(K,)."""


def draw_quality(quality: ModelQuality, sources: Sequence[ScaleSource], misfits: Sequence[Misfits], path: Path) -> None:
    """Write the histograms as SVG at `path` and PNG beside it; the row of scale is there when something gave it."""
    num_rows = 2 + bool(sources or misfits)
    figure = new_figure(WIDTH_IN, num_rows * ROW_IN)
    grid = figure.add_gridspec(num_rows, 3, height_ratios=[1.0, 0.9, 0.8][:num_rows])
    panels = [figure.add_subplot(grid[0, column]) for column in range(3)]
    _histogram(panels[0], quality.point_errors_px, "Reprojection error of the points", "px", mark="mean")
    _draw_tracks(panels[1], quality.track_lengths)
    _histogram(panels[2], quality.angles_deg, "Widest angle of a point's rays", "degrees", mark="median")
    panels[2].axvspan(0.0, NARROW_DEG, color=BAD, alpha=0.2, linewidth=0.0)
    photos = figure.add_subplot(grid[1, :])
    _draw_photos(photos, quality)
    if sources:
        panels.append(figure.add_subplot(grid[2, : 2 if misfits else 3]))
        _draw_sources(panels[-1], sources)
    if misfits:
        panels.append(figure.add_subplot(grid[2, 2 if sources else 0 :]))
        _draw_misfits(panels[-1], misfits)
    for axes in (*panels, photos):
        _finish(axes)
    figure.tight_layout(w_pad=2.0, h_pad=1.6)
    save_drawing(figure, path, DPI)


def bin_counts(values: Array, num_bins: int = 36) -> tuple[IntArray, Array]:
    """Return (B,) counts that sum to the number of values, and (B + 1,) edges from 0; the last bar holds the tail."""
    top = max(float(np.percentile(values, TAIL)), 1e-9) if len(values) else 1.0
    edges = np.linspace(0.0, top, num_bins + 1)
    counts, _ = np.histogram(np.minimum(values, top), edges)
    return counts.astype(np.int64), edges


def _histogram(axes: Any, values: Array, title: str, unit: str, mark: str) -> None:
    counts, edges = bin_counts(values)
    axes.bar(edges[:-1], counts, width=np.diff(edges), align="edge", color=BLUE, linewidth=0.0)
    if len(values):
        middle = float(np.mean(values) if mark == "mean" else np.median(values))
        axes.axvline(middle, color=INK, linewidth=1.2, linestyle="--")
        axes.text(
            middle, 0.97, f" {mark} {middle:.2g} {unit}", transform=axes.get_xaxis_transform(), va="top", fontsize=9
        )
    axes.set_ylim(0.0, HEADROOM * max(int(counts.max()), 1))
    axes.set_xlim(0.0, edges[-1])
    axes.set_xlabel(f"{unit}; the last bar holds all beyond", color=MUTED, fontsize=9)
    axes.set_ylabel("points", color=MUTED, fontsize=9)
    axes.set_title(title, loc="left", fontsize=10.5, color=INK, fontweight="bold")


def _draw_tracks(axes: Any, lengths: IntArray) -> None:
    most = int(max(np.percentile(lengths, TAIL), 3)) if len(lengths) else 3
    counts = np.bincount(np.minimum(lengths, most), minlength=most + 1)[2:]
    axes.bar(np.arange(2, most + 1), counts, width=0.85, color=[BAD if n == 2 else BLUE for n in range(2, most + 1)])
    axes.text(
        0.98, 0.97, f"mean {lengths.mean() if len(lengths) else 0:.1f} photos; red: only two",
        transform=axes.transAxes, ha="right", va="top", fontsize=9,
    )  # fmt: skip
    axes.set_ylim(0.0, HEADROOM * max(int(counts.max(initial=0)), 1))
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.set_xlabel("photos; the last bar holds all beyond", color=MUTED, fontsize=9)
    axes.set_ylabel("points", color=MUTED, fontsize=9)
    axes.set_title("Photos that see a point", loc="left", fontsize=10.5, color=INK, fontweight="bold")


def _draw_photos(axes: Any, quality: ModelQuality) -> None:
    errors, numbers = quality.photo_errors_px, quality.photo_numbers
    usual = float(np.median(errors))
    colours = np.where(errors > USUAL_FACTOR * usual, BAD, BLUE)
    axes.bar(numbers, errors, width=0.85, color=list(colours), linewidth=0.0)
    axes.axhline(usual, color=INK, linewidth=1.0, linestyle="--")
    note = f"median {usual:.2f} px"
    if (errors > USUAL_FACTOR * usual).any():
        note += f"; red: more than {USUAL_FACTOR:g} times that"
    axes.text(0.995, 0.97, note, transform=axes.transAxes, ha="right", va="top", fontsize=9)
    axes.set_ylim(0.0, HEADROOM * max(float(errors.max()), 1e-3))
    axes.set_xlim(0.3, float(numbers.max()) + 0.7)
    axes.set_xlabel("photo, by its place in the sequence; gaps did not register", color=MUTED, fontsize=9)
    axes.set_ylabel("px", color=MUTED, fontsize=9)
    axes.set_title("Mean reprojection error of each photo", loc="left", fontsize=10.5, color=INK, fontweight="bold")


def _draw_sources(axes: Any, sources: Sequence[ScaleSource]) -> None:
    for row, one in enumerate(sources):
        colour = BLUE if one.is_used else BAD
        axes.errorbar(
            one.percent, row, xerr=one.interval, fmt="o", color=colour, capsize=4, linewidth=1.6, markersize=6
        )
    axes.axvline(0.0, color=INK, linewidth=1.0, linestyle="--")
    axes.set_yticks(range(len(sources)), [one.name + ("" if one.is_used else " (not used)") for one in sources])
    axes.set_ylim(len(sources) - 0.4, -0.6)
    widest = max(abs(one.percent) + one.interval for one in sources)
    axes.set_xlim(-1.15 * widest, 1.15 * widest)
    axes.set_xlabel("scale relative to the one used, %, with 95 % intervals", color=MUTED, fontsize=9)
    axes.set_title("Scale by each source alone", loc="left", fontsize=10.5, color=INK, fontweight="bold")


def _draw_misfits(axes: Any, misfits: Sequence[Misfits]) -> None:
    top = max(float(np.percentile(np.concatenate([one.metres for one in misfits]), TAIL)), 1e-6)
    shades = (BLUE, "#fb8500", "#7b2cbf", "#2a9d8f")
    clipped = [np.minimum(100.0 * one.metres, 100.0 * top) for one in misfits]
    colours = [shades[row % len(shades)] for row in range(len(misfits))]
    axes.hist(
        clipped, bins=20, range=(0.0, 100.0 * top), stacked=True, color=colours, label=[one.name for one in misfits]
    )
    axes.margins(y=0.35)
    axes.legend(frameon=False, fontsize=9, loc="upper right")
    axes.set_xlabel("cm between the model and what was given", color=MUTED, fontsize=9)
    axes.set_ylabel("items", color=MUTED, fontsize=9)
    axes.set_title("Scale residuals", loc="left", fontsize=10.5, color=INK, fontweight="bold")


def _finish(axes: Any) -> None:
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)
    axes.tick_params(colors=INK, labelsize=9)
    axes.grid(axis="y", color=WATER, linewidth=0.8)
    axes.set_axisbelow(True)
