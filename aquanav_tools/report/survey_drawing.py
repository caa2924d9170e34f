"""The drawings of a cave survey, in ink: plan, projected elevation and long section, each as SVG and PNG."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.cave.measure.sections import floor_and_ceiling
from aquanav_tools.geometry.polyline import arc_lengths, resample
from aquanav_tools.report.cave_map import CaveMap, bounds, lid_rings, silhouette
from aquanav_tools.report.figures import (
    BAD,
    BLUE,
    GOOD,
    INK,
    MUTED,
    PORTAL,
    WATER,
    draw_scale_bar,
    new_figure,
    save_drawing,
)
from aquanav_tools.report.labels import Labels
from aquanav_tools.report.relief import PLAN, View, plan_and_section
from aquanav_tools.report.survey_overlay import LEG, SURVEY_STATION, draw_legs, in_profile, name_stations
from aquanav_tools.types import Array

DPI = 150
WIDTH_IN = 11.0
MARGIN_IN = 0.7
GAP_IN = 0.3
"""Kept free above and below the cave, for labels."""
HEIGHTS_IN = 0.62
"""Left of this no label stands, since the long section writes its heights there."""
HEAD_IN = 0.65
FOOT_IN = 0.7
MAX_HEIGHT_IN = 7.5
"""Of the cave on the page; a cave as long as wide would fill more than a screen otherwise."""
MIN_HEIGHT_IN = 0.7
"""Of a long section; below this its heights are exaggerated."""
EXAGGERATIONS = (1, 2, 5, 10, 20, 50, 100)
PROFILE_STEP = 0.1
"""Distance between the heights of floor and ceiling in the long section, m."""

LID_WASH = "#fcd0b8"
STATION: dict[str, Any] = {"marker": "o", "markerfacecolor": "white", "markeredgecolor": INK, "markeredgewidth": 0.9}

Project = Callable[[Array], Array]


def draw_plan(cave: CaveMap, path: Path) -> None:
    """Write the plan: the water's outline from above, y up, with a north arrow where y is north.

    Args:
        cave: what to draw.
        path: of the SVG; the PNG goes beside it.
    """
    figure = _draw_view(cave, PLAN, f"Plan, seen from above; {cave.upward}")
    draw_north(figure, cave.has_north, PLAN)
    save_drawing(figure, path, DPI)


def draw_elevation(cave: CaveMap, path: Path) -> None:
    """Write the projected elevation: the water's outline seen from the side, the route running to the right."""
    _, section = plan_and_section(cave.centreline)
    north = np.degrees(np.arctan2(-section.towards[0], -section.towards[1])) % 360.0
    looking = f"looking towards {north:.0f}°" if cave.has_north else cave.north_unknown
    figure = _draw_view(cave, section, f"Projected elevation, {looking}")
    save_drawing(figure, path, DPI)


def draw_long_section(cave: CaveMap, path: Path) -> None:
    """Write the extended elevation: heights of floor, route and ceiling against the distance along the route."""
    line, along, floor, ceiling = profile(cave)
    low, high = np.array([0.0, np.nanmin(floor)]), np.array([along[-1], np.nanmax(ceiling)])
    scale = (WIDTH_IN - 2 * MARGIN_IN) / (high[0] - low[0])
    natural = (high[1] - low[1]) * min(scale, MAX_HEIGHT_IN / (high[1] - low[1]))
    exaggeration = next(n for n in EXAGGERATIONS if n * natural >= MIN_HEIGHT_IN or n == EXAGGERATIONS[-1])
    note = "heights and lengths on one scale" if exaggeration == 1 else f"heights {exaggeration} times exaggerated"
    stretch = np.array([1.0, float(exaggeration)])
    title = f"Long section along the route, {note}"
    figure, axes = _new_sheet(cave, title, low * stretch, high * stretch, foot_in=FOOT_IN + 0.45)
    _draw_key(figure, cave, has_portals=False)
    axes.fill_between(along, exaggeration * floor, exaggeration * ceiling, color=WATER, linewidth=0.0, zorder=1)
    for heights in (floor, ceiling):
        axes.plot(along, exaggeration * heights, color=INK, linewidth=1.2, zorder=2, clip_on=False)
    axes.plot(along, exaggeration * line[:, 2], color=BLUE, linewidth=1.1, dashes=(5, 2.5), zorder=3)
    _draw_height_axis(axes, exaggeration, num_heights=2 + int(exaggeration * natural))

    def project(points: Array) -> Array:
        return unrolled(cave, points) * stretch

    labels = _mark_places(figure, axes, cave, project)
    if cave.survey is not None:
        shown = in_profile(cave, cave.survey, along, floor, ceiling)
        draw_legs(axes, cave.survey, shown, project)
        name_stations(labels, cave.survey, shown, project)
    _number_stations(labels, cave, project)
    save_drawing(figure, path, DPI)


def profile(cave: CaveMap) -> tuple[Array, Array, Array, Array]:
    """Return (N, 3) points of the route, their (N,) distance along it, and floor and ceiling there, m."""
    line = resample(cave.centreline, PROFILE_STEP)
    return line, arc_lengths(line), *floor_and_ceiling(cave.cavity.mesh, line)


def _draw_view(cave: CaveMap, view: View, title: str) -> Any:
    """Return a figure of the water's outline in a view with all that is known to be inside."""
    rings = silhouette(cave.solid, view)
    figure, axes = _new_sheet(cave, title, *bounds(rings))
    _draw_key(figure, cave, has_portals=bool(cave.cavity.portals))
    draw_rings(axes, rings)
    for portal in cave.cavity.portals:
        draw_rings(axes, lid_rings(cave.cavity, portal.label, view), LID_WASH, PORTAL, 2.2)
    if cave.survey is not None:
        draw_legs(axes, cave.survey, np.ones(len(cave.survey.names), dtype=bool), view.project)
    for branch in cave.branches:
        axes.plot(*view.project(branch).T, color=MUTED, linewidth=0.9, dashes=(5, 2.5), zorder=3)
    axes.plot(*view.project(cave.centreline).T, color=BLUE, linewidth=1.1, dashes=(5, 2.5), zorder=3)
    labels = _mark_places(figure, axes, cave, view.project)
    for portal in cave.cavity.portals:
        labels.add(view.project(portal.centre), f"Portal {portal.label}", color=PORTAL)
    if cave.survey is not None:
        name_stations(labels, cave.survey, np.ones(len(cave.survey.names), dtype=bool), view.project)
    _number_stations(labels, cave, view.project)
    return figure


def draw_rings(axes: Any, rings: Sequence[Array], fill: str = WATER, ink: str = INK, linewidth: float = 1.2) -> None:
    """Fill (K, 2) rings and ink their border; rings that run clockwise are holes."""
    from matplotlib.patches import PathPatch
    from matplotlib.path import Path as Outline

    outlines = [Outline(np.vstack([ring, ring[:1]]), closed=True) for ring in rings]
    axes.add_artist(  # a patch's corners would also be looked through for the axes' limits, which are set
        PathPatch(
            Outline.make_compound_path(*outlines), facecolor=fill, edgecolor=ink, linewidth=linewidth,
            joinstyle="round", zorder=1, clip_on=False,
        )
    )  # fmt: skip


def _new_sheet(cave: CaveMap, title: str, low: Array, high: Array, foot_in: float = FOOT_IN) -> tuple[Any, Any]:
    """Return a figure and axes in inches-true scale around the drawing's bounds, with title, scale bar and key."""
    room_in = WIDTH_IN - 2 * MARGIN_IN
    width, height = np.maximum(high - low, 1e-6)
    scale = min(room_in / width, MAX_HEIGHT_IN / height)
    page_height = HEAD_IN + 2 * GAP_IN + scale * height + foot_in
    figure = new_figure(WIDTH_IN, page_height)
    size = np.array([scale * width, scale * height]) / [WIDTH_IN, page_height]
    corner = [0.5 - 0.5 * size[0], (foot_in + GAP_IN) / page_height]
    axes = figure.add_axes((*corner, *size))
    axes.set_xlim(low[0], low[0] + width)
    axes.set_ylim(low[1], low[1] + height)
    axes.set_axis_off()
    left, top = MARGIN_IN / WIDTH_IN, 1.0 - 0.22 / page_height
    figure.text(left, top, cave.name, color=INK, fontsize=13, fontweight="bold", va="top")
    figure.text(left, top - 0.24 / page_height, title, color=MUTED, fontsize=10, va="top")
    draw_scale_bar(figure, scale, MARGIN_IN, 0.28)
    return figure, axes


def _draw_key(figure: Any, cave: CaveMap, has_portals: bool) -> None:
    """Explain the signs that the drawing uses, lower right."""
    from matplotlib.lines import Line2D

    entries = [
        Line2D([], [], color=BLUE, linewidth=1.1, dashes=(5, 2.5), label="route"),
        Line2D([], [], **STATION, linestyle="", markersize=4, label="station"),
    ]
    if cave.survey is not None:
        entries.append(Line2D([], [], **{**SURVEY_STATION, **LEG, "linestyle": "-"}, markersize=4, label="survey"))
    if cave.branches:
        entries.append(Line2D([], [], color=MUTED, linewidth=0.9, dashes=(5, 2.5), label="other passages"))
    if has_portals:
        entries.append(Line2D([], [], color=PORTAL, linewidth=2.2, label="portal"))
    for is_warning, colour, name in ((False, INK, "free width"), (True, BAD, "too narrow for the vehicle")):
        if any(mark.is_warning == is_warning for mark in cave.marks):
            entries.append(Line2D([], [], color=colour, marker="D", linestyle="", markersize=5, label=name))
    figure.legend(
        handles=entries, loc="lower right",
        bbox_to_anchor=(1.0 - MARGIN_IN / WIDTH_IN, 0.14 / figure.get_size_inches()[1]), ncols=len(entries),
        frameon=False, fontsize=9.5, labelcolor=INK, handletextpad=0.5, columnspacing=1.6,
    )  # fmt: skip


def draw_north(figure: Any, has_north: bool, plan: View, size_in: float = 0.62, top_in: float = 0.15) -> None:
    """Draw an arrow to the north in the upper right corner of a page, where y is known to be north."""
    if not has_north:
        return
    width_in, height_in = figure.get_size_inches()
    axes = figure.add_axes(
        ((width_in - MARGIN_IN - size_in) / width_in, (height_in - top_in - size_in) / height_in, size_in / width_in,
         size_in / height_in)
    )  # fmt: skip
    axes.set_axis_off()
    axes.set_xlim(-1.0, 1.0)
    axes.set_ylim(-1.0, 1.0)
    way = plan.project(np.array([0.0, 1.0, 0.0]))
    aside = 0.22 * np.array([-way[1], way[0]])
    for side, colour in ((aside, INK), (-aside, "white")):
        corners = np.array([0.55 * way, -0.75 * way + side, -0.5 * way])
        axes.fill(*corners.T, facecolor=colour, edgecolor=INK, linewidth=0.8, joinstyle="round")
    axes.text(*(0.85 * way), "N", ha="center", va="center", color=INK, fontsize=10, fontweight="bold")


def _draw_height_axis(axes: Any, exaggeration: int, num_heights: int) -> None:
    """Show metres along the route below and heights at the left."""
    axes.set_axis_on()
    axes.spines[["top", "right"]].set_visible(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_position(("outward", 12.0))
        axes.spines[side].set_color(MUTED)
    axes.tick_params(colors=INK, labelsize=9, length=3)
    axes.locator_params(axis="y", nbins=num_heights)
    axes.yaxis.set_major_formatter(lambda height, _: f"{height / exaggeration:g}")
    axes.set_ylabel("height z, m", color=MUTED, fontsize=9)
    axes.set_xlabel("distance along the route, m", color=MUTED, fontsize=9)


def unrolled(cave: CaveMap, points: Array) -> Array:
    """Return the (N, 2) distance along the route and height of (N, 3) points."""
    return np.stack([cave.along(points), points[:, 2]], axis=1)


def _mark_places(figure: Any, axes: Any, cave: CaveMap, project: Project) -> Labels:
    """Draw stations, both ends of the route and the marks, and return their labels, which leave room for more."""
    labels = Labels(figure, axes)
    labels.keep_inside(HEIGHTS_IN, WIDTH_IN)
    stations = project(cave.stations)
    ends = project(cave.centreline[[0, -1]])
    marks = project(cave.places)
    labels.keep_free(np.vstack([stations, marks]), 3.0)
    labels.keep_free(ends, 6.0)
    labels.keep_free(project(cave.centreline), 0.5)
    axes.plot(*stations.T, **STATION, linestyle="", markersize=4, zorder=4, clip_on=False)
    for end, name, marker, colour in zip(ends, ("Entrance", "Goal"), ("o", "*"), (GOOD, PORTAL), strict=True):
        axes.scatter(*end, marker=marker, s=45 if marker == "o" else 150, color=colour, edgecolors=INK,
                     linewidths=0.8, zorder=6, clip_on=False)  # fmt: skip
        labels.add(end, name, fontweight="bold", fontsize=10)
    for point, mark in zip(marks, cave.marks, strict=True):
        colour = BAD if mark.is_warning else INK
        axes.scatter(*point, marker="D", s=24, color=colour, edgecolors="white", linewidths=0.7, zorder=6)
        labels.add(point, mark.text, color=colour, fontweight="bold")
    return labels


def _number_stations(labels: Labels, cave: CaveMap, project: Project) -> None:
    """Write every station's number where there is room."""
    for number, station in enumerate(project(cave.stations)):
        labels.add(station, str(number), must=False, color=MUTED, fontsize=8)
