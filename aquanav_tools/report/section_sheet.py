"""The sheet of cross-sections with their LRUD, all on one scale, and the rose diagram; each as SVG and PNG."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.cave.measure.sections import Section
from aquanav_tools.report.cave_map import CaveMap
from aquanav_tools.report.figures import BAD, BLUE, INK, MUTED, draw_scale_bar, new_figure, save_drawing
from aquanav_tools.report.labels import Labels
from aquanav_tools.report.survey_drawing import DPI, FOOT_IN, HEAD_IN, MARGIN_IN, STATION, WIDTH_IN, draw_rings

NUM_COLUMNS = 6
GUTTER_IN = 0.3
TEXT_IN = 0.62
"""Height of the three lines below each section."""
MAX_SECTION_IN = 2.2
"""Height of the highest section on the sheet."""
ROSE_IN = (4.4, 4.7)
SIZES_IN = (9.2, 4.7)
SIZE_COLOURS = {"width": BLUE, "height": INK}


def draw_sections(cave: CaveMap, path: Path) -> None:
    """Write the cross-sections in order, as a diver sees them on the way in: left is left.

    Args:
        cave: its sections are drawn.
        path: of the SVG; the PNG goes beside it.
    """
    sections = cave.sections
    cell = (WIDTH_IN - 2 * MARGIN_IN - (NUM_COLUMNS - 1) * GUTTER_IN) / NUM_COLUMNS
    scale = min(cell / max(s.width for s in sections), MAX_SECTION_IN / max(s.height for s in sections))
    rows = [sections[first : first + NUM_COLUMNS] for first in range(0, len(sections), NUM_COLUMNS)]
    heights = [scale * max(section.height for section in row) + TEXT_IN + GUTTER_IN for row in rows]
    page = HEAD_IN + sum(heights) + FOOT_IN
    figure = new_figure(WIDTH_IN, page)
    _write_title(figure, cave.name, "Cross-sections, looking along the route; L, R, U, D in metres from the station")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0), xlim=(0.0, WIDTH_IN), ylim=(0.0, page))  # in inches
    axes.set_axis_off()
    top = page - HEAD_IN - GUTTER_IN
    for number, section in enumerate(sections):
        row, column = divmod(number, NUM_COLUMNS)
        left = MARGIN_IN + column * (cell + GUTTER_IN)
        _draw_cell(axes, section, number, (left, top - sum(heights[:row])), cell, heights[row], scale)
    draw_scale_bar(figure, scale, MARGIN_IN, 0.28)
    save_drawing(figure, path, DPI)


def draw_rose(name: str, rose: Sequence[float] | np.ndarray, path: Path, has_north: bool = True) -> None:
    """Write the rose diagram: sectors as long as the share of the passages that run that way, y (north) up.

    Args:
        name: of the cave.
        rose: metres of passage by bearing over half a turn, the first centred on north; see `statistics.rose_of`.
        has_north: whether y is north; otherwise angles are counted from y.
        path: of the SVG; the PNG goes beside it.
    """
    from matplotlib.ticker import MaxNLocator

    metres = np.concatenate([rose, rose])
    share = 100.0 * metres / max(float(np.sum(rose)), 1e-12)
    width = 2.0 * np.pi / len(metres)
    figure = new_figure(*ROSE_IN)
    _write_title(
        figure,
        name,
        "Rose: share of the passage by bearing" if has_north else "Rose: share of the passage by angle from y",
    )
    axes = figure.add_axes((0.12, 0.06, 0.76, 0.71), projection="polar")
    axes.set_theta_zero_location("N")
    axes.set_theta_direction(-1)
    axes.bar(width * np.arange(len(metres)), share, width=width, color=BLUE, edgecolor="white", linewidth=0.8)
    names = {0: "N", 90: "E", 180: "S", 270: "W"} if has_north else {0: "y", 90: "x"}
    axes.set_xticks(np.radians(np.arange(0, 360, 30)), [names.get(angle, f"{angle}°") for angle in range(0, 360, 30)])
    axes.yaxis.set_major_locator(MaxNLocator(4))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g} %")
    axes.set_rlabel_position(_quietest(share))
    axes.tick_params(colors=INK, labelsize=9)
    axes.tick_params(axis="y", colors=MUTED, labelsize=8)
    axes.grid(color=MUTED, alpha=0.3, linewidth=0.6)
    axes.spines["polar"].set_color(MUTED)
    save_drawing(figure, path, DPI)


def draw_sizes(cave: CaveMap, path: Path) -> None:
    """Write the width and height of the cross-sections along the route, and the free width of the marked places."""
    figure = new_figure(*SIZES_IN)
    _write_title(figure, cave.name, "Width and height of the passage along the route, m")
    axes = figure.add_axes((0.06, 0.16, 0.86, 0.59))
    along = [section.arc_length for section in cave.sections]
    lines = {
        "width": np.array([section.width for section in cave.sections]),
        "height": np.array([section.height for section in cave.sections]),
    }
    for name, sizes in lines.items():
        axes.plot(along, sizes, color=SIZE_COLOURS[name], linewidth=1.4, marker="o", markersize=3)
    axes.set_xlim(0.0, cave.length)
    axes.set_ylim(bottom=0.0)
    labels = Labels(figure, axes)
    places = np.stack([cave.along(cave.places), [mark.size for mark in cave.marks]], axis=1)
    labels.keep_free(places, 3.0)
    dense = np.linspace(along[0], along[-1], 200)
    for sizes in lines.values():
        labels.keep_free(np.stack([dense, np.interp(dense, along, sizes)], axis=1), 1.0)
    for place, mark in zip(places, cave.marks, strict=True):
        colour = BAD if mark.is_warning else INK
        axes.plot(*place, marker="D", markersize=5, color=colour, clip_on=False)
        labels.add(place, mark.text, color=colour, fontweight="bold")
    for name, sizes in lines.items():
        labels.add(np.array([along[-1], sizes[-1]]), name, color=SIZE_COLOURS[name])
    axes.set_xlabel("distance along the route, m", color=MUTED, fontsize=9)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(MUTED)
    axes.tick_params(colors=INK, labelsize=9)
    axes.grid(axis="y", color=MUTED, alpha=0.2, linewidth=0.6)
    save_drawing(figure, path, DPI)


def _quietest(share: np.ndarray) -> float:
    """Return the bearing, degrees, between two neighbouring sectors that are short, for the radial labels."""
    return float((np.argmin(share + np.roll(share, -1)) + 0.5) * 360.0 / len(share))


def _write_title(figure: Any, name: str, title: str) -> None:
    width, height = figure.get_size_inches()
    left = min(MARGIN_IN, 0.06 * width) / width
    figure.text(left, 1.0 - 0.22 / height, name, color=INK, fontsize=13, fontweight="bold", va="top")
    figure.text(left, 1.0 - 0.46 / height, title, color=MUTED, fontsize=10, va="top")


def _draw_cell(
    axes: Any, section: Section, number: int, corner: tuple[float, float], cell: float, height: float, scale: float
) -> None:
    """Draw one section in the cell whose upper left corner is given in inches, with its numbers below."""
    left, top = corner
    room = height - TEXT_IN - GUTTER_IN
    flip = np.array([-scale, scale])  # plane coordinates run to the left, pages to the right
    middle = 0.5 * (section.outline.min(axis=0) + section.outline.max(axis=0))
    x, y = station = np.array([left + 0.5 * cell, top - 0.5 * room]) - middle * flip
    draw_rings(axes, [station + ring[::-1] * flip for ring in (section.outline, *section.holes)])
    axes.plot([x - scale * section.left, x + scale * section.right], [y, y], color=BLUE, linewidth=0.7, zorder=2)
    axes.plot([x, x], [y - scale * section.down, y + scale * section.up], color=BLUE, linewidth=0.7, zorder=2)
    axes.plot(x, y, **STATION, markersize=4, zorder=3)
    lines = (
        f"{number}   at {section.arc_length:g} m",
        f"{_short(section.area)} m²,  {_short(section.width)} x {_short(section.height)} m",
        f"L {_short(section.left)}  R {_short(section.right)}  U {_short(section.up)}  D {_short(section.down)}",
    )
    for line, text in enumerate(lines):
        axes.text(
            left + 0.5 * cell, top - room - 0.1 - 0.16 * line, text, ha="center", va="top",
            color=MUTED if line else INK, fontsize=7.5 if line else 9.0, fontweight="normal" if line else "bold",
        )  # fmt: skip


def _short(metres: float) -> str:
    """Return a number with centimetres, or with decimetres where the cell would grow too narrow."""
    return f"{metres:.2f}" if metres < 9.995 else f"{metres:.1f}"
