"""Which wall was seen by how many photos: the cave cut open to show its floor, its ceiling and both its sides."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.cave.cavity import WALL
from aquanav_tools.cave.measure.unseen import UnseenPatch
from aquanav_tools.report.camera import shrink
from aquanav_tools.report.cave_map import CaveMap
from aquanav_tools.report.figures import INK, MUTED, draw_scale_bar, new_figure, save_figure
from aquanav_tools.report.labels import Labels
from aquanav_tools.report.photos.spots import draw_number
from aquanav_tools.report.raster import NO_FACE, rasterise
from aquanav_tools.report.relief import View, plan_and_section
from aquanav_tools.types import Array, IntArray

DPI = 120
SUPERSAMPLING = 2
WIDTH_IN = 11.0
MARGIN_IN = 0.4
TITLE_IN = 0.36
FOOT_IN = 0.72
MAX_VIEWS_IN = 14.0
STEPS = (0, 1, 2, 3, 5, 9)
"""First count of each colour."""
COLOURS = np.array([
    [0.84, 0.19, 0.24], [0.96, 0.60, 0.36], [0.99, 0.87, 0.55], [0.75, 0.88, 0.70], [0.36, 0.68, 0.66],
    [0.10, 0.40, 0.50],
])  # fmt: skip
"""From nobody to many."""
GUESSED = np.array([0.45, 0.30, 0.62])
"""Wall that photos show but that nothing was measured of."""
LID = np.array([0.80, 0.84, 0.86])
FACING = -0.4
"""Places are numbered in the views that show them at less than about 65 degrees."""
LIGHT = np.array([-0.45, 0.55, 0.70])


def draw_coverage(cave: CaveMap, counts: IntArray, patches: Sequence[UnseenPatch], path: Path) -> None:
    """Write four views of the inside.

    Args:
        cave: what to show.
        counts: (F,) photos that show each face of the cavity.
        patches: unseen places, numbered from 1.
        path: of the picture.
    """
    views = _views(cave)
    spans = np.array([np.ptp(view.project(cave.cavity.mesh.vertices), axis=0) for _, view in views])
    scale = float(min((WIDTH_IN - 2 * MARGIN_IN) / spans[:, 0].max(), MAX_VIEWS_IN / spans[:, 1].sum()))
    page = sum(TITLE_IN + scale * span[1] for span in spans) + FOOT_IN
    figure = new_figure(WIDTH_IN, page)
    surface = paint(cave, counts)
    bottom = page
    for (title, view), span in zip(views, spans, strict=True):
        bottom -= TITLE_IN + scale * span[1]
        left = 0.5 * (WIDTH_IN - scale * span[0])
        size = (scale * span[0] / WIDTH_IN, scale * span[1] / page)
        axes = figure.add_axes((left / WIDTH_IN, bottom / page, *size))
        axes.set_title(title, loc="left", fontsize=10, color=MUTED, pad=4)
        _draw_inside(figure, axes, cave, view, surface, scale, patches)
    draw_scale_bar(figure, scale, MARGIN_IN, 0.24)
    _draw_key(figure, page)
    save_figure(figure, path, DPI)


def paint(cave: CaveMap, counts: IntArray) -> Array:
    """Return the (F, 3) colour of each face: by the photos that show it, violet where nothing was measured."""
    cavity = cave.cavity
    colours = COLOURS[np.searchsorted(STEPS, counts, side="right") - 1]
    colours = np.where((~cavity.observed & (counts > 0))[:, None], GUESSED, colours)
    painted: Array = np.where((cavity.labels == WALL)[:, None], colours, LID)
    return painted


def _views(cave: CaveMap) -> tuple[tuple[str, View], ...]:
    """Return views onto each side of the passage from inside; the last one of each pair shows the route mirrored."""
    plan, section = plan_and_section(cave.centreline)
    return (
        ("Floor, seen from above", plan),
        ("Ceiling, seen from below (mirrored: the route runs to the left)", View(-plan.right, plan.up)),
        ("Far wall, seen from the side of the drawings", section),
        ("Near wall, seen from the other side (mirrored)", View(-section.right, section.up)),
    )


def _draw_inside(
    figure: Any, axes: Any, cave: CaveMap, view: View, surface: Array, scale: float, patches: Sequence[UnseenPatch]
) -> None:
    mesh = cave.cavity.mesh
    flat = view.project(mesh.vertices)
    low, high = flat.min(axis=0), flat.max(axis=0)
    pixel = 1.0 / (scale * DPI * SUPERSAMPLING)
    width, height = (max(int(n), 1) for n in np.ceil((high - low) / pixel))
    axes.imshow(
        shrink(_picture(cave, view, surface, low, pixel, (width, height))),
        extent=(low[0], low[0] + width * pixel, low[1], low[1] + height * pixel), interpolation="antialiased",
    )  # fmt: skip
    axes.set_axis_off()
    labels = Labels(figure, axes)
    far = [(n, patch) for n, patch in enumerate(patches, start=1) if patch.outward @ view.towards < FACING]
    places = view.project(np.array([patch.centre for _, patch in far]).reshape(-1, 3))
    labels.keep_free(places, 4.0)
    for (number, _), place in zip(far, places, strict=True):
        draw_number(axes, labels, place, number)


def _picture(cave: CaveMap, view: View, surface: Array, low: Array, pixel: float, size: tuple[int, int]) -> Array:
    """Return the (H, W, 3) colours of the wall whose inner side faces the viewer, lit from the upper left."""
    mesh = cave.cavity.mesh
    axes = np.stack([view.right, view.up, view.towards], axis=1)
    corners, inward = mesh.triangles @ axes, -mesh.normals @ axes
    kept = np.flatnonzero(inward[:, 2] > 0.0)
    light = 0.62 + 0.42 * np.clip(inward[kept] @ (LIGHT / np.linalg.norm(LIGHT)), 0.0, 1.0)
    corners = corners[kept]
    corners[..., 0] = (corners[..., 0] - low[0]) / pixel
    corners[..., 1] = size[1] - (corners[..., 1] - low[1]) / pixel
    faces, _ = rasterise(corners, *size)
    lit = np.clip(surface[kept] * light[:, None], 0.0, 1.0)
    return np.where((faces == NO_FACE)[..., None], 1.0, lit[faces])


def _draw_key(figure: Any, page: float) -> None:
    from matplotlib.patches import Patch

    ends = [*(step - 1 for step in STEPS[1:]), None]
    entries = []
    for first, last, colour in zip(STEPS, ends, COLOURS, strict=True):
        label = f"{first} or more" if last is None else str(first) if last == first else f"{first} to {last}"
        entries.append(Patch(color=tuple(colour), label="no photo" if first == 0 else label))
    entries.append(Patch(color=tuple(GUESSED), label="shown, not measured"))
    legend = figure.legend(
        handles=entries, loc="lower right", bbox_to_anchor=(1.0 - MARGIN_IN / WIDTH_IN, 0.08 / page),
        ncols=len(entries), frameon=False, fontsize=9.5, labelcolor=INK, handlelength=1.0, handleheight=1.0,
        handletextpad=0.4, columnspacing=1.1, title="Photos that show the wall; numbers in red: add photos there",
    )  # fmt: skip
    legend.get_title().set(color=MUTED, fontsize=9)
    legend._legend_box.align = "right"
