"""The picture of an action sequence replayed in currents: its ways through the cave, and how far off they lead."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from aquanav_tools.cave.cavity import Cavity, to_manifold
from aquanav_tools.report.cave_map import bounds, lid_rings, silhouette
from aquanav_tools.report.figures import BAD, INK, MUTED, PORTAL, new_figure, save_drawing
from aquanav_tools.report.relief import plan_and_section
from aquanav_tools.report.survey_drawing import LID_WASH, draw_rings
from aquanav_tools.report.trajectory import Trajectory
from aquanav_tools.types import Array

DPI = 150
WIDTH_IN, MARGIN_IN, PLOT_IN, MAX_PLAN_IN = 11.0, 0.7, 2.6, 6.0
CURRENT_COLOURS = ("#2a9d8f", "#1f6f8b", "#7b2cbf", "#e9a23b")
"""In the order of the currents; contacts are red."""

Replays = Sequence[tuple[str, Sequence[tuple[Trajectory, Array]]]]
"""For every current, its name and its trajectories with their (D + 1,) deviation, m."""


def draw_impact(name: str, cavity: Cavity, ideal: Trajectory, centreline: Array, replays: Replays, path: Path) -> None:
    """Write the plan with all ways, and the deviation over time below it.

    Args:
        name: of the cave.
        cavity: its outline.
        ideal: the dive in still water.
        centreline: (C, 3) the route, m: runs to the right.
        replays: the dives in currents.
        path: of the SVG; the PNG goes beside it.
    """
    plan, _ = plan_and_section(centreline)
    rings = silhouette(to_manifold(cavity.mesh), plan)
    low, high = bounds(rings)
    size = high - low
    scale = min((WIDTH_IN - 2 * MARGIN_IN) / size[0], MAX_PLAN_IN / size[1])
    height_in = 0.7 + scale * size[1] + 0.6 + PLOT_IN + 0.6
    figure = new_figure(WIDTH_IN, height_in)
    width = scale * size[0] / WIDTH_IN
    plan_axes = figure.add_axes((0.5 - 0.5 * width, (PLOT_IN + 1.2) / height_in, width, scale * size[1] / height_in))
    plan_axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    plan_axes.set_axis_off()
    draw_rings(plan_axes, rings)
    for portal in cavity.portals:
        draw_rings(plan_axes, lid_rings(cavity, portal.label, plan), LID_WASH, PORTAL, 2.0)
    below = figure.add_axes((MARGIN_IN / WIDTH_IN, 0.6 / height_in, 1 - 2 * MARGIN_IN / WIDTH_IN, PLOT_IN / height_in))
    for (current, runs), colour in zip(replays, CURRENT_COLOURS * len(replays), strict=False):
        for number, (trajectory, deviation) in enumerate(runs):
            label = current if number == 0 else None
            plan_axes.plot(*plan.project(trajectory.positions).T, color=colour, linewidth=0.9, alpha=0.75, zorder=3)
            contacts = plan.project(trajectory.positions[trajectory.contact_states])
            plan_axes.plot(*contacts.T, "x", color=BAD, markersize=5, zorder=5)
            below.plot(
                trajectory.times[: len(deviation)], deviation, color=colour, linewidth=1.0, alpha=0.75, label=label
            )
            touched = trajectory.contact_states[trajectory.contact_states < len(deviation)]
            below.plot(trajectory.times[touched], deviation[touched], "x", color=BAD, markersize=4)
    plan_axes.plot(*plan.project(ideal.positions).T, color=INK, linewidth=2.0, zorder=4, label="still")
    below.axhline(0.0, color=INK, linewidth=2.0, label="still")
    below.plot([], [], "x", color=BAD, label="contact")
    below.legend(frameon=False, ncols=len(replays) + 2, loc="upper left", fontsize=9)
    below.set(xlabel="time, s", ylabel="off the ideal way, m", xlim=(0.0, float(ideal.times[-1])))
    below.set_ylim(bottom=0.0)
    below.spines[["top", "right"]].set_visible(False)
    below.spines[["left", "bottom"]].set_color(MUTED)
    title = f"{name}: one sequence of actions, ideal in still water, in currents"
    figure.text(MARGIN_IN / WIDTH_IN, 1.0 - 0.4 / height_in, title, color=INK, fontsize=13, fontweight="bold")
    save_drawing(figure, path, DPI)
