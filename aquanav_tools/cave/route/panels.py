"""Placing the panels: cross-sections of the passage along the route, which do not cut each other.

Where a bend is tighter than the passage is wide, planes square to the route cut each other on its inside. There the
panels are turned towards each other, like the spokes of a larger wheel, just as far as needed. Beside a pillar a panel
goes on behind it; around a boulder that hangs free its outline goes all the way.
"""

from __future__ import annotations

from itertools import groupby, pairwise

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.options import PanelOptions
from aquanav_tools.cave.route.crossing import panels_cross
from aquanav_tools.cave.route.guide import Guide, Panel
from aquanav_tools.cave.route.pillars import Pillars
from aquanav_tools.cave.route.route import Route
from aquanav_tools.cave.route.stations import MIN_PANELS, Line, Sight, choose_stations, direct
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.types import Array

CHAIN_WINDOW = 30
"""At most this many panels in a row may be left out."""
TURN_SHARE = 0.2
"""Panels that cross turn towards their common direction by this share of the way per round: they stop within a fifth
of what the crossing needs."""
MAX_ROUNDS = 60
MIN_ALONG = float(np.cos(np.deg2rad(60.0)))
"""A panel leans at most 60 degrees away from the route's direction: beyond, it hardly tells ahead from behind."""


def place_panels(
    cavity: Cavity,
    field: DistanceField,
    route: Route,
    inset: float,
    options: PanelOptions,
    vehicle_radius: float = 0.0,
) -> Guide:
    """Return the guide along a route.

    The straight segment between the centres of two consecutive panels is clear for the vehicle and its margin; where
    the passage is tighter, it keeps about what the route keeps. This is checked exactly against the cavity.
    Neighbouring panels do not cross, unless the passage turns back within one undivided room.

    Args:
        cavity: cut by the panels.
        field: gives the clearance at their centres.
        route: from entrance to goal.
        inset: distance of the first and last panel from the route's ends, m, so that the vehicle reaches the goal
            before it touches the lid behind it.
        options: spacing, smoothing and margin.
        vehicle_radius: m; 0 keeps the segments in the water and no more.

    Raises:
        MeshError: the route is too short for six panels.
    """
    line = _inner_line(route, inset, options)
    sight = Sight(line, cavity.surface, vehicle_radius, options.margin)
    stations = [int(station) for station in choose_stations(line, sight, options)]
    pillars = Pillars(cavity.mesh, field, vehicle_radius, line.points)
    panels = [_panel(pillars, field, line.points[n], line.tangents[n], n * line.step) for n in stations]
    panels = _straighten(pillars, field, panels, line.tangents[stations])
    panels = _turn_until_apart(pillars, field, panels, line.tangents[stations])
    kept = _fewest_crossings(panels, stations, sight, options.spacing)
    return Guide(line.points, tuple(panels[n] for n in kept))


def _inner_line(route: Route, inset: float, options: PanelOptions) -> Line:
    """Return the route without its ends."""
    step = route.length / (len(route.points) - 1)
    first = round(inset / step) if step > 0.0 else len(route.points)
    inner = slice(first, len(route.points) - first)
    if len(route.points[inner]) < MIN_PANELS:
        raise MeshError(
            f"The route of {route.length:.2f} m is too short for {MIN_PANELS} panels that stand {inset:.2f} m from its "
            "ends. The unit is wrong or the passage too short: check --unit."
        )
    return direct(route.points[inner], step, route.clearance[inner], options.tangent_length)


def _panel(pillars: Pillars, field: DistanceField, centre: Array, normal: Array, arc_length: float) -> Panel:
    outline = pillars.outline(centre, normal)
    if outline is None:
        raise MeshError(
            f"No cross-section can be cut at {centre.round(2)} m: the route touches the wall there. Rebuild with a "
            "smaller --closing.voxel, or choose a smaller vehicle with --vehicle."
        )
    return Panel(centre, normal, outline, float(arc_length), field.clearance_at(centre))


def _straighten(pillars: Pillars, field: DistanceField, panels: list[Panel], tangents: Array) -> list[Panel]:
    """Return the panels with those beside one pillar in parallel, so that both ways around it are about as long."""
    panels = list(panels)
    for is_parted, group in groupby(range(len(panels)), key=[panel.is_parted for panel in panels].__getitem__):
        run = list(group)
        common = _unit(np.sum([panels[n].normal for n in run], axis=0))
        for n in run if is_parted else ():
            if common @ tangents[n] >= MIN_ALONG:
                panels[n] = _panel(pillars, field, panels[n].centre, common, panels[n].arc_length)
    return panels


def _turn_until_apart(pillars: Pillars, field: DistanceField, panels: list[Panel], tangents: Array) -> list[Panel]:
    """Return the panels turned until no two neighbours cross, as little as TURN_SHARE allows."""
    panels = list(panels)
    for _ in range(MAX_ROUNDS):
        crossing = [n for n, pair in enumerate(pairwise(panels)) if panels_cross(*pair)]
        turned = _turned_normals(panels, crossing, tangents)
        if not turned:
            break
        for n, normal in turned.items():
            panels[n] = _panel(pillars, field, panels[n].centre, normal, panels[n].arc_length)
    return panels


def _turned_normals(panels: list[Panel], crossing: list[int], tangents: Array) -> dict[int, Array]:
    """Return new normals for the panels that cross the next one, or are crossed, and may still turn."""
    normals = {n: panels[n].normal for pair in crossing for n in (pair, pair + 1)}
    for n in crossing:
        common = _unit(panels[n].normal + panels[n + 1].normal)
        for turning in (n, n + 1):
            normals[turning] = _unit(normals[turning] + TURN_SHARE * (common - panels[turning].normal))
    return {n: normal for n, normal in normals.items() if normal @ tangents[n] >= MIN_ALONG}


def _unit(vector: Array) -> Array:
    unit: Array = vector / np.linalg.norm(vector)
    return unit


def _fewest_crossings(panels: list[Panel], stations: list[int], sight: Sight, max_gap: float) -> list[int]:
    """Return the panels to keep, first and last among them: fewest that cross the next, then most panels.

    Leaving one out must not blind the segment between its neighbours nor leave a gap above `max_gap`.
    """
    best: list[tuple[int, int]] = [(0, 1)] + [(-len(panels), 0)] * (len(panels) - 1)
    previous = [-1] * len(panels)
    for after in range(1, len(panels)):
        for before in range(after - 1, max(-1, after - CHAIN_WINDOW), -1):
            if before < after - 1 and panels[after].arc_length - panels[before].arc_length > max_gap:
                break
            score = best[before][0] - panels_cross(panels[before], panels[after]), best[before][1] + 1
            if score > best[after] and sight.is_clear(stations[before], stations[after]):
                best[after], previous[after] = score, before
    chain = [len(panels) - 1]
    while previous[chain[-1]] >= 0:
        chain.append(previous[chain[-1]])
    return chain[::-1] if len(chain) >= MIN_PANELS else list(range(len(panels)))
