"""What a build leaves beside the scenario: pictures, reports, a viewer's model, a recording and the build record."""

from __future__ import annotations

import dataclasses
import json
import platform
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools import __version__
from aquanav_tools.build.cave_stages import BuiltCave
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.build.time_stage import time_facts
from aquanav_tools.build.water_stage import current_facts
from aquanav_tools.errors import MeshError
from aquanav_tools.libraries import installed_version
from aquanav_tools.report.faults import draw_faults, grains
from aquanav_tools.report.html import Figure, Notice, Page, Section, Table
from aquanav_tools.report.stage_bars import draw_stages
from aquanav_tools.store import write_whole
from aquanav_tools.types import Mesh, PointCloud

LIBRARIES = (
    "numpy", "scipy", "numba", "libigl", "pyamg", "trimesh", "manifold3d", "open3d", "pycolmap", "scikit-image"
)  # fmt: skip
FAULTS_FILE = "faults.png"
"""In the folder of a build that stopped: where."""
PICTURE_CAPTION = "The cavity cut open, with the route, its panels, the start poses, entrance and goal."


def build_record(
    options: BuildOptions, inputs: dict[str, str], journal: Journal, facts: dict[str, Any]
) -> dict[str, Any]:
    """Return build.json's table: versions, options, input hashes, cost of every stage."""
    return {
        "aquanav": __version__,
        "python": platform.python_version(),
        "libraries": {name: installed_version(name) for name in LIBRARIES},
        "options": json.loads(json.dumps(dataclasses.asdict(options), default=str)),
        "inputs": inputs,
        "stages": [dataclasses.asdict(stage) for stage in journal.stages],
        "facts": facts,
    }


def cave_facts(built: BuiltCave) -> dict[str, Any]:
    """Return what is known about the cave, as plain values."""
    return {
        "statistics": dataclasses.asdict(built.statistics),
        "fit": dataclasses.asdict(built.fit),
        "voxel": built.voxel,
        "resolution": dataclasses.asdict(built.resolution),
        "closed_by": built.method,
        "left_out_share": built.surface.dropped_share,
        "turned_share": built.surface.turned_share,
        "occlusion": built.occlusion,
        "water": current_facts(built.scenario),
        "time": time_facts(built.scenario),
        "num_starts": len(built.scenario.starts),
        "handles": [
            {"centre": one.centre.tolist(), "length": one.length, "is_pillar": one.is_pillar} for one in built.handles
        ],
        "passability": built.passability.facts(),
        "collision": {
            "triangles": len(built.collision.mesh.faces),
            "triangles_before": built.collision.num_triangles_before,
            "bytes": built.collision.num_bytes,
            "bound": built.collision.bound,
            "max_intrusion": built.collision.max_intrusion,
            "max_invention": built.collision.max_invention,
            "max_loss": built.collision.max_loss,
        },
        "portals": [
            {"label": lid.label, "centre": lid.centre.tolist(), "normal": lid.normal.tolist(), "area": lid.area}
            for lid in built.scenario.cavity.portals
        ],
    }


def failure_page(
    options: BuildOptions,
    error: Exception,
    journal: Journal,
    figures: tuple[Figure, ...] = (),
    sections: tuple[Section, ...] = (),
) -> Page:
    """Return the report of a build that stopped, with what `draw_failure` drew and what is known beside."""
    places = error.places if isinstance(error, MeshError) else ()
    rows = tuple((str(number), _row(np.array(where)), what) for number, (where, what) in enumerate(places, start=1))
    return Page(
        title=f"Build of {options.title} stopped",
        summary=str(error),
        warnings=notices(journal),
        figures=figures,
        tables=((Table("Where", ("number", "position (m)", "what is there"), rows),) if rows else ()),
        sections=sections,
        footer=footer(),
    )


def draw_failure(surface: Mesh | PointCloud, error: Exception, path: Path) -> tuple[Figure, ...]:
    """Draw the places that an error names into a PNG and return its figure; nothing where it names none."""
    places = error.places if isinstance(error, MeshError) else ()
    if not places:
        return ()
    shown, what = (surface, "surface") if isinstance(surface, Mesh) else (grains(surface.points), "points")
    draw_faults(shown, np.array([where for where, _ in places]), [text for _, text in places], path)
    return (Figure(path, f"The {what} and the places that the message is about; they are numbered as in the table."),)


def stage_section(journal: Journal, folder: Path) -> Section:
    """Return what each stage cost, drawn into a folder."""
    stages = journal.stages
    path = folder / "stages.svg"
    draw_stages([s.title for s in stages], [s.seconds for s in stages], [s.peak_memory_mb for s in stages], path)
    caption = "Time and memory of each stage of the build. A stage that was taken up from an earlier run took less."
    return Section("The build", "", (Figure(path, caption),), (stage_table(journal),))


def stage_table(journal: Journal) -> Table:
    """Return what each stage cost."""
    rows = tuple((s.title, f"{s.seconds:.1f}", f"{s.peak_memory_mb:.0f}") for s in journal.stages)
    return Table("Stages", ("stage", "seconds", "peak memory (MB)"), rows)


def write_json(table: dict[str, Any], path: Path) -> None:
    """Write a table for programs, whole or not at all."""
    write_whole(path, json.dumps(table, indent=1, allow_nan=False) + "\n")


def notices(journal: Journal) -> tuple[Notice, ...]:
    """Return what the journal warns of, for a page."""
    return tuple(Notice(code, sentence) for code, sentence in journal.notices)


def _row(vector: np.ndarray) -> str:
    return ", ".join(f"{value:.2f}" for value in vector)


def footer() -> str:
    """Return what made the report, and from what."""
    return f"Built with aquanav {__version__}. Options, versions and hashes of all inputs are in build.json."
