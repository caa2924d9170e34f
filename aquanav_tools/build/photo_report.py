"""How photos became a cave, for the report: figures, tables and a recording of the growth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.build.cave_report import DRAWINGS_DIR
from aquanav_tools.build.coverage import count_photos
from aquanav_tools.build.photo_tables import photo_tables, unseen_table
from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.cave.measure.unseen import UnseenPatch, unseen_patches
from aquanav_tools.reconstruct.reconstruction import Reconstruction
from aquanav_tools.reconstruct.record import (
    DenseView,
    PhotoRecord,
    SparseRecord,
    read_dense_views,
    read_matches,
    read_sparse,
)
from aquanav_tools.report.cave_map import CaveMap
from aquanav_tools.report.html import Figure, Section, Table
from aquanav_tools.report.photos.camera_map import PhotoTrail, draw_camera_cloud, draw_camera_map
from aquanav_tools.report.photos.coverage_sheet import draw_coverage
from aquanav_tools.report.photos.depth_sheet import DepthExample, draw_depths
from aquanav_tools.report.photos.histograms import Misfits, ModelQuality, ScaleSource, draw_quality
from aquanav_tools.report.photos.matches import draw_matches, groups_of
from aquanav_tools.report.recording.cave import CaveModel
from aquanav_tools.report.recording.growth import Growth, PlacedPhoto, record_growth
from aquanav_tools.report.recording.stream import lack_of_recorder
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import IntArray, Sim3

NUM_PATCHES = 8
"""Unseen places that are shown: a diver plans no more for one dive."""
NUM_EXAMPLES = 4
MAX_COST = 0.5
"""A pixel's depth is trusted up to this matching cost, as by default in fusion."""
RECORDING = "reconstruction.rrd"
TITLE = "The photos"
CAMERAS_CAPTION = (
    "Where the photos were taken. Wedges open along the views; numbers are places in the sequence. Red: where unseen "
    "wall could be photographed from, as in the table below."
)
COVERAGE_CAPTION = (
    "Which wall is in how many photos: the passage cut open, seen from inside. Depth takes at least two photos."
)


@dataclass(eq=False)
class PhotoWork:
    """What a build from photos has to show, as far as it came."""

    record: PhotoRecord = field(default_factory=PhotoRecord)
    reconstruction: Reconstruction | None = None


@dataclass(frozen=True, eq=False)
class Coverage:
    """What of the wall the photos show."""

    counts: IntArray
    """(F,) photos that show each face of the cavity."""
    patches: tuple[UnseenPatch, ...]
    """Unseen wall, the largest NUM_PATCHES."""
    num_patches: int
    """With those that are not listed."""


def photo_section(
    work: PhotoWork, scenario: Scenario, cave: CaveMap, facts: dict[str, Any], output: Path
) -> tuple[Section, dict[str, Any]]:
    """Return the report's section of photos that became a cave, and figures for report.json.

    Args:
        work: complete, in metres.
        scenario: what came of it.
        cave: the same, ready to be drawn.
        facts: what report.json tells about the photos so far.
        output: folder of the scenario; the drawings' folder in it exists.
    """
    reconstruction, folder = work.reconstruction, output / DRAWINGS_DIR
    assert work.record.sparse is not None and reconstruction is not None
    sparse, views, frame = read_sparse(work.record.sparse), read_dense_views(work.record), reconstruction.world_from_sfm
    found = measure_coverage(scenario, views, frame)
    trail = trail_of(work.record, sparse, frame)
    draw_camera_map(cave, trail, found.patches, folder / "cameras.svg")
    draw_coverage(cave, found.counts, found.patches, folder / "coverage.png")
    if not lack_of_recorder():
        record_growth(growth_of(sparse, views, reconstruction), CaveModel(scenario), output / RECORDING)
    figures = (
        Figure(folder / "cameras.svg", CAMERAS_CAPTION),
        Figure(folder / "coverage.png", COVERAGE_CAPTION),
        *_model_figures(work.record, sparse, facts, folder),
        *_depth_figures(views, sparse, frame.scale, folder),
    )
    statistics = coverage_facts(scenario.cavity, found)
    tables = (*_patch_tables(found, cave), *photo_tables(facts))
    return Section(TITLE, _summary(facts, statistics), figures, tables), {"coverage": statistics}


def partial_section(work: PhotoWork, name: str, facts: dict[str, Any], folder: Path) -> Section:
    """Return the section of photos that became no cave, with all that is known about them."""
    figures: tuple[Figure, ...] = ()
    sparse = None if work.record.sparse is None else read_sparse(work.record.sparse)
    if sparse is not None and work.reconstruction is not None:
        trail = trail_of(work.record, sparse, work.reconstruction.world_from_sfm)
        draw_camera_cloud(name, work.reconstruction.cloud, trail, folder / "cameras.svg")
        figures = (Figure(folder / "cameras.svg", "Where the photos were taken, before the points they show."),)
    figures += _model_figures(work.record, sparse, facts, folder)
    if sparse is not None and work.record.dense_dir is not None:
        scale = 1.0 if work.reconstruction is None else work.reconstruction.world_from_sfm.scale
        figures += _depth_figures(read_dense_views(work.record), sparse, scale, folder)
    return Section(TITLE, "", figures, photo_tables(facts))


def measure_coverage(scenario: Scenario, views: Sequence[DenseView], world_from_sfm: Sim3) -> Coverage:
    """Return how often each face of a scenario's cavity was photographed, and what nobody saw."""
    patches = unseen_patches(scenario.cavity, scenario.field)
    counts = count_photos(scenario.cavity, views, world_from_sfm)
    return Coverage(counts, patches[:NUM_PATCHES], len(patches))


def coverage_facts(cavity: Cavity, found: Coverage) -> dict[str, Any]:
    """Return the shares of the wall's area by photos that show it, and the unseen places, ready for JSON."""
    wall = cavity.labels == WALL
    areas = cavity.mesh.areas * wall
    shares = {
        str(least): round(float(areas[found.counts >= least].sum() / areas.sum()), 4) for least in (1, 2, 3, 5, 10)
    }
    places = [
        {
            "centre": patch.centre.tolist(),
            "area": patch.area,
            "outward": patch.outward.tolist(),
            "stand": patch.stand.tolist(),
            "ahead": patch.ahead.tolist(),
            "clearance": patch.clearance,
            "photos": median_photos(found, patch),
        }
        for patch in found.patches
    ]
    return {"share_in_photos": shares, "unseen_patches": found.num_patches, "add_photos": places}


def median_photos(found: Coverage, patch: UnseenPatch) -> int:
    """Return how many photos show the middle face of a patch, by their number."""
    return int(np.median(found.counts[patch.faces]))


def trail_of(record: PhotoRecord, sparse: SparseRecord, world_from_sfm: Sim3) -> PhotoTrail:
    """Return the cameras in the order of the photos, in the world."""
    assert record.photos is not None
    numbers = {name: number for number, name in enumerate(record.photos.names, start=1)}
    placed = np.array([numbers[name] for name in sparse.names])
    order = np.argsort(placed)
    return PhotoTrail(
        tuple(sparse.names[row] for row in order),
        placed[order],
        world_from_sfm.apply(sparse.centres[order]),
        world_from_sfm.turn(sparse.rotations[order, 2]),
        tuple((number, name) for name, number in numbers.items() if name not in set(sparse.names)),
    )


def growth_of(sparse: SparseRecord, views: Sequence[DenseView], reconstruction: Reconstruction) -> Growth:
    """Return the reconstruction as it grew; photos in the order of their ids where theirs is not known."""
    frame, by_name = reconstruction.world_from_sfm, {view.name: view for view in views}
    photos = tuple(
        PlacedPhoto(
            name,
            frame.apply(by_name[name].centre[None])[0],
            by_name[name].rotation @ frame.rotation.T,
            by_name[name].matrix,
            by_name[name].size,
            by_name[name].photo_path,
        )
        for name in sparse.names
    )
    return Growth(photos, frame.apply(sparse.points), sparse.colours, sparse.observations, reconstruction.cloud)


def _model_figures(
    record: PhotoRecord, sparse: SparseRecord | None, facts: dict[str, Any], folder: Path
) -> tuple[Figure, ...]:
    """Return the matrix of matches and the histograms, as far as there is something to draw."""
    figures: tuple[Figure, ...] = ()
    matches = read_matches(record)
    if matches is not None and record.photos is not None:
        names = record.photos.names
        is_placed = np.isin(names, names if sparse is None else sparse.names)  # without a model none is missing in it
        draw_matches(names, matches, is_placed, folder / "matches.png")
        num_groups = int(np.count_nonzero(np.bincount(groups_of(matches)) > 1))
        hang = "All that match hang together." if num_groups == 1 else f"They fall into {num_groups} groups."
        figures += (Figure(folder / "matches.png", f"Who matches whom. {hang}"),)
    if sparse is not None and record.photos is not None:
        numbers = {name: number for number, name in enumerate(record.photos.names, start=1)}
        quality = ModelQuality(
            sparse.point_errors_px, sparse.track_lengths, sparse.angles_deg, sparse.photo_errors_px,
            np.array([numbers[name] for name in sparse.names]),
        )  # fmt: skip
        draw_quality(quality, *scale_sources(facts), folder / "quality.svg")
        caption = "How well cameras and points fit the photos, and what told the scale."
        figures += (Figure(folder / "quality.svg", caption),)
    return figures


def scale_sources(facts: dict[str, Any]) -> tuple[list[ScaleSource], list[Misfits]]:
    """Return what the sources of scale said, relative to the first one, which is the best and always used."""
    listed = [one for one in facts.get("scale_sources", ()) if one["scale"] is not None]
    sources = [
        ScaleSource(one["source"], 100.0 * (one["scale"] / listed[0]["scale"] - 1.0), one["scale_error_percent"],
                    one["used"])
        for one in listed
    ]  # fmt: skip
    misfits = [Misfits(one["source"], np.array(one["misfits_m"])) for one in listed if one.get("misfits_m")]
    return sources, misfits


def _depth_figures(
    views: Sequence[DenseView], sparse: SparseRecord, metres_per_unit: float, folder: Path
) -> tuple[Figure, ...]:
    """Return the examples of depth maps, from evenly over the sequence."""
    measured = [view for view in views if view.depth_path is not None]
    if not measured:
        return ()
    count = min(NUM_EXAMPLES, len(measured))
    chosen = [measured[int((row + 0.5) * len(measured) / count)] for row in range(count)]
    draw_depths([_example(view, metres_per_unit) for view in chosen], folder / "depths.jpg")
    return (Figure(folder / "depths.jpg", f"Depth maps of {count} of the {len(measured)} photos, evenly chosen."),)


def _example(view: DenseView, metres_per_unit: float) -> DepthExample:
    found = view.depth()
    assert found is not None
    confidence = np.clip(1.0 - found.cost, 0.0, 1.0).astype(np.float64)
    return DepthExample(
        view.name,
        view.photo(),
        metres_per_unit * found.depth.astype(np.float64),
        found.normals.astype(np.float64),
        confidence,
        (found.cost <= MAX_COST) & (found.depth > 0.0),
    )


def _patch_tables(found: Coverage, cave: CaveMap) -> tuple[Table, ...]:
    if not found.patches:
        return ()
    photos = [median_photos(found, patch) for patch in found.patches]
    return (unseen_table(found.patches, photos, cave, found.num_patches),)


def _summary(facts: dict[str, Any], coverage: dict[str, Any]) -> str:
    share = coverage["share_in_photos"]
    count = coverage["unseen_patches"]
    need = "No place needs more." if not count else f"{count} places need more." if count > 1 else "1 place needs more."
    return (
        f"{facts['registered']} of {facts['photos']} photos found their place. {share['2']:.0%} of the wall is in two "
        f"photos or more, {1.0 - share['1']:.0%} in none. {need} {RECORDING} shows how the model grew "
        "(written where rerun is installed)."
    )
