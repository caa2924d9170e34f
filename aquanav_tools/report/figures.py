"""How every figure of aquanav looks, and how it reaches the disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

INK = "#12232e"
MUTED = "#5c6f7b"
PAPER = "#ffffff"
BLUE = "#1f6f8b"
GOOD = "#2a9d8f"
BAD = "#e5383b"
IDLE = "#e9a23b"

OUTCOME_COLOURS = {"success": GOOD, "collision": BAD, "timeout": IDLE}


def new_figure(width_in: float, height_in: float) -> Any:
    """Return an empty matplotlib figure that needs no display and shares no state with other figures."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width_in, height_in), facecolor=PAPER)
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Any, path: Path, dpi: int) -> None:
    """Write a figure as PNG, without the metadata that names a version, so that equal pictures are equal files."""
    figure.savefig(path, dpi=dpi, metadata={"Software": None})
