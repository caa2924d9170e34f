"""A bay from above, as a chart: rocks, reefs, where the boat begins, its goal, and the shortest way."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.report.figures import (
    BAD,
    BLUE,
    GOOD,
    INK,
    MUTED,
    PAPER,
    WATER,
    draw_scale_bar,
    new_figure,
    save_figure,
)
from aquanav_tools.report.relief import View
from aquanav_tools.report.trajectories import draw_colour_bar, draw_crowds, draw_trajectories
from aquanav_tools.report.trajectory import TrajectorySummary
from aquanav_tools.sea.sea_map import Rock, SeaMap
from aquanav_tools.types import Array

WIDTH_IN = 10.0
MARGIN_IN = 0.45
DPI = 120
ROCK = "#6b5b4d"
REEF = "#8fc3cf"
BOAT_LENGTHS = 3.0
"""The boat is drawn this many times as long as it is wide; the original's is 3.04."""
SPOT_IN = 0.12
"""Width of the spots in which collisions are counted."""
FROM_ABOVE = View(np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]))


def draw_chart(
    sea: SeaMap,
    path: Path,
    boat_width: float,
    trajectories: Sequence[TrajectorySummary] = (),
    contacts: Array | None = None,
) -> None:
    """Write the chart of a bay as PNG, with a boat of a width (m) at each start.

    With trajectories it shows trails coloured by clearance and a cross wherever the hull touched something; with (C, 3)
    contacts, where they crowd.
    """
    from matplotlib.patches import Rectangle

    extent = sea.edge[2:] - sea.edge[:2]
    scale = (WIDTH_IN - 2.0 * MARGIN_IN) / float(extent[0])
    height_in = float(extent[1]) * scale + 3.0 * MARGIN_IN
    figure = new_figure(WIDTH_IN, height_in)
    area = (MARGIN_IN / WIDTH_IN, 2.0 * MARGIN_IN / height_in)
    axes = figure.add_axes((*area, 1.0 - 2.0 * area[0], float(extent[1]) * scale / height_in))
    axes.set_xlim(sea.edge[0], sea.edge[2])
    axes.set_ylim(sea.edge[1], sea.edge[3])
    axes.set_axis_off()
    axes.add_patch(
        Rectangle(tuple(sea.edge[:2]), *extent, facecolor=WATER, edgecolor=INK, linewidth=1.5, clip_on=False)
    )
    for rock in sorted(sea.rocks, key=lambda rock: rock.top):
        axes.add_patch(_rock_patch(rock))
    _draw_goal(axes, sea)
    for drawn, start in zip(sea.paths, sea.starts, strict=True):
        axes.plot(*drawn.points.T, color=BLUE, linewidth=1.6, zorder=3)
        axes.add_patch(_boat_patch(start.position, start.heading, boat_width))
    if contacts is not None:
        spots = draw_crowds(axes, FROM_ABOVE.project(contacts), SPOT_IN / scale)
        draw_colour_bar(figure, height_in, spots, "collisions per spot", left=0.78)
    elif trajectories:
        draw_colour_bar(
            figure, height_in, draw_trajectories(axes, trajectories, FROM_ABOVE), "trail: clearance, m", left=0.78
        )
    figure.text(area[0], 1.0 - 0.6 * MARGIN_IN / height_in, _title(sea), color=INK, fontsize=11, va="center")
    legend = "brown: rock     pale, dashed: reef below the water     blue: shortest way     green: goal     red: boat"
    figure.text(area[0], 1.65 * MARGIN_IN / height_in, legend, color=MUTED, fontsize=9, va="center")
    draw_scale_bar(figure, scale, MARGIN_IN, 0.5 * MARGIN_IN)
    save_figure(figure, path, DPI)


def _title(sea: SeaMap) -> str:
    num_reefs = sum(rock.is_reef for rock in sea.rocks)
    lengths = ", ".join(f"{path.length:.1f}" for path in sea.paths)
    return f"{sea.name}: {len(sea.rocks) - num_reefs} rocks, {num_reefs} reefs; shortest way {lengths} m"


def _rock_patch(rock: Rock) -> Any:
    from matplotlib.patches import Polygon

    if rock.is_reef:
        return Polygon(rock.outline, facecolor=REEF, edgecolor=BLUE, linestyle="--", linewidth=0.9, zorder=1)
    return Polygon(rock.outline, facecolor=ROCK, edgecolor=INK, linewidth=0.9, zorder=2)


def _draw_goal(axes: Any, sea: SeaMap) -> None:
    from matplotlib.patches import Circle, Polygon

    goal = sea.goal
    look: dict[str, Any] = {"facecolor": GOOD, "edgecolor": GOOD, "alpha": 0.6, "zorder": 2.5}
    if len(goal.corners) > 1:
        axes.add_patch(Polygon(goal.corners, linewidth=2.0 + goal.tolerance, **look))
    else:
        axes.add_patch(Circle(tuple(goal.centre), goal.tolerance, **look))


def _boat_patch(position: Array, heading: float, width: float) -> Any:
    """Return a boat with a pointed bow."""
    from matplotlib.patches import Polygon

    length = BOAT_LENGTHS * width
    shape = np.array([[0.5, 0.0], [0.2, 0.5], [-0.5, 0.5], [-0.5, -0.5], [0.2, -0.5]]) * [length, width]
    cosine, sine = np.cos(heading), np.sin(heading)
    corners = position + shape @ np.array([[cosine, sine], [-sine, cosine]])
    return Polygon(corners, facecolor=BAD, edgecolor=PAPER, linewidth=0.6, zorder=4)
