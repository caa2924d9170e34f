"""aquanav scenarios: what ships, what it is for and how hard it is; building one by its name."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from aquanav_tools.cli.command import stage_bar

HEADER = "name                split       way    narrowest  usual width  turns    loops  dead ends  current"


@dataclass(frozen=True)
class Scenarios:
    """Name the shipped scenarios, with splits and difficulty, or build one into the cache folder and say where it lies.

    Wherever a scenario folder is asked for, one of these names will do; what is not built yet is built then (a minute
    or two). The cache is ~/.cache/aquanav, or the folder that AQUANAV_CACHE names. Widths are in vehicle widths.
    """

    name: Annotated[str | None, tyro.conf.Positional] = None
    """Scenario to build; all are listed when not given."""


def run_scenarios(options: Scenarios) -> None:
    """List the scenarios, or build one."""
    if options.name is None:
        _list()
    else:
        print(_built(options.name))


def _built(name: str) -> Path:
    from aquanav_tools.build.shipped_scenarios import build_shipped
    from aquanav_tools.scenario.shipped import named_folder, scenario_folder, slot_names

    if name in slot_names():
        return scenario_folder(name)
    build_shipped(name, stage_bar, announce=lambda sentence: print(sentence, file=sys.stderr))
    return named_folder(name)


def _list() -> None:
    from aquanav_tools.build.shipped_scenarios import difficulty, read_shipped
    from aquanav_tools.scenario.folder import read_scenario
    from aquanav_tools.scenario.shipped import CONTENT, SETTINGS_FILE, cache_dir, named_folder, slot_names
    from aquanav_tools.shipped import shipped_names

    print(HEADER)
    for name in shipped_names(CONTENT):
        recipe, folder = read_shipped(name), named_folder(name)
        row = f"{name:<19} {recipe.split:<11}"
        if (folder / SETTINGS_FILE).is_file():
            hard = difficulty(read_scenario(folder))
            row += f"{hard.length:>4.0f} m {hard.tightness:>10.1f} {hard.usual_width:>12.1f} {hard.curvature:>6.1f}/m "
            row += f"{hard.num_loops:>7} {hard.num_dead_ends:>10}  {hard.current}"
        else:
            row += f"not built yet: {recipe.title}"
        print(row)
    for name in slot_names():
        state = "filled" if (named_folder(name) / SETTINGS_FILE).is_file() else "empty: for a cave of your own"
        print(f"{name:<19} {'yours':<11}{state}")
    print(f"Cache: {cache_dir()}")
