"""aquanav import-original: the caves of the original benchmark's Unity project, as scenarios."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class ImportOriginal:
    """Build scenarios from the caves of a clone of SafeRLAUV, the original benchmark's Unity project.

    Reads FBX models and DistanceRewarder prefabs; nothing is run. The scenes that placed the caves are lost, so each
    cave is scaled and moved until its middle line passes through the panels that fit it best. A cave whose panels are
    not there is made as wide and long as the others. Score the original's policies in the result:

      aquanav-eval Assets/Models/CurriculumLearning.onnx --scenario out/original/cave-easy
    """

    project: tyro.conf.Positional[Path]
    """Folder of the clone, with the folder Assets in it."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])] = Path("out/original")
    """Folder for a scenario folder per cave, the placed meshes, and original.json, which says how they were placed."""
    cave: tuple[str, ...] = ()
    """Names of the caves to import, as --list has them; all when not given."""
    vehicle: str = "original-auv"
    """Vehicle that must be able to pass; a shipped name or a .toml file."""
    list: bool = False
    """Only say which caves there are and how they are placed."""
    overwrite: bool = False
    """Replace scenarios that are there already."""


def run_import(options: ImportOriginal) -> None:
    """Import the caves and say what to do with them."""
    from aquanav_tools.build.original.import_project import ImportOptions, choose_caves, describe, import_caves

    chosen = ImportOptions(options.project, options.out, options.cave, options.vehicle, options.overwrite)
    caves = choose_caves(chosen)
    if options.list:
        print("\n".join(describe(cave) for cave in caves))
        return
    results = import_caves(caves, chosen, announce=lambda sentence: print(sentence, file=sys.stderr))
    for result in results:
        scenario = result.scenario
        print(
            f"{scenario.folder}: {scenario.guide.length:.1f} m to the goal, {len(scenario.starts)} starts, "
            f"{len(result.journal.notices)} warnings in its report.html"
        )
    print(f"How they were placed: {options.out / 'original.json'}")
    print(f"Next: aquanav-eval POLICY.onnx --scenario {results[0].scenario.folder}")
