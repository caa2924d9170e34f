"""What a build leaves beside the scenario: pictures, reports, a viewer's model, a recording and the build record."""

from __future__ import annotations

import dataclasses
import json
import platform
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools import __version__
from aquanav_tools.build.cave_stages import BuiltCave
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.cave.route.narrows import largest_vehicle
from aquanav_tools.errors import MeshError
from aquanav_tools.report.faults import draw_faults
from aquanav_tools.report.html import Figure, Notice, Page, Table
from aquanav_tools.types import Mesh

LIBRARIES = ("numpy", "scipy", "numba", "libigl", "trimesh", "manifold3d", "open3d", "pycolmap", "scikit-image")
PICTURE_CAPTION = "The cavity cut open, with the route, its panels, the start poses, entrance and goal."


def build_record(
    options: BuildOptions, inputs: dict[str, str], journal: Journal, facts: dict[str, Any]
) -> dict[str, Any]:
    """Return build.json's table: versions, options, input hashes, cost of every stage."""
    return {
        "aquanav": __version__,
        "python": platform.python_version(),
        "libraries": {name: version(name) for name in LIBRARIES},
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
        "enclosure": built.enclosure,
        "num_starts": len(built.scenario.starts),
        "handles": [
            {"centre": one.centre.tolist(), "length": one.length, "is_pillar": one.is_pillar} for one in built.handles
        ],
        "narrows": [
            {
                "position": one.position.tolist(),
                "arc_length": one.arc_length,
                "width": one.width,
                "is_passable": one.is_passable,
                "text": str(one),
            }
            for one in built.narrows
        ],
        "largest_vehicle": largest_vehicle(built.narrows),
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


def photo_tables(facts: dict[str, Any]) -> tuple[Table, ...]:
    """Return how the photos fared, from the first look to registration; nothing for a scan."""
    if "registered" not in facts:
        return _preflight_tables(facts)
    plain = {name: value for name, value in facts.items() if not isinstance(value, list | dict)}
    tables = [Table("Photos", ("fact", "value"), tuple((name.replace("_", " "), str(plain[name])) for name in plain))]
    if facts.get("scale_sources"):
        tables.append(scale_table(facts["scale_sources"]))
    if facts["unregistered"]:
        rows = tuple((photo["name"], photo["cause"], photo["sentence"]) for photo in facts["unregistered"])
        tables.append(Table("Photos that did not register", ("photo", "cause", "why"), rows))
    return (*tables, *_preflight_tables(facts))


def _preflight_tables(facts: dict[str, Any]) -> tuple[Table, ...]:
    """Return the photos that were named before the work began, and what the work was expected to take."""
    if "forecast" not in facts:
        return ()
    expected = facts["forecast"]
    rows = [(name, f"{value:.0f} s") for name, value in expected["seconds"].items()]
    rows += [("memory", f"{expected['memory_gb']:.1f} GB"), ("disk", f"{expected['disk_gb']:.1f} GB")]
    tables = [Table(f"Forecast for the photo stages ({expected['cores']} cores)", ("what", "expected"), tuple(rows))]
    named = [(photo["name"], "not used", photo["reason"]) for photo in facts["left_out"]]
    named += [(photo["name"], photo["code"].replace("-", " "), photo["value"]) for photo in facts["preflight"]]
    if named:
        tables.append(Table("Photos with something wrong at first look", ("photo", "what", "evidence"), tuple(named)))
    return tuple(tables)


def scale_table(sources: list[dict[str, Any]]) -> Table:
    """Return what each source of scale and up said alone, as `Georeference.statistics` lists them."""
    rows = tuple(
        (
            one["source"],
            str(one["items"]),
            "-" if one["scale"] is None else f"{one['scale']:.4g} ± {one['scale_error_percent']:.2g} %",
            f"± {one['up_error_deg']:.2g}",
            "-" if one["rms_m"] is None else f"{one['rms_m']:.3f}",
            "yes" if one["used"] else "no: it contradicts a better one",
            ", ".join(one["left_out"][:5]) or "-",
        )
        for one in sources
    )
    columns = ("source", "items", "metres per unit", "up (degrees)", "misfit (m)", "used", "left out")
    return Table("Scale and up, each source alone, with 95 % intervals", columns, rows)


def failure_page(
    options: BuildOptions, error: Exception, journal: Journal, facts: dict[str, Any], figures: tuple[Figure, ...] = ()
) -> Page:
    """Return the report of a build that stopped, with what `draw_failure` drew."""
    places = error.places if isinstance(error, MeshError) else ()
    rows = tuple((str(number), _row(np.array(where)), what) for number, (where, what) in enumerate(places, start=1))
    return Page(
        title=f"Build of {options.output.name} stopped",
        summary=str(error),
        warnings=notices(journal),
        figures=figures,
        tables=(
            *((Table("Where", ("number", "position (m)", "what is there"), rows),) if rows else ()),
            *photo_tables(facts),
            stage_table(journal),
        ),
        footer=footer(),
    )


def draw_failure(surface: Mesh, error: Exception, path: Path) -> tuple[Figure, ...]:
    """Draw the places that an error names into a PNG and return its figure; nothing where it names none."""
    places = error.places if isinstance(error, MeshError) else ()
    if not places:
        return ()
    draw_faults(surface, np.array([where for where, _ in places]), [what for _, what in places], path)
    return (Figure(path, "The surface and the places to repair; they are numbered as in the table."),)


def stage_table(journal: Journal) -> Table:
    """Return what each stage cost."""
    rows = tuple((s.title, f"{s.seconds:.1f}", f"{s.peak_memory_mb:.0f}") for s in journal.stages)
    return Table("Stages", ("stage", "seconds", "peak memory (MB)"), rows)


def write_json(table: dict[str, Any], path: Path) -> None:
    """Write a table for programs."""
    path.write_text(json.dumps(table, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def notices(journal: Journal) -> tuple[Notice, ...]:
    """Return what the journal warns of, for a page."""
    return tuple(Notice(code, sentence) for code, sentence in journal.notices)


def _row(vector: np.ndarray) -> str:
    return ", ".join(f"{value:.2f}" for value in vector)


def footer() -> str:
    """Return what made the report, and from what."""
    return f"Built with aquanav {__version__}. Options, versions and hashes of all inputs are in build.json."
