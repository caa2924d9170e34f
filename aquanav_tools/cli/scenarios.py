"""aquanav scenarios: what ships, what it is for and how hard it is; building one; cleaning the cache of them."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from aquanav_tools.cli.command import stage_bar

HEADER = "name                split       way    clearance least  median  turns    loops  dead ends  current"


@dataclass(frozen=True)
class Scenarios:
    """Name the shipped scenarios, with splits and difficulty, or build one into the cache folder and say where it lies.

    Wherever a scenario folder is asked for, one of these names will do; what is not built yet is built then (a minute
    or two). The cache is ~/.cache/aquanav, or the folder that AQUANAV_CACHE names. Clearances, from the
    way to the nearest wall, are in halves of the vehicle's width: 1 leaves no room.
    """

    name: Annotated[str | None, tyro.conf.Positional] = None
    """Scenario to build; all are listed when not given."""
    clean: bool = False
    """Remove from the cache what other versions of aquanav built; they build it again when they need it."""


def run_scenarios(options: Scenarios) -> None:
    """List the scenarios, clean the cache, or build a scenario."""
    if options.clean:
        _clean()
    if options.name is not None:
        print(_built(options.name))
    elif not options.clean:
        _list()


def _clean() -> None:
    from aquanav_tools.scenario.shipped import cache_dir, old_versions, remove_version

    folders = old_versions()
    sizes = [_size(folder) for folder in folders]
    are_gone = [remove_version(folder) for folder in folders]
    freed = sum(size for size, is_gone in zip(sizes, are_gone, strict=True) if is_gone)
    print(f"{sum(are_gone)} of {len(folders)} older scenarios removed from {cache_dir()}: {freed / 1e6:.0f} MB.")
    for folder in (folder for folder, is_gone in zip(folders, are_gone, strict=True) if not is_gone):
        print(f"{folder.name} is being built and stays.")


def _size(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def _built(name: str) -> Path:
    from aquanav_tools.build.shipped_scenarios import build_shipped
    from aquanav_tools.compile_ahead import compiling_on_second_core
    from aquanav_tools.scenario.shipped import named_folder, scenario_folder, slot_names

    if name in slot_names():
        return scenario_folder(name)
    with compiling_on_second_core():
        build_shipped(name, stage_bar, announce=lambda sentence: print(sentence, file=sys.stderr))
    return named_folder(name)


def _list() -> None:
    from aquanav_tools.build.shipped_scenarios import difficulty, read_shipped
    from aquanav_tools.scenario.folder import read_scenario
    from aquanav_tools.scenario.shipped import CONTENT, SETTINGS_FILE, cache_dir, named_folder, old_versions, slot_names
    from aquanav_tools.shipped import shipped_names

    print(HEADER)
    for name in shipped_names(CONTENT):
        recipe, folder = read_shipped(name), named_folder(name)
        row = f"{name:<19} {recipe.split:<11}"
        if (folder / SETTINGS_FILE).is_file():
            hard = difficulty(read_scenario(folder))
            row += f"{hard.length:>4.0f} m {hard.least_clearance:>15.1f} {hard.median_clearance:>7.1f} "
            row += f"{hard.curvature:>5.1f}°/m "
            row += f"{hard.num_loops:>7} {hard.num_dead_ends:>10}  {hard.current}"
        else:
            row += f"not built yet: {recipe.title}"
        print(row)
    for name in slot_names():
        state = "filled" if (named_folder(name) / SETTINGS_FILE).is_file() else "empty: for a cave of your own"
        print(f"{name:<19} {'yours':<11}{state}")
    print(f"Cache: {cache_dir()}")
    if old := old_versions():
        taken = sum(map(_size, old)) / 1e6
        print(f"{len(old)} scenarios of other versions take {taken:.0f} MB; aquanav scenarios --clean removes them.")
