"""A build as a whole: its options from names and values, and what came out in numbers."""

from __future__ import annotations

import dataclasses
import functools
import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from aquanav_tools.build.options import BuildOptions, read_recipe
from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.scenario.shipped import SETTINGS_FILE
from aquanav_tools.tables import from_table
from aquanav_tools.types import Stages, silent

if TYPE_CHECKING:
    from aquanav_tools.scenario.schema import Scenario

FLAT = ("scan", "scale", "closing", "route", "intake")
"""Groups of settings that go by their own names; those of the others are tables."""


@dataclass(frozen=True)
class BuiltScenario:
    """A scenario folder that is complete."""

    folder: Path
    route_length: float
    """From start to goal, m."""
    volume: float
    """Of the water, m3."""
    num_triangles: int
    num_portals: int
    num_panels: int
    num_starts: int
    passability: str
    """How the vehicle fits through, in a sentence."""
    warnings: tuple[tuple[str, str], ...]
    """Code and sentence of each thing to look at."""
    was_finished: bool
    """Whether there was nothing left to do."""
    routes: tuple[Path, ...] = ()
    """Scenario folders of further routes through the same cave."""

    @functools.cached_property
    def scenario(self) -> Scenario:
        """The scenario, read from its folder."""
        from aquanav_tools.scenario.folder import read_scenario

        return read_scenario(self.folder)


def build_options(given: dict[str, Any], recipe: Path | None) -> BuildOptions:
    """Return the options of a build from names and values; those of a recipe file count where nothing is given.

    Raises:
        InputError: a name is unknown, or a value has the wrong type or makes no sense.
    """
    places = _places()
    table: dict[str, Any] = {}
    if recipe is not None:
        stages = dataclasses.asdict(read_recipe(recipe))
        table = {**stages, "recipe": recipe}
    for name, value in given.items():
        if name not in places:
            raise InputError(f"A build has no setting '{name}'.{did_you_mean(name, places)}")
        group = places[name]
        if group:
            table[group] = {**table.get(group, {}), name: value}
        elif isinstance(value, dict):
            table[name] = {**table.get(name, {}), **value}
        else:
            table[name] = value
    return from_table(BuildOptions, table, "The build")


def _places() -> dict[str, str]:
    """Return the group of settings that each name belongs to; empty for an option of the build itself."""
    fields = {field.name: field for field in dataclasses.fields(BuildOptions)}
    places = {name: "" for name in fields if name not in FLAT}
    for group in FLAT:
        kind: Any = fields[group].default_factory
        places |= {field.name: group for field in dataclasses.fields(kind)}
    return places


def build_scenario(
    options: BuildOptions, display: Stages = silent, announce: Callable[[str], None] | None = None
) -> BuiltScenario:
    """Build a scenario folder where it is not the result of these options already; arguments as in `build_cave`.

    Raises:
        AquanavError: with what happened, the likely cause and what to do.
    """
    from aquanav_tools.build.output_folder import ROUTES_DIR, is_finished

    was_finished = is_finished(options)
    warnings: tuple[tuple[str, str], ...] = ()
    if not was_finished:
        from aquanav_tools.build.recipe import build_cave

        warnings = tuple(build_cave(options, display, announce).journal.notices)
    report = json.loads((options.output / "report.json").read_text(encoding="utf-8"))
    numbers = {name: report["statistics"][name] for name in ("route_length", "volume", "num_triangles", "num_portals")}
    return BuiltScenario(
        folder=options.output,
        **numbers,
        num_panels=report["statistics"]["num_panels"],
        num_starts=report["num_starts"],
        passability=report["passability"]["text"],
        warnings=warnings,
        was_finished=was_finished,
        routes=tuple(sorted(path.parent for path in (options.output / ROUTES_DIR).glob(f"*/{SETTINGS_FILE}"))),
    )
