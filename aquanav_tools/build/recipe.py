"""The build, from input to scenario folder: the main path of aquanav-build-cave."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.build import outputs
from aquanav_tools.build.ahead import compiling_ahead
from aquanav_tools.build.cave_report import DRAWINGS_DIR, cave_model, cave_page, map_of, survey_facts, write_drawings
from aquanav_tools.build.cave_stages import BuiltCave, Closing, build_scenario, scenario_in
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.kept_cave import kept_scenario
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.build.output_folder import WORK_DIR, build_key, check_output, publish
from aquanav_tools.build.photo_evidence import photo_evidence
from aquanav_tools.build.photo_intake import Intake, take_in
from aquanav_tools.build.photo_report import PhotoWork, partial_section, photo_section
from aquanav_tools.build.photo_stages import (
    cameras_inside,
    check_is_cave,
    in_metres,
    preview_surface,
    write_found,
)
from aquanav_tools.build.survey_stages import hold_against, model_walls, survey_evidence
from aquanav_tools.build.water_stage import current_section
from aquanav_tools.cave.closing.evidence import NO_EVIDENCE
from aquanav_tools.cave.scan.read import read_scan
from aquanav_tools.cave.survey.read import read_survey
from aquanav_tools.errors import AquanavError, InputError, MeshError, ReconstructionError, ResourceError
from aquanav_tools.provenance import file_hash
from aquanav_tools.reconstruct.georeference.sources import KnownWorld, read_world
from aquanav_tools.reconstruct.reconstruction import ReconstructOptions, reconstruct
from aquanav_tools.report.html import Figure, Section, write_page
from aquanav_tools.report.picture import draw_cave
from aquanav_tools.report.recording.cave import CaveModel, record_cave
from aquanav_tools.report.viewer_model import transfer_colours, write_glb
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.scenario.shipped import SETTINGS_FILE
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.store import StageStore, check_room, locked, told_when_full
from aquanav_tools.tables import from_table, read_toml
from aquanav_tools.types import Mesh, PointCloud, Stages, silent


@dataclass(frozen=True, eq=False)
class BuildResult:
    """A finished build."""

    scenario: Scenario
    built: BuiltCave
    journal: Journal


def build_cave(
    options: BuildOptions, display: Stages = silent, announce: Callable[[str], None] | None = None
) -> BuildResult:
    """Build a scenario folder from photos, a video, a scan or a survey.

    Nothing is written before the input has been read and found sound. A build that stops later leaves no scenario.toml:
    a report that says why and where, from photos their point cloud and the finished stages too, stay in the folder.

    Args:
        options: input, output and settings.
        display: shows the progress of the stages.
        announce: tells the user what long work will take before it starts.

    Raises:
        AquanavError: with what happened, the likely cause and what to do.
    """
    if not options.input.exists():
        raise InputError(f"There is no file or folder {options.input}. Check the path.")
    load_vehicle(options.vehicle)
    key = build_key(options) if options.kind == "photos" else ""
    check_output(options, key)
    journal = Journal(display) if announce is None else Journal(display, announce)
    build = {"photos": _build_from_photos, "scan": _build_from_scan, "survey": _build_from_survey}[options.kind]
    with told_when_full(options.output):
        return build(options, journal)


def _build_from_scan(options: BuildOptions, journal: Journal) -> BuildResult:
    with journal.stage("Reading the scan"):
        scan = read_scan(options.input, options.scan)
        inputs = {options.input.name: file_hash(options.input)}
    for code, sentence in scan.cautions:
        journal.warn(code, sentence)
    if scan.offset.any():
        journal.warn("moved", f"The scan lay far from the origin and was moved by {(-scan.offset).tolist()} m.")
    facts: dict[str, Any] = {"offset": scan.offset.tolist()}
    survey, evidence = None, NO_EVIDENCE
    if options.survey is not None:
        survey = read_survey(options.survey)
        inputs[options.survey.name] = file_hash(options.survey)
        evidence = survey_evidence(survey, scan.offset)
    try:
        built = build_scenario(scan.surface, options, journal, evidence)
    except MeshError as error:
        options.output.mkdir(parents=True, exist_ok=True)
        _report_failure(error, options, journal, inputs, facts, scan.surface)
        raise
    if survey is not None:
        facts["survey"] = hold_against(survey, built.scenario.cavity.mesh, scan.offset, journal)
    return _finish(built, scan.surface, options, journal, inputs, facts)


def build_made_up(closing: Closing, options: BuildOptions, journal: Journal, inputs: dict[str, str]) -> BuildResult:
    """Build a scenario folder around a made-up cavity, which needs no closing; errors as in `build_cave`."""
    check_output(options, "")
    with told_when_full(options.output):
        try:
            built = scenario_in(closing, options, journal, "synthetic")
        except MeshError as error:
            options.output.mkdir(parents=True, exist_ok=True)
            _report_failure(error, options, journal, inputs, {}, closing.cavity.mesh)
            raise
        return _finish(built, closing.surface.mesh, options, journal, inputs, {})


def _build_from_survey(options: BuildOptions, journal: Journal) -> BuildResult:
    with journal.stage("Reading the survey"):
        survey = read_survey(options.input)
        inputs = {options.input.name: file_hash(options.input)}
    with journal.stage("Modelling the walls"):
        walls = model_walls(survey, journal)
    facts = {"offset": walls.offset.tolist(), **walls.facts}
    try:
        built = build_scenario(walls.surface, options, journal, walls.evidence, walls.measured)
    except MeshError as error:
        options.output.mkdir(parents=True, exist_ok=True)
        _report_failure(error, options, journal, inputs, facts, walls.surface)
        raise
    return _finish(built, walls.surface, options, journal, inputs, facts)


def _build_from_photos(options: BuildOptions, journal: Journal) -> BuildResult:
    settings = _photo_settings(options)
    intake = take_in(options, settings, options.output / WORK_DIR, journal)
    with journal.stage("Reading what is known of the world"):
        # Before the long work: a wrong file must not cost an hour before it is noticed.
        world = read_world(options.scale, intake.photos, options.seed)
        intake.inputs.update({path.name: file_hash(path) for path in options.scale.files})
    with locked(options.output / WORK_DIR), compiling_ahead(len(intake.photos.photos)):
        return _build_cave_of(intake, world, settings, options, journal)


def _build_cave_of(
    intake: Intake, world: KnownWorld, settings: ReconstructOptions, options: BuildOptions, journal: Journal
) -> BuildResult:
    photos, inputs, facts = intake.photos, intake.inputs, intake.facts
    work_dir, work = options.output / WORK_DIR, PhotoWork()
    try:
        work.reconstruction = reconstruction = reconstruct(
            photos, work_dir, settings, world, journal.stage, work.record
        )
        facts |= reconstruction.statistics
        for caution in reconstruction.warnings:
            journal.warn(caution.code, caution.message)
        write_found(reconstruction, options.output)
        with journal.stage("Checking that it is a cave"):
            preview = preview_surface(reconstruction.cloud)
            facts["camera_enclosure"] = check_is_cave(reconstruction, preview)
            is_inside = cameras_inside(reconstruction, preview)
            work.reconstruction = reconstruction = in_metres(reconstruction, preview, options.scale, journal)
            facts |= reconstruction.statistics
            write_found(reconstruction, options.output)
        evidence = photo_evidence(reconstruction, is_inside)
        built = kept_scenario(reconstruction.cloud, options, journal, evidence, StageStore(work_dir))
    except AquanavError as error:
        if isinstance(error, ReconstructionError) and error.unregistered:
            facts["unregistered"] = list(error.unregistered)
        _report_failure(error, options, journal, inputs, facts, work=work)
        raise
    return _finish(built, reconstruction.cloud, options, journal, inputs, facts, work)


def _photo_settings(options: BuildOptions) -> ReconstructOptions:
    """Return the photo stages' settings: those of the quality, with the build's seed, then the recipe file's."""
    table: dict[str, Any] = dataclasses.asdict(ReconstructOptions.at(options.quality))
    for stage in ("matching", "mapping", "depth"):
        table[stage]["seed"] = options.seed
    given = {} if options.recipe is None else read_toml(options.recipe).get("photos", {})
    for stage, settings in given.items():
        table[stage] = {**table.get(stage, {}), **settings} if isinstance(settings, dict) else settings
    return from_table(ReconstructOptions, table, f"{options.recipe or 'recipe'}: photos")


def _finish(
    built: BuiltCave,
    scan: Mesh | PointCloud,
    options: BuildOptions,
    journal: Journal,
    inputs: dict[str, str],
    facts: dict[str, Any],
    work: PhotoWork | None = None,
) -> BuildResult:
    """Write everything into a partial folder first and move it into place, scenario.toml last."""
    folder = options.output
    partial = folder.with_name(folder.name + ".partial")
    shutil.rmtree(partial, ignore_errors=True)
    with journal.stage("Writing the scenario"):
        scenario = write_scenario(built.scenario, partial)
        colours = _colours_of(scan, scenario.cavity.mesh)
        write_glb(scenario.cavity, scenario.collision, partial / "cave.glb", colours)
        model = cave_model(scenario, partial, colours)
        draw_cave(scenario, partial / "cave.png")
        record_cave(CaveModel(scenario), partial / "build.rrd")
    with journal.stage("Drawing the cave"):
        cave = map_of(scenario, built.narrows, [branch.points for branch in scenario.network.branches])
        drawings = write_drawings(cave, scenario, built.statistics.rose, partial / DRAWINGS_DIR)
    sections: list[Section] = []
    if work is not None:
        with journal.stage("Drawing what the photos gave"):
            section, found = photo_section(work, scenario, cave, facts, partial)
            sections, facts = [section], {**facts, **found}
    sections.append(current_section(scenario, cave, partial / DRAWINGS_DIR))
    sections.append(outputs.stage_section(journal, partial / DRAWINGS_DIR))
    figures = (*drawings, Figure(partial / "cave.png", outputs.PICTURE_CAPTION))
    page = cave_page(built, cave, built.narrows, figures, journal, sections, (model,))
    facts = {**facts, **outputs.cave_facts(built), **survey_facts(cave, built.narrows)}
    outputs.write_json(outputs.build_record(options, inputs, journal, facts), partial / "build.json")
    outputs.write_json(
        {"warnings": [{"code": c, "text": t} for c, t in journal.notices], **facts}, partial / "report.json"
    )
    write_page(page, partial / "report.html")
    check_room(partial)  # a recorder that ignores what the disk answers left a torn file
    publish(partial, folder, build_key(options) if options.kind == "photos" else "")
    return BuildResult(dataclasses.replace(scenario, folder=folder.resolve()), built, journal)


def _colours_of(scan: Mesh | PointCloud, mesh: Mesh) -> npt.NDArray[np.uint8] | None:
    """Return the scan's colours at a mesh's vertices; None when it has none."""
    if scan.colours is None:
        return None
    return transfer_colours(mesh, scan.vertices if isinstance(scan, Mesh) else scan.points, scan.colours)


def _report_failure(
    error: AquanavError,
    options: BuildOptions,
    journal: Journal,
    inputs: dict[str, str],
    facts: dict[str, Any],
    surface: Mesh | PointCloud | None = None,
    work: PhotoWork | None = None,
) -> None:
    """Leave in the output folder what is known about a build that stopped."""
    (options.output / SETTINGS_FILE).unlink(missing_ok=True)
    outputs.write_json(outputs.build_record(options, inputs, journal, facts), options.output / "build.json")
    warnings = [{"code": code, "text": text} for code, text in journal.notices]
    outputs.write_json({"error": str(error), "warnings": warnings, **facts}, options.output / "report.json")
    figures: tuple[Figure, ...] = ()
    if isinstance(surface, Mesh):
        figures = outputs.draw_failure(surface, error, options.output / "faults.png")
    sections: tuple[Section, ...] = ()
    if not isinstance(error, ResourceError):  # on a full disk there is no room for drawings
        drawings = options.output / DRAWINGS_DIR
        shutil.rmtree(drawings, ignore_errors=True)
        drawings.mkdir()
        if work is not None:
            sections = (partial_section(work, options.title, facts, drawings),)
        sections = (*sections, outputs.stage_section(journal, drawings))
    write_page(outputs.failure_page(options, error, journal, figures, sections), options.output / "report.html")
    kept = [name for name in ("cloud.ply", "report.html") if (options.output / name).exists()]
    error.args = (f"{error} Kept in {options.output}: {', '.join(kept)}.",)
