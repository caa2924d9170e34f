"""Where the photos were taken and which way they look: plan and long section, with the places that need more."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.cave.measure.unseen import UnseenPatch
from aquanav_tools.geometry.polyline import arc_lengths, point_at
from aquanav_tools.report.cave_map import CaveMap, bounds, silhouette
from aquanav_tools.report.figures import BAD, INK, MUTED, WATER, draw_scale_bar, new_figure, save_drawing
from aquanav_tools.report.labels import Labels
from aquanav_tools.report.photos.spots import draw_number
from aquanav_tools.report.relief import PLAN, plan_and_section
from aquanav_tools.report.survey_drawing import WIDTH_IN, draw_north, draw_rings, profile, unrolled
from aquanav_tools.types import Array, IntArray, PointCloud

DPI = 150
MARGIN_IN = 0.7
GAP_IN = 0.32
"""Around each view, for labels."""
HEAD_IN = 0.62
TITLE_IN = 0.3
FOOT_IN = 0.8
MAX_VIEWS_IN = 8.0
WEDGE_IN = 0.34
"""Length of a camera's wedge that lies in the page; one that looks at the reader is shorter."""
HALF_WIDTH = 0.42
"""Half a wedge's width over its length."""
MAX_NUMBERED = 16
TANGENT = 0.5
"""The route's direction is taken over this much of it on both sides, m."""
COLOURS = "viridis"
LAST_COLOUR = 0.88
"""Of the colour map: its yellow end is too pale on paper."""
MAX_DOTS = 20_000


@dataclass(frozen=True, eq=False)
class PhotoTrail:
    """The registered photos in the order of the sequence, and the others."""

    names: tuple[str, ...]
    numbers: IntArray
    """(C,) place of each in the sequence of all photos, from 1, rising."""
    positions: Array
    """(C, 3) m."""
    ahead: Array
    """(C, 3) unit vectors along the views."""
    missing: tuple[tuple[int, str], ...] = ()
    """Place in the sequence and name of the photos that did not register."""

    def gaps(self) -> list[tuple[Array, str]]:
        """Return for each run of missing photos about where it was taken, (3,), and what to call it."""
        runs: list[list[tuple[int, str]]] = []
        for number, name in sorted(self.missing):
            if runs and runs[-1][-1][0] == number - 1:
                runs[-1].append((number, name))
            else:
                runs.append([(number, name)])
        found = []
        for run in runs:
            after = int(np.searchsorted(self.numbers, run[0][0]))
            beside = self.positions[max(after - 1, 0) : after + 1]
            text = str(run[0][0]) if len(run) == 1 else f"{run[0][0]} to {run[-1][0]}"
            found.append((beside.mean(axis=0), text))
        return found


Flatten = Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class _View:
    """One of the two drawings: how places and directions become flat, and what lies behind the cameras."""

    title: str
    place: Flatten
    """(N, 3) to (N, 2) m."""
    turn: Callable[[Array, Array], Array]
    """(N, 3) places and (N, 3) directions there to (N, 2), no longer than 1."""
    draw_behind: Callable[[Any], None]
    low: Array
    high: Array


def draw_camera_map(cave: CaveMap, trail: PhotoTrail, patches: Sequence[UnseenPatch], path: Path) -> None:
    """Write plan and long section of a cave with its cameras as SVG at `path` and PNG beside it.

    Args:
        cave: the outline.
        trail: the photos.
        patches: unseen wall, numbered from 1, with an arrow from where to look at it.
        path: of the SVG.
    """
    rings = silhouette(cave.solid, PLAN)
    seen = np.vstack([PLAN.project(trail.positions), *rings])
    above = _View(
        f"Plan, seen from above; {cave.upward}", PLAN.project, lambda _, ways: PLAN.project(ways),
        lambda axes: draw_rings(axes, rings), *bounds([seen]),
    )  # fmt: skip
    figure = _draw_sheet(cave.name, (above, _long_section(cave, trail)), trail, patches)
    draw_north(figure, cave.has_north, PLAN)
    save_drawing(figure, path, DPI)


def draw_camera_cloud(name: str, cloud: PointCloud, trail: PhotoTrail, path: Path) -> None:
    """Write the cameras before the points they saw, where no cave came of it: from above and from the side.

    Args:
        name: of the build.
        cloud: points.
        trail: the photos.
        path: of the SVG; the PNG goes beside it.
    """
    views = []
    points = cloud.points[:: max(1, len(cloud.points) // MAX_DOTS)]
    for view, title in zip(plan_and_section(trail.positions), ("Seen from above", "Seen from the side"), strict=True):
        flat = view.project(points)
        low, high = np.percentile(flat, 1.0, axis=0), np.percentile(flat, 99.0, axis=0)
        inside = flat[np.all((flat >= low) & (flat <= high), axis=1)]
        ends = bounds([view.project(trail.positions), inside])
        views.append(
            _View(title, view.project, lambda _, ways, view=view: view.project(ways),  # type: ignore[misc]
                  lambda axes, dots=inside: _draw_dots(axes, dots), *ends)  # type: ignore[misc]
        )  # fmt: skip
    save_drawing(_draw_sheet(name, tuple(views), trail, ()), path, DPI)


def _draw_dots(axes: Any, dots: Array) -> None:
    axes.scatter(*dots.T, s=0.5, color="#9fb3bd", linewidths=0.0, rasterized=True, zorder=1)


def _long_section(cave: CaveMap, trail: PhotoTrail) -> _View:
    _, along, floor, ceiling = profile(cave)

    def turn(places: Array, ways: Array) -> Array:
        lengths = arc_lengths(cave.centreline)
        here = cave.along(places)
        behind, before = (point_at(cave.centreline, lengths, here + step) for step in (-TANGENT, TANGENT))
        tangent = (before - behind)[:, :2]
        tangent /= np.maximum(np.linalg.norm(tangent, axis=1, keepdims=True), 1e-9)
        return np.stack([np.einsum("ij,ij->i", ways[:, :2], tangent), ways[:, 2]], axis=1)

    def draw(axes: Any) -> None:
        axes.fill_between(along, floor, ceiling, color=WATER, linewidth=0.0, zorder=1)
        for heights in (floor, ceiling):
            axes.plot(along, heights, color=INK, linewidth=1.2, zorder=2, clip_on=False)

    flat = unrolled(cave, trail.positions)
    low = np.array([0.0, min(np.nanmin(floor), flat[:, 1].min())])
    high = np.array([along[-1], max(np.nanmax(ceiling), flat[:, 1].max())])
    return _View("Long section along the route", lambda points: unrolled(cave, points), turn, draw, low, high)


def _draw_sheet(name: str, views: tuple[_View, ...], trail: PhotoTrail, patches: Sequence[UnseenPatch]) -> Any:
    spans = np.array([np.maximum(view.high - view.low, 1e-3) for view in views])
    scale = float(min((WIDTH_IN - 2 * MARGIN_IN) / spans[:, 0].max(), MAX_VIEWS_IN / spans[:, 1].sum()))
    page = HEAD_IN + sum(TITLE_IN + 2 * GAP_IN + scale * span[1] for span in spans) + FOOT_IN
    figure = new_figure(WIDTH_IN, page)
    left, top = MARGIN_IN / WIDTH_IN, 1.0 - 0.2 / page
    figure.text(left, top, name, color=INK, fontsize=13, fontweight="bold", va="top")
    count = len(trail.names) + len(trail.missing)
    subtitle = f"{len(trail.names)} of {count} photos, where they were taken and which way they look"
    figure.text(left, top - 0.24 / page, subtitle, color=MUTED, fontsize=10, va="top")
    bottom = page - HEAD_IN
    for view, span in zip(views, spans, strict=True):
        bottom -= TITLE_IN + 2 * GAP_IN + scale * span[1]
        size = scale * span
        corner = (0.5 * (WIDTH_IN - size[0]) / WIDTH_IN, (bottom + GAP_IN) / page)
        axes = figure.add_axes((*corner, size[0] / WIDTH_IN, size[1] / page))
        figure.text(left, (bottom + size[1] + 2 * GAP_IN + 0.06) / page, view.title, color=MUTED, fontsize=10)
        axes.set_xlim(view.low[0], view.low[0] + span[0])
        axes.set_ylim(view.low[1], view.low[1] + span[1])
        axes.set_axis_off()
        view.draw_behind(axes)
        _draw_photos(figure, axes, view, trail, patches, scale)
    draw_scale_bar(figure, scale, MARGIN_IN, 0.28)
    _draw_key(figure, trail, bool(patches))
    return figure


def _draw_photos(
    figure: Any, axes: Any, view: _View, trail: PhotoTrail, patches: Sequence[UnseenPatch], scale: float
) -> None:
    from matplotlib.collections import PolyCollection

    places = view.place(trail.positions)
    colours = _colours(trail)
    axes.plot(*places.T, color=MUTED, linewidth=0.7, alpha=0.6, zorder=3)
    wedges = wedges_of(places, view.turn(trail.positions, trail.ahead), WEDGE_IN / scale)
    axes.add_collection(
        PolyCollection(list(wedges), facecolors=colours, edgecolors=colours, alpha=0.5, linewidths=0.6, zorder=4,
                       clip_on=False)
    )  # fmt: skip
    axes.scatter(*places.T, s=13, c=colours, edgecolors="white", linewidths=0.5, zorder=6, clip_on=False)
    labels = Labels(figure, axes)
    labels.keep_free(places, 2.0)
    for number, patch in enumerate(patches, start=1):
        _draw_patch(axes, labels, view, patch, number)
    for place, text in trail.gaps():
        flat = view.place(place[None])[0]
        axes.scatter(*flat, marker="x", s=40, color=BAD, linewidths=1.6, zorder=8, clip_on=False)
        labels.add(flat, text, must=False, color=BAD, fontsize=8.5)
    every = -(-len(places) // MAX_NUMBERED)
    chosen = sorted({*range(0, len(places), every), len(places) - 1})
    for row in chosen:
        labels.add(places[row], str(trail.numbers[row]), must=row in (0, len(places) - 1), color=INK, fontsize=8.5)


def wedges_of(places: Array, ways: Array, length: float) -> Array:
    """Return the (N, 3, 2) corners of triangles that open from (N, 2) places along (N, 2) directions."""
    ahead = length * ways
    aside = HALF_WIDTH * length * np.stack([-ways[:, 1], ways[:, 0]], axis=1)
    aside /= np.maximum(np.linalg.norm(ways, axis=1, keepdims=True), 0.2)  # a foreshortened wedge stays as wide
    return np.stack([places, places + ahead + aside, places + ahead - aside], axis=1)


def _draw_patch(axes: Any, labels: Labels, view: _View, patch: UnseenPatch, number: int) -> None:
    """Draw an arrow from where to stand to the unseen wall, and its number at the wall."""
    stand, wall = view.place(np.stack([patch.stand, patch.centre]))
    axes.annotate(
        "", wall, xytext=stand, annotation_clip=False, zorder=9,
        arrowprops={"arrowstyle": "-|>", "color": BAD, "linewidth": 1.5, "shrinkA": 0.0, "shrinkB": 1.0},
    )  # fmt: skip
    axes.scatter(*stand, s=16, facecolor="white", edgecolors=BAD, linewidths=1.3, zorder=10, clip_on=False)
    draw_number(axes, labels, wall, number)


def _colours(trail: PhotoTrail) -> Any:
    import matplotlib

    last = max(int(trail.numbers.max()) - 1, 1)
    return matplotlib.colormaps[COLOURS](LAST_COLOUR * (trail.numbers - 1) / last)


def _draw_key(figure: Any, trail: PhotoTrail, has_patches: bool) -> None:
    from matplotlib.lines import Line2D

    page = figure.get_size_inches()[1]
    colours = _colours(trail)
    entries = [
        Line2D([], [], color=colours[row], marker="<", linestyle="", markersize=8,
               label=f"{trail.numbers[row]}  {trail.names[row]}")
        for row in (0, -1)
    ]  # fmt: skip
    if trail.missing:
        label = "about here: photos that did not register"
        entries.append(Line2D([], [], color=BAD, marker="x", linestyle="", markeredgewidth=1.6, label=label))
    if has_patches:
        label = "add photos here: stand at the ring, look along the arrow"
        entries.append(Line2D([], [], color=BAD, marker="D", linestyle="", markersize=5, label=label))
    figure.legend(
        handles=entries, loc="lower right", bbox_to_anchor=(1.0 - MARGIN_IN / WIDTH_IN, 0.1 / page),
        ncols=2, frameon=False, fontsize=9.5, labelcolor=INK, handletextpad=0.5, columnspacing=1.6,
    )  # fmt: skip
