"""Pictures of a cave for people: plan and long section with the route, panels and starts, and an episode's trail."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aquanav_tools.report.figures import INK, MUTED, PAPER, PORTAL, draw_scale_bar, new_figure, save_figure
from aquanav_tools.report.relief import Relief, View, cut_away, plan_and_section
from aquanav_tools.report.survey_drawing import draw_north
from aquanav_tools.report.trajectories import CRASH, draw_colour_bar, draw_crowds, draw_trajectories
from aquanav_tools.report.trajectory import TrajectorySummary
from aquanav_tools.types import Array, Mesh, rotation_matrix

if TYPE_CHECKING:
    from aquanav_tools.scenario.schema import Scenario

WIDTH_IN = 13.0
MARGIN_IN = 0.45
TITLE_IN = 0.40
FOOT_IN = 0.75
MAX_VIEWS_HEIGHT_IN = 11.0
DPI = 130
SUPERSAMPLING = 1.25
"""Samples per pixel of the page along each side."""
NAMES = ("Plan, seen from above, turned so that the route runs to the right", "Long section, seen from the side")

ROUTE = "#ffb703"
GOAL = PORTAL


class CavePicture:
    """A cave, cut open: plan above, long section below, on one scale. Shaded once, drawn as often as wanted."""

    is_shared = True
    """All episodes were in one place, so that they can be drawn together."""

    def __init__(self, scenario: Scenario, has_north: bool = False) -> None:
        self._scenario = scenario
        # Of a finished scenario no more is known than how it was built: surveys alone always have compass bearings.
        self._has_north = has_north or scenario.settings.built.kind == "survey"
        self._views = plan_and_section(scenario.guide.centreline)
        self._inches = _inches_per_metre(scenario.cavity.mesh, self._views)
        pixel = 1.0 / (SUPERSAMPLING * self._inches * DPI)
        self._reliefs = [cut_away(scenario.cavity.mesh, view, pixel) for view in self._views]

    def draw(self, path: Path, trajectories: Sequence[TrajectorySummary] = (), contacts: Array | None = None) -> None:
        """Write a PNG with the route, its panels, entrance and goal.

        Without trajectories it shows the starts; with them, trails coloured by clearance and a cross at each contact;
        with (C, 3) contacts, where they crowd.
        """
        height = 0.5 * MARGIN_IN + FOOT_IN + sum(TITLE_IN + self._inches * relief.height for relief in self._reliefs)
        figure = new_figure(WIDTH_IN, height)
        bottom = height - 0.5 * MARGIN_IN
        scale: tuple[Any, str] | None = None
        for view, relief, name in zip(self._views, self._reliefs, NAMES, strict=True):
            bottom -= TITLE_IN + self._inches * relief.height
            axes = _add_view(figure, (self._inches * relief.width, self._inches * relief.height), bottom, height)
            axes.set_title(name, loc="left", color=MUTED, fontsize=10, pad=5)
            _draw_relief(axes, relief)
            _draw_route(axes, self._scenario, view, ROUTE if contacts is None and not trajectories else "white")
            if contacts is not None:
                scale = draw_crowds(axes, view.project(contacts), 0.12 / self._inches), "collisions per spot"
            elif trajectories:
                scale = draw_trajectories(axes, trajectories, view), "trail: clearance, m"
            else:
                _draw_starts(axes, self._scenario, view)
            _label_ends(axes, self._scenario, view)
        draw_scale_bar(figure, self._inches, MARGIN_IN, 0.28)
        draw_north(figure, self._has_north, self._views[0], size_in=0.5, top_in=0.06)
        _draw_key(figure, height, trajectories, contacts is None)
        if scale is not None:
            draw_colour_bar(figure, height, *scale)
        save_figure(figure, path, DPI)


def draw_cave(scenario: Scenario, path: Path, has_north: bool = False) -> None:
    """Write a PNG of a cave, cut open, with its route, panels and starts, and an arrow to the north where y is that."""
    CavePicture(scenario, has_north).draw(path)


def _inches_per_metre(mesh: Mesh, views: tuple[View, View]) -> float:
    """Return the scale at which both views fit the width of the page and, together, a sensible height."""
    spans = np.array([np.ptp(view.project(mesh.vertices), axis=0) for view in views])
    return float(min((WIDTH_IN - 2 * MARGIN_IN) / spans[:, 0].max(), MAX_VIEWS_HEIGHT_IN / spans[:, 1].sum()))


def _add_view(figure: Any, size: tuple[float, float], bottom: float, height: float) -> Any:
    left = 0.5 * (WIDTH_IN - size[0])
    return figure.add_axes((left / WIDTH_IN, bottom / height, size[0] / WIDTH_IN, size[1] / height))


def _draw_relief(axes: Any, relief: Relief) -> None:
    """Draw the relief with a fine outline, and frame it."""
    axes.imshow(relief.colours, extent=relief.extent, interpolation="antialiased", zorder=1)
    axes.contour(
        relief.colours[::2, ::2, 3], levels=[0.5], extent=relief.extent, origin="upper", colors=INK, linewidths=0.7,
        zorder=2,
    )  # fmt: skip
    axes.set_xlim(relief.extent[:2])
    axes.set_ylim(relief.extent[2:])
    axes.set_axis_off()


def _draw_route(axes: Any, scenario: Scenario, view: View, colour: str) -> None:
    from matplotlib.patches import Polygon

    for panel in scenario.guide.panels:
        outline = view.project(np.vstack([panel.polygon, panel.polygon[:1]]))
        axes.add_artist(Polygon(outline, facecolor="white", alpha=0.10, zorder=2))
        axes.plot(*outline.T, color="white", alpha=0.75, linewidth=0.8, zorder=2)
    line = view.project(scenario.guide.centreline)
    axes.plot(*line.T, color=INK, linewidth=2.6, alpha=0.45, zorder=3, solid_capstyle="round")
    axes.plot(*line.T, color=colour, linewidth=1.4, zorder=4, solid_capstyle="round")


def _draw_starts(axes: Any, scenario: Scenario, view: View) -> None:
    """Draw a dot per start with a tick in the direction it looks, as long as the dot is wide."""
    positions = np.array([start.pose.position for start in scenario.starts])
    ahead = np.array([rotation_matrix(start.pose.orientation)[:, 0] for start in scenario.starts])
    axes.quiver(
        *view.project(positions).T,
        *view.project(ahead).T,
        units="inches", angles="xy", scale=6.0, scale_units="inches", width=0.018, headwidth=1.0, headlength=0.0,
        headaxislength=0.0, color="white", zorder=5,
    )  # fmt: skip
    axes.scatter(*view.project(positions).T, s=16, color="white", edgecolors=INK, linewidths=0.7, zorder=6)


def _label_ends(axes: Any, scenario: Scenario, view: View) -> None:
    from matplotlib.patheffects import withStroke

    ends = view.project(scenario.guide.centres[[0, -1]])
    for point, name, colour, marker, side in (
        (ends[0], "Entrance", ROUTE, "o", 1),
        (ends[1], "Goal", GOAL, "*", -1),
    ):
        size = 60 if marker == "o" else 170
        axes.scatter(*point, marker=marker, s=size, color=colour, edgecolors=INK, linewidths=0.9, zorder=9)
        axes.annotate(
            name, point, xytext=(side * 9, 9), textcoords="offset points", ha="left" if side > 0 else "right",
            color=INK, fontsize=11, fontweight="bold", zorder=10,
            path_effects=[withStroke(linewidth=3.0, foreground=PAPER)],
        )  # fmt: skip


def _draw_key(figure: Any, height: float, trajectories: Sequence[TrajectorySummary], has_starts: bool) -> None:
    from matplotlib.lines import Line2D

    route = "#d5dee3" if trajectories or not has_starts else ROUTE  # white would not show on the page
    entries = [
        Line2D([], [], color=route, linewidth=2.0, label="route"),
        Line2D([], [], color="#9fb3bd", marker="|", linestyle="", markersize=11, label="panel"),
    ]
    if has_starts:
        entries.append(
            Line2D([], [], color="white", marker="o", linestyle="", markeredgecolor=INK, markersize=6, label="start")
        )
    if any(trajectory.collided.any() for trajectory in trajectories):
        entries.append(
            Line2D([], [], color=CRASH, marker="x", linestyle="", markeredgewidth=1.8, label="touched the wall")
        )
    figure.legend(
        handles=entries, loc="lower right", bbox_to_anchor=(1.0 - MARGIN_IN / WIDTH_IN, 0.12 / height),
        ncols=len(entries), frameon=False, fontsize=10, labelcolor=INK, handletextpad=0.5, columnspacing=1.6,
    )  # fmt: skip
