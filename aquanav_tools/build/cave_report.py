"""The report of a finished build as a caver reads one: drawings, tables of stations, portals and narrow places."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.build.cave_stages import BuiltCave
from aquanav_tools.build.cave_tables import end_names, narrow_table, portal_table, station_table, statistics_table
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.outputs import footer, notices
from aquanav_tools.build.source_words import words_for
from aquanav_tools.cave.measure.sections import cross_sections, station_spacing
from aquanav_tools.cave.route.passability import Narrow, Passability
from aquanav_tools.report.cave_map import CaveMap, Mark
from aquanav_tools.report.html import Fact, Figure, Model, Page, Section
from aquanav_tools.report.scene_model import scene_caption, write_scene
from aquanav_tools.report.section_sheet import draw_rose, draw_sections, draw_sizes
from aquanav_tools.report.survey_drawing import draw_elevation, draw_long_section, draw_plan
from aquanav_tools.report.views import draw_ends, draw_views
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.appearance import vehicle_mesh
from aquanav_tools.sim.vehicle import parse_vehicle
from aquanav_tools.survey.legs import SurveyLegs
from aquanav_tools.survey.write import write_svx
from aquanav_tools.types import Array

VIEW = "view.glb"
"""What the report shows in 3D: the cave in fewer triangles, its route, and the vehicle to scale."""
DRAWINGS_DIR = "drawings"
"""Folder, in the scenario's, of the drawings as SVG and PNG and of the centreline for Survex."""


def map_of(
    scenario: Scenario,
    narrows: Sequence[Narrow],
    branches: Sequence[Array] = (),
    has_north: bool = False,
    survey: SurveyLegs | None = None,
) -> CaveMap:
    """Return what the drawings of a scenario show, with stations a round number of metres apart.

    Args:
        scenario: the cave.
        narrows: places to mark along the guide.
        branches: (C, 3) further lines of the centreline, m.
        has_north: whether y is north.
        survey: what the cave was made from, in the scenario's frame.
    """
    words = words_for(scenario.settings.built.kind)
    line = scenario.guide.centreline
    marks = tuple(
        Mark(narrow.position, f"{narrow.width:.2f} m", narrow.width, not narrow.is_passable) for narrow in narrows
    )
    sections = cross_sections(scenario.cavity, line, station_spacing(scenario.guide.length))
    return CaveMap(
        scenario.name, scenario.cavity, line, sections, marks, tuple(branches), has_north, words.north_unknown,
        words.seen, words.filled, survey,
    )  # fmt: skip


def write_drawings(cave: CaveMap, scenario: Scenario, rose: Sequence[float], folder: Path) -> tuple[Figure, ...]:
    """Write all drawings, views and the centreline into a new folder, and return the figures for the report."""
    folder.mkdir()
    draw_plan(cave, folder / "plan.svg")
    draw_long_section(cave, folder / "long-section.svg")
    draw_sections(cave, folder / "cross-sections.svg")
    draw_elevation(cave, folder / "elevation.svg")
    draw_sizes(cave, folder / "sizes.svg")
    draw_rose(cave.name, rose, folder / "rose.svg", cave.has_north)
    draw_views(cave, tuple(panel.polygon for panel in scenario.guide.panels), folder / "views.png")
    write_centreline(cave, folder / "centreline.svx")
    ends: tuple[Figure, ...] = ()
    if cave.cavity.portals:
        draw_ends(cave, end_names(scenario), folder / "ends.png")
        ends = (Figure(folder / "ends.png", "The open ends from inside, as named in the table."),)
    return (
        Figure(
            folder / "plan.svg",
            f"Plan: the water's outline from above, {cave.upward}. Numbers are stations of the table below.",
        ),
        Figure(folder / "long-section.svg", "Long section: floor and ceiling straight below and above the route."),
        Figure(folder / "cross-sections.svg", "Cross-sections at the stations, all on one scale; left is left."),
        Figure(folder / "elevation.svg", "Projected elevation: the water's outline seen from the side."),
        Figure(
            folder / "sizes.svg",
            "Size of the passage along the route; diamonds are free widths.",
            columns=2,
        ),
        Figure(folder / "rose.svg", "Rose: share of the passage by direction, in sectors of 10 degrees.", columns=1),
        Figure(folder / "views.png", f"The cavity from outside and inside; violet wall was {cave.filled}."),
        *ends,
    )


def cave_model(scenario: Scenario, folder: Path, colours: npt.NDArray[np.uint8] | None) -> Model:
    """Write the 3D view of a cave, with its vehicle at the first start, into a folder; return it for the report.

    Args:
        scenario: the cave.
        folder: which gets `view.glb`.
        colours: (V, 3) sRGB per vertex of the cavity, where the scan has some.
    """
    path = folder / VIEW
    placed = None
    if scenario.vehicle_toml and scenario.starts:
        vehicle = parse_vehicle(scenario.vehicle_toml, f"vehicle of the scenario {scenario.name}")
        placed = vehicle_mesh(vehicle), scenario.starts[0].pose
    write_scene(scenario, path, placed, colours=colours)
    return Model(path, scene_caption(scenario, has_own_colours=colours is not None))


def write_centreline(cave: CaveMap, path: Path) -> None:
    """Write the stations, and the end of the route, as a Survex centreline with passage dimensions.

    Of a cave made from a survey, its stations and legs follow under their own names, in the same coordinates.
    """
    lrud = np.array([[s.left, s.right, s.up, s.down] for s in cave.sections])
    points, end = cave.stations, cave.centreline[-1]
    if not np.allclose(points[-1], end):
        points, lrud = np.vstack([points, end]), np.vstack([lrud, np.full(4, np.nan)])
    write_svx(path, cave.name, points, lrud, {"entrance": 0} if cave.cavity.portals else None, cave.survey)


def survey_facts(cave: CaveMap) -> dict[str, Any]:
    """Return the stations, and what is known of directions, as plain values, for report.json."""
    sizes = ("arc_length", "left", "right", "up", "down", "width", "height", "area", "perimeter")
    return {
        "has_north": cave.has_north,
        "stations": [
            {"position": section.centre.tolist(), **{name: getattr(section, name) for name in sizes}}
            for section in cave.sections
        ],
    }


def cave_page(
    built: BuiltCave,
    cave: CaveMap,
    figures: Sequence[Figure],
    journal: Journal,
    sections: Sequence[Section] = (),
    models: Sequence[Model] = (),
) -> Page:
    """Return the report of a finished build; further sections tell how the photos fared and what the stages cost."""
    numbers = built.statistics
    summary = (
        f"{numbers.route_length:.1f} m of passage between {numbers.lowest:.1f} and {numbers.highest:.1f} m of height, "
        f"{numbers.volume:.1f} m³ of water behind {_count(numbers.num_portals, 'portal')}. "
        + _verdict(built.passability)
    )
    return Page(
        title=heading(built.scenario.name),
        summary=summary,
        facts=_headline(built),
        warnings=notices(journal),
        figures=tuple(figures),
        tables=(
            statistics_table(built, cave),
            narrow_table(built.passability),
            portal_table(built),
            station_table(cave),
        ),
        models=tuple(models),
        sections=tuple(sections),
        footer=footer(),
    )


def heading(name: str) -> str:
    """Return the title of a cave's report: "Cave kiss", but "Demo-cave" and not "Cave demo-cave"."""
    return f"{name[0].upper()}{name[1:]}" if "cave" in name.lower() else f"Cave {name}"


def _verdict(passability: Passability) -> str:
    """Return a sentence on whether the vehicle gets through."""
    tight = [narrow for narrow in passability.narrows if not narrow.is_passable]
    least = passability.narrowest
    if tight:
        return f"The vehicle does not pass {_count(len(tight), 'place')}; the tightest leaves {least.width:.2f} m."
    return (
        f"The vehicle, {least.vehicle_width:.2f} m wide, passes everywhere; the narrowest place, "
        f"{least.arc_length:.1f} m along the route, leaves {least.width:.2f} m."
    )


def _headline(built: BuiltCave) -> tuple[Fact, ...]:
    numbers, fit, passability = built.statistics, built.fit, built.passability
    words = words_for(built.scenario.settings.built.kind)
    where = (
        "by another way than the route"
        if passability.has_wider_way
        else f"held up {passability.narrowest.arc_length:.1f} m along the route"
    )
    return (
        Fact("Length", f"{numbers.route_length:.1f} m", f"of route, {numbers.total_length:.1f} m of passages"),
        Fact("Depth range", f"{numbers.vertical_range:.1f} m", f"z {numbers.lowest:.1f} to {numbers.highest:.1f} m"),
        Fact("Water", f"{numbers.volume:.1f} m³", f"{numbers.wall_area:.0f} m² of wall"),
        Fact("Mean section", f"{numbers.mean_section:.2f} m²", "across the route"),
        Fact("Largest vehicle", f"{passability.largest_vehicle:.2f} m", f"wide, {where}"),
        Fact(words.observed, f"{numbers.observed_share:.1%}", f"the rest was {words.filled}"),
        Fact(words.fit, f"{1e3 * fit.median:.1f} mm", f"median; 95 % within {1e3 * fit.percentile_95:.0f} mm"),
        Fact("Starts", str(len(built.scenario.starts)), f"for the vehicle {built.scenario.settings.vehicle}"),
    )  # fmt: skip


def _count(number: int, what: str) -> str:
    return f"{number} {what}" + ("" if number == 1 else "s")
