"""Placing the panels: cross-sections of the passage along the route, none of which cuts another."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.field import DistanceField
from aquanav_tools.cave.guide import Guide, Panel
from aquanav_tools.cave.options import PanelOptions
from aquanav_tools.cave.portals import plane_axes, section_polygon
from aquanav_tools.cave.route import Route
from aquanav_tools.errors import MeshError
from aquanav_tools.types import Array

CHAIN_WINDOW = 30
"""A gap of more panels than this cannot be bridged when panels that cut each other are left out."""
MAX_OVERLAP = 0.02
"""Share of a panel's outline that may lie on the wrong side of its neighbour's plane."""


def place_panels(cavity: Cavity, field: DistanceField, route: Route, inset: float, options: PanelOptions) -> Guide:
    """Return the guide along a route.

    Args:
        cavity: cut by the panels.
        field: gives the clearance at their centres.
        route: from entrance to goal.
        inset: distance of the first and last panel from the route's ends, m, so that the vehicle reaches the goal
            before it touches the lid behind it.
        options: spacing and smoothing.

    Raises:
        MeshError: the route is too short for two panels.
    """
    step = route.length / (len(route.points) - 1)
    first = round(inset / step)
    centreline = route.points[first : len(route.points) - first]
    if len(centreline) < 3 or (len(centreline) - 1) * step < options.spacing:
        raise MeshError(
            f"The route of {route.length:.2f} m is too short for two panels {options.spacing:.2f} m apart and "
            f"{inset:.2f} m from its ends. The unit is wrong or the passage too short: check --unit."
        )
    tangents = _tangents(centreline, max(1, round(0.5 * options.tangent_length / step)))
    count = max(2, round((len(centreline) - 1) * step / options.spacing) + 1)
    stations = np.unique(np.round(np.linspace(0, len(centreline) - 1, count)).astype(int))
    panels = [_panel(cavity, field, centreline[n], tangents[n], n * step) for n in stations]
    kept = _longest_chain([panel for panel in panels if panel is not None])
    if len(kept) < 2:
        raise MeshError(
            f"All {len(stations)} cross-sections along the route of {route.length:.2f} m cut each other: the cave is "
            "wider than its passage is long. Scan more of the passage, or set a smaller --panels.spacing."
        )
    first, last = (round(panel.arc_length / step) for panel in (kept[0], kept[-1]))
    return Guide(centreline[first : last + 1], tuple(_moved(panel, kept[0].arc_length) for panel in kept))


def _tangents(points: Array, half_window: int) -> Array:
    """Return the (C, 3) unit directions of a polyline, each over a window of points."""
    ahead = np.minimum(np.arange(len(points)) + half_window, len(points) - 1)
    behind = np.maximum(np.arange(len(points)) - half_window, 0)
    chords = points[ahead] - points[behind]
    unit: Array = chords / np.linalg.norm(chords, axis=1, keepdims=True)
    return unit


def _panel(cavity: Cavity, field: DistanceField, centre: Array, normal: Array, arc_length: float) -> Panel | None:
    section = section_polygon(cavity.mesh, centre, normal)
    if section is None:
        return None
    outline = np.asarray(section.exterior.coords)[:-1] @ plane_axes(normal) + centre
    return Panel(centre, normal, outline, float(arc_length), field.clearance_at(centre))


def _longest_chain(panels: list[Panel]) -> list[Panel]:
    """Return the most panels, in order, of which none cuts the one before.

    In a sharp bend of a wide passage neighbouring cross-sections cut each other on the inside.
    """
    lengths, previous = [1] * len(panels), [-1] * len(panels)
    for after in range(len(panels)):
        for before in range(after - 1, max(-1, after - CHAIN_WINDOW), -1):
            if lengths[before] >= lengths[after] and not _cross(panels[before], panels[after]):
                lengths[after], previous[after] = lengths[before] + 1, before
    chain = [int(np.argmax(lengths))]
    while previous[chain[-1]] >= 0:
        chain.append(previous[chain[-1]])
    return [panels[n] for n in reversed(chain)]


def _moved(panel: Panel, start: float) -> Panel:
    return replace(panel, arc_length=panel.arc_length - start)


def _cross(before: Panel, after: Panel) -> bool:
    behind = (after.polygon - before.centre) @ before.normal < 0.0
    ahead = (before.polygon - after.centre) @ after.normal > 0.0
    return bool(behind.mean() > MAX_OVERLAP or ahead.mean() > MAX_OVERLAP)
