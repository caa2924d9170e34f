"""How every figure of aquanav looks, and how it reaches the disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

INK = "#12232e"
MUTED = "#5c6f7b"
PAPER = "#ffffff"
WATER = "#e3eff3"
BLUE = "#1f6f8b"
GOOD = "#2a9d8f"
BAD = "#e5383b"
IDLE = "#e9a23b"
PORTAL = "#fb5607"

JPEG_QUALITY = 88
"""A tenth of a PNG's size for photographs, letters still sharp."""

OUTCOME_COLOURS = {
    "success": GOOD,
    "collision": BAD,
    "timeout": IDLE,
    "failed": MUTED,
    "infeasible": MUTED,
    "ended": BAD,
}


def new_figure(width_in: float, height_in: float) -> Any:
    """Return an empty matplotlib figure that needs no display and shares no state with other figures."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), facecolor=PAPER)
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Any, path: Path, dpi: int) -> None:
    """Write a figure as PNG or, for photographs, JPEG; no version is named, so that equal pictures are equal files."""
    if path.suffix == ".jpg":
        figure.savefig(path, dpi=dpi, pil_kwargs={"quality": JPEG_QUALITY})
    else:
        figure.savefig(path, dpi=dpi, metadata={"Software": None})


def save_drawing(figure: Any, path: Path, dpi: int) -> None:
    """Write a line drawing as SVG at `path` and as PNG beside it; equal drawings are equal files.

    Letters become outlines, so that the drawing looks the same where its font is missing.
    """
    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": "aquanav", "svg.fonttype": "path"}):
        figure.savefig(path, metadata={"Date": None, "Creator": None})
    save_figure(figure, path.with_suffix(".png"), dpi)


def round_length(longest: float) -> float:
    """Return the largest of 1, 2 and 5 times a power of ten that is at most `longest`."""
    decade = 10.0 ** np.floor(np.log10(longest))
    return float(decade * max(step for step in (1.0, 2.0, 5.0) if step * decade <= longest * (1.0 + 1e-9)))


def draw_scale_bar(figure: Any, inches_per_metre: float, left_in: float, bottom_in: float) -> None:
    """Draw a bar of a round number of metres, at most an eighth of the page wide, its corner at the given inches."""
    width_in, height_in = figure.get_size_inches()
    metres = round_length(width_in / 8.0 / inches_per_metre)
    axes = figure.add_axes(
        (left_in / width_in, bottom_in / height_in, metres * inches_per_metre / width_in, 0.07 / height_in)
    )
    axes.set_axis_off()
    axes.set_xlim(0.0, 4.0)
    for quarter in range(4):
        axes.axvspan(quarter, quarter + 1, facecolor=INK if quarter % 2 == 0 else PAPER, edgecolor=INK, linewidth=0.8)
    axes.text(2.0, 1.8, f"{metres:g} m", ha="center", va="bottom", color=INK, fontsize=10)
