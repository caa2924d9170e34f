"""The plan of a cave with its current: arrows where the water goes, the longer and darker the faster."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from aquanav_tools.cave.water.flow import Flow
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.report.cave_map import CaveMap, bounds, lid_rings, silhouette
from aquanav_tools.report.figures import INK, PORTAL, draw_scale_bar, new_figure, save_drawing
from aquanav_tools.report.relief import PLAN, View
from aquanav_tools.report.survey_drawing import DPI, LID_WASH, draw_north, draw_rings
from aquanav_tools.scenario.schema import PRESETS
from aquanav_tools.types import Array

WIDTH_IN, MARGIN_IN, HEAD_IN, FOOT_IN, MAX_HEIGHT_IN = 11.0, 0.7, 0.65, 0.9, 7.5
ARROWS_ACROSS = 90
"""Arrows along the longer side of the drawing, at most."""
SHORTEST = 0.02
"""Slower water than this share of the fastest gets no arrow: it would be a dot."""


def draw_flow(cave: CaveMap, flow: Flow, field: DistanceField, path: Path) -> None:
    """Write the plan with the mean velocity from floor to ceiling at the preset `full`.

    Args:
        cave: its outline.
        flow: the current from portal to portal.
        field: says where there is water.
        path: of the SVG; the PNG goes beside it.
    """
    rings = silhouette(cave.solid, PLAN)
    low, high = bounds(rings)
    size = np.maximum(high - low, 1e-6)
    scale = min((WIDTH_IN - 2 * MARGIN_IN) / size[0], MAX_HEIGHT_IN / size[1])
    height_in = HEAD_IN + FOOT_IN + scale * size[1]
    figure = new_figure(WIDTH_IN, height_in)
    axes = figure.add_axes(
        (0.5 - 0.5 * scale * size[0] / WIDTH_IN, FOOT_IN / height_in, scale * size[0] / WIDTH_IN,
         scale * size[1] / height_in)
    )  # fmt: skip
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.set_axis_off()
    draw_rings(axes, rings)
    for portal in cave.cavity.portals:
        draw_rings(axes, lid_rings(cave.cavity, portal.label, PLAN), LID_WASH, PORTAL, 2.2)
    places, velocities = column_means(flow, field, PLAN, float(max(size)) / ARROWS_ACROSS)
    velocities = PRESETS["full"] * velocities
    speeds = np.linalg.norm(velocities, axis=1)
    moves = speeds > SHORTEST * speeds.max(initial=0.0)
    spacing = float(max(size)) / ARROWS_ACROSS
    arrows = axes.quiver(
        *places[moves].T, *velocities[moves].T, speeds[moves], cmap="YlGnBu",
        clim=(0.0, float(np.quantile(speeds, 0.99))),
        angles="xy", scale_units="xy", scale=float(np.quantile(speeds, 0.95)) / (1.6 * spacing), width=0.0016,
        headwidth=4.0, headlength=4.5, zorder=4, edgecolor=INK, linewidth=0.15,
    )  # fmt: skip
    title = f"{cave.name}: current at full, {PRESETS['full']:g} m/s through {flow.narrowest[0]:.2f} m²"
    figure.text(MARGIN_IN / WIDTH_IN, 1.0 - 0.35 / height_in, title, color=INK, fontsize=13, fontweight="bold")
    smallest = PLAN.project(flow.narrowest[1:])
    axes.plot(
        *smallest, "o", markersize=9, markerfacecolor="none", markeredgecolor=PORTAL, markeredgewidth=1.6, zorder=5
    )
    bar = figure.add_axes((0.5, 0.45 / height_in, 0.3, 0.1 / height_in))
    figure.colorbar(arrows, cax=bar, orientation="horizontal")
    bar.set_title("m/s, mean from floor to ceiling; the ring is the smallest cross-section", fontsize=8, color=INK)
    bar.tick_params(labelsize=8, colors=INK)
    draw_scale_bar(figure, scale, MARGIN_IN, 0.3)
    draw_north(figure, cave.has_north, PLAN)
    save_drawing(figure, path, DPI)


def column_means(flow: Flow, field: DistanceField, plan: View, spacing: float) -> tuple[Array, Array]:
    """Return (N, 2) places of a plan, about `spacing` m apart, and the (N, 2) mean velocity of the water there."""
    points, velocities = flow.nodes()
    is_water = field.clearance(points) > 0.0
    flat, velocities = plan.project(points[is_water]), plan.project(velocities[is_water])
    _, column = np.unique(np.floor(flat / spacing).astype(int), axis=0, return_inverse=True)
    column = column.reshape(-1)
    counts = np.bincount(column)
    means = [np.bincount(column, values) / counts for values in (*flat.T, *velocities.T)]
    return np.stack(means[:2], axis=1), np.stack(means[2:], axis=1)
