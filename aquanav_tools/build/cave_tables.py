"""The tables of a cave's report."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from aquanav_tools.build.cave_stages import BuiltCave
from aquanav_tools.build.source_words import words_for
from aquanav_tools.cave.route.passability import NARROW_SHARE, Passability
from aquanav_tools.geometry.polyline import arc_lengths
from aquanav_tools.report.cave_map import CaveMap
from aquanav_tools.report.html import Table
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Array


def statistics_table(built: BuiltCave, cave: CaveMap) -> Table:
    """Return all that was measured, in words and units."""
    numbers, words = built.statistics, words_for(built.scenario.settings.built.kind)
    passability, near, place = built.passability, built.passability.clearance, built.passability.narrowest
    main, level = int(np.argmax(numbers.rose)), max(sum(numbers.rose), 1e-9)
    bearing = f"{10 * main}° or {10 * main + 180}°{'' if cave.has_north else ' from y'}"
    sides = ("east-west", "north-south") if cave.has_north else ("x", "y")
    rows = (
        ("Length of the route", f"{numbers.route_length:.2f} m"),
        ("Length with all branches", f"{numbers.total_length:.2f} m"),
        ("Lowest and highest water, z", f"{numbers.lowest:.2f} m and {numbers.highest:.2f} m"),
        ("Vertical range", f"{numbers.vertical_range:.2f} m"),
        (f"Extent {sides[0]} and {sides[1]}", f"{numbers.extent_east:.2f} m x {numbers.extent_north:.2f} m"),
        ("Main bearing", f"{bearing}, {numbers.rose[main] / level:.0%} of the passage"),
        ("Volume of water", f"{numbers.volume:.2f} m³"),
        ("Wall", f"{numbers.wall_area:.2f} m², {numbers.observed_share:.1%} of it {words.seen}"),
        ("Mean cross-section", f"{numbers.mean_section:.2f} m²"),
        ("Volume per metre of length", f"{numbers.volume_per_metre:.2f} m²"),
        ("Largest vehicle (largest sphere that gets through)",
         f"{passability.largest_vehicle:.2f} m wide"
         + (", on another way than the route" if passability.has_wider_way else ", at the narrowest place")),
        ("Narrowest place of the route (width of the passage)",
         f"{place.width:.2f} m wide, {place.arc_length:.1f} m along the route, ({_row(place.position)}) m"),
        ("Least clearance of the route (to the nearest wall)",
         f"{near.least:.2f} m, {near.arc_length:.1f} m along the route, ({_row(near.position)}) m, "
         f"where the passage is {near.width:.2f} m wide"),
        ("Mean clearance of the route", f"{near.mean:.2f} m"),
        ("Largest clearance anywhere (to walls and portals)", f"{numbers.max_clearance:.2f} m"),
        ("Pillars and loops (genus)", str(numbers.genus)),
        ("Surface", f"{numbers.num_triangles} triangles, watertight, voxel {built.voxel:.3f} m"),
        (words.fit, f"median {1000 * built.fit.median:.1f} mm, 95 % within "
                    f"{1000 * built.fit.percentile_95:.1f} mm, {built.fit.within_voxel:.1%} within one voxel"),
    )  # fmt: skip
    return Table("Statistics", ("what", "value"), rows)


def narrow_table(passability: Passability) -> Table:
    """Return the narrow places with the verdict for the vehicle."""
    rows = tuple(
        (f"{narrow.arc_length:.1f}", f"{narrow.width:.3f}", f"{narrow.vehicle_width:.3f}",
         "passes" if narrow.is_passable else "does not pass", _row(narrow.position))
        for narrow in passability.narrows
    )  # fmt: skip
    rows = rows or (("none", "", "", "", ""),)
    below = NARROW_SHARE * passability.vehicle_width
    title = f"Narrow places (below {below:.2f} m, {NARROW_SHARE:g} times the vehicle's width)"
    return Table(title, ("along the route (m)", "width (m)", "vehicle (m)", "verdict", "position (m)"), rows)


def portal_table(built: BuiltCave) -> Table:
    """Return the open ends with their names, and where along the route each is nearest."""
    scenario = built.scenario
    line = scenario.guide.centreline
    rows = []
    for name, lid in zip(end_names(scenario), scenario.cavity.portals, strict=True):
        nearest = int(np.argmin(np.linalg.norm(line - lid.centre, axis=1)))
        along = f"{arc_lengths(line)[nearest]:.1f}"
        rows.append((str(lid.label), name, along, f"{lid.area:.2f}", _row(lid.centre), _row(lid.normal)))
    columns = ("label", "name", "nearest place of the route (m)", "area (m²)", "centre (m)", "normal out of the water")
    return Table("Open ends (portals)", columns, tuple(rows))


def end_names(scenario: Scenario) -> list[str]:
    """Return the name of each portal: "entrance" and "goal", where the route begins and ends, or "side end 3"."""
    portals, panels = scenario.cavity.portals, scenario.guide.centres
    names = [f"side end {lid.label}" for lid in portals]
    if not portals:
        return names
    distances = np.linalg.norm(panels[:, None] - np.array([lid.centre for lid in portals]), axis=2)
    for panel, name in ((0, "entrance"), (len(panels) - 1, "goal")):
        nearest = int(np.argmin(distances[panel]))
        if np.argmin(distances[:, nearest]) == panel:  # else the route only passes by
            names[nearest] = name
    return names


def station_table(cave: CaveMap) -> Table:
    """Return the stations with left, right, up and down."""
    rows = tuple(
        (str(number), f"{s.arc_length:g}", _row(s.centre),
         *(f"{value:.2f}" for value in (s.left, s.right, s.up, s.down, s.width, s.height, s.area)))
        for number, s in enumerate(cave.sections)
    )  # fmt: skip
    columns = ("station", "along (m)", "position (m)", "left", "right", "up", "down", "width", "height", "area (m²)")
    return Table("Stations", columns, rows)


def _row(vector: Sequence[float] | Array) -> str:
    return ", ".join(f"{value:.2f}" for value in vector)
