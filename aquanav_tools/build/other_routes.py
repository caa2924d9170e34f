"""A scenario for each further pair of a cave's open ends, in the folder "routes" of its own."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations
from pathlib import Path

from aquanav_tools.build.cave_stages import BuiltCave, with_route
from aquanav_tools.build.cave_tables import end_names
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.build.output_folder import ROUTES_DIR
from aquanav_tools.build.scenario_folder import Source, write_folder
from aquanav_tools.errors import MeshError
from aquanav_tools.report.html import Section, Table
from aquanav_tools.scenario.schema import Scenario


def write_other_routes(
    built: BuiltCave, source: Source, options: BuildOptions, journal: Journal, folder: Path
) -> tuple[Section, ...]:
    """Write the scenarios of all pairs of ends that the route does not join; return what the report says of them.

    Args:
        built: the cave with its own route.
        source: what it was built from.
        options: settings of the stages; where they do not ask for all routes nothing is written.
        journal: notes which pairs a vehicle cannot dive between.
        folder: of the cave's own scenario.
    """
    if options.route.routes != "all":
        return ()
    pairs = list(_other_pairs(built.scenario))
    if not pairs:
        number = len(built.scenario.cavity.portals)
        journal.warn("no-other-routes", f"The cave has {number} open ends, and no two that its route does not join.")
        return ()
    journal.announce(f"Further scenarios, one for each pair of {len(built.scenario.cavity.portals)} ends: {len(pairs)}")
    rows = []
    for first, second in pairs:
        name = f"{first}-to-{second}"
        ends = replace(options.route, entrance=str(first), goal=str(second), routes="longest")
        settings = replace(options, route=ends, name=f"{options.title}-{name}")
        own = Journal(journal.display, journal.announce, list(journal.stages))
        try:
            along = with_route(built, settings, own)
        except MeshError as error:
            journal.warn("route-too-tight", f"There is no scenario from end {first} to end {second}. {error}")
            rows.append((str(first), str(second), "", "", "too tight for the vehicle"))
            continue
        place = folder / ROUTES_DIR / name
        place.mkdir(parents=True)
        write_folder(along, source, settings, own, place)
        numbers, narrowest = along.statistics, along.passability.narrowest
        rows.append((
            str(first), str(second), f"{numbers.route_length:.1f}", f"{narrowest.width:.2f}", f"{ROUTES_DIR}/{name}"
        ))  # fmt: skip
    table = Table("Other routes", ("entrance", "goal", "length (m)", "narrowest (m)", "scenario"), tuple(rows))
    return (Section("Other routes", "A scenario of its own for each further pair of open ends.", (), (table,)),)


def _other_pairs(scenario: Scenario) -> Iterator[tuple[int, int]]:
    """Yield the labels of each two portals but those at both ends of the route."""
    names = dict(zip(end_names(scenario), scenario.cavity.portals, strict=True))
    own = {names[name].label for name in ("entrance", "goal") if name in names}
    for pair in combinations(sorted(portal.label for portal in scenario.cavity.portals), 2):
        if set(pair) != own:
            yield pair
