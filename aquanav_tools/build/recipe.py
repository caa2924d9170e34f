"""The build, from input to scenario folder: the main path of aquanav-build-cave."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.build import outputs
from aquanav_tools.build.accept_open import accepting
from aquanav_tools.build.ahead import compiling_ahead
from aquanav_tools.build.cave_report import DRAWINGS_DIR
from aquanav_tools.build.cave_stages import BuiltCave, Closing, scenario_in
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.kept_cave import kept_scenario
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.build.other_routes import write_other_routes
from aquanav_tools.build.output_folder import (
    WORK_DIR,
    build_key,
    check_output,
    held_output,
    publish,
    publish_failure,
)
from aquanav_tools.build.photo_free_space import photo_free_space
from aquanav_tools.build.photo_intake import Intake, take_in
from aquanav_tools.build.photo_report import PhotoWork, partial_section
from aquanav_tools.build.photo_stages import check_has_scale, in_metres, look_for_cave, write_found
from aquanav_tools.build.route_cuts import with_planes
from aquanav_tools.build.scenario_folder import Source, write_folder
from aquanav_tools.build.survey_stages import hold_against, model_walls, survey_free_space
from aquanav_tools.cave.closing.free_space import FreeSpace
from aquanav_tools.cave.scan.read import read_scan
from aquanav_tools.errors import AquanavError, InputError, MeshError, ReconstructionError, ResourceError
from aquanav_tools.libraries import check_installed, require
from aquanav_tools.provenance import file_hash
from aquanav_tools.reconstruct.georeference.sources import KnownWorld, read_world
from aquanav_tools.reconstruct.reconstruction import ReconstructOptions, reconstruct
from aquanav_tools.report.html import Figure, Section, write_page
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.vehicle import load_vehicle
from aquanav_tools.store import StageStore, check_room, told_when_full
from aquanav_tools.survey.caves import choose_cave
from aquanav_tools.survey.legs import SurveyLegs, survey_legs
from aquanav_tools.survey.read import read_survey
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

    Nothing is left of a build whose input turns out to be unsound. One that stops later leaves a report that says why
    and where, from photos their point cloud too: in the output folder, or in its folder `failed` where that holds a
    scenario, which then stays as it was.

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
    options = with_planes(options, announce or (lambda sentence: None))
    key = build_key(options) if options.kind == "photos" else ""
    journal = Journal(display) if announce is None else Journal(display, announce)
    build = {"photos": _build_from_photos, "scan": _build_from_scan, "survey": _build_from_survey}[options.kind]
    with _output(options, key) as staged:
        return build(options, journal, staged)


@contextlib.contextmanager
def _output(options: BuildOptions, key: str) -> Iterator[Path]:
    """Yield the folder that a build writes to before it takes the output's place; errors as in `build_cave`."""
    check_output(options, key)
    with told_when_full(options.output), held_output(options.output) as staged:
        check_output(options, key)  # again: another build may have ended meanwhile
        yield staged


def _build_from_scan(options: BuildOptions, journal: Journal, staged: Path) -> BuildResult:
    with journal.stage("Reading the scan"):
        scan = read_scan(options.input, options.scan, options.further)
        inputs = {path.name: file_hash(path) for path in (options.input, *options.further)}
    for code, sentence in scan.cautions:
        journal.warn(code, sentence)
        journal.announce(f"Look ({code}): {sentence}")
    if scan.offset.any():
        journal.warn("moved", f"The scan lay far from the origin and was moved by {(-scan.offset).tolist()} m.")
    facts: dict[str, Any] = {"offset": scan.offset.tolist()}
    if len(scan.stations):
        facts["scanner_stations"] = scan.stations.tolist()
    survey, free_space = None, FreeSpace(scan.stations)
    if options.survey is not None:
        survey = choose_cave(read_survey(options.survey), options.cave)
        inputs[options.survey.name] = file_hash(options.survey)
        free_space = survey_free_space(survey, scan.offset)
        free_space = replace(free_space, inside=np.concatenate([free_space.inside, scan.stations]))
    try:
        built = kept_scenario(scan.surface, options, journal, _store(options), free_space)
    except MeshError as error:
        _report_failure(error, options, journal, inputs, facts, staged, scan.surface)
        raise
    if survey is not None:
        facts["survey"] = hold_against(survey, built.scenario.cavity.mesh, scan.offset, journal)
    # Coordinates far from zero are those of a map, y grid north; those of a survey have compass bearings.
    has_north = survey is not None or bool(scan.offset.any())
    return _finish(built, scan.surface, options, journal, inputs, facts, staged, has_north=has_north)


def build_made_up(closing: Closing, options: BuildOptions, journal: Journal, inputs: dict[str, str]) -> BuildResult:
    """Build a scenario folder around a made-up cavity, which needs no closing; errors as in `build_cave`."""
    with _output(options, "") as staged:
        try:
            built = scenario_in(closing, options, journal, "synthetic")
        except MeshError as error:
            _report_failure(error, options, journal, inputs, {}, staged, closing.cavity.mesh)
            raise
        return _finish(built, closing.surface.mesh, options, journal, inputs, {}, staged)


def _build_from_survey(options: BuildOptions, journal: Journal, staged: Path) -> BuildResult:
    with journal.stage("Reading the survey"):
        survey = choose_cave(read_survey(options.input), options.cave)
        inputs = {options.input.name: file_hash(options.input)}
    with journal.stage("Modelling the walls"):
        walls = model_walls(survey, journal)
    facts = {"offset": walls.offset.tolist(), **walls.facts}
    try:
        built = kept_scenario(walls.surface, options, journal, _store(options), walls.free_space, walls.measured)
    except MeshError as error:
        _report_failure(error, options, journal, inputs, facts, staged, walls.surface)
        raise
    legs = survey_legs(survey, walls.offset)
    return _finish(built, walls.surface, options, journal, inputs, facts, staged, has_north=True, survey=legs)


def _build_from_photos(options: BuildOptions, journal: Journal, staged: Path) -> BuildResult:
    require("A build from photos", "cv2", "pycolmap", "torch")
    check_installed("A build from photos", "open3d")
    settings = _photo_settings(options)
    check_has_scale(options)
    intake = take_in(options, settings, options.output / WORK_DIR, journal)
    with journal.stage("Reading what is known of the world"):
        # Before the long work: a wrong file must not cost an hour before it is noticed.
        world = read_world(options.scale, intake.photos, options.seed)
        intake.inputs.update({path.name: file_hash(path) for path in options.scale.files})
    with compiling_ahead(len(intake.photos.photos)):
        return _build_cave_of(intake, world, settings, options, journal, staged)


def _build_cave_of(
    intake: Intake,
    world: KnownWorld,
    settings: ReconstructOptions,
    options: BuildOptions,
    journal: Journal,
    staged: Path,
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
        write_found(reconstruction, staged)
        with journal.stage("Checking that it is a cave"):
            accept = accepting(options.closing, journal)
            filmed = look_for_cave(reconstruction, accept)
            facts |= {"camera_occlusion": filmed.occlusion, "camera_facing": filmed.facing}
            closing = options.closing
            if filmed.is_half_seen and not closing.accept_open:
                journal.warn(*filmed.caution)
                closing = dataclasses.replace(closing, accept_open=True)
                accept = accepting(closing, journal)
            work.reconstruction = reconstruction = in_metres(
                reconstruction, filmed.preview, options.scale, journal, accept
            )
            facts |= reconstruction.statistics
            write_found(reconstruction, staged)
        free_space = photo_free_space(reconstruction, filmed.is_inside, accept_open=closing.accept_open)
        settings_of_cave = dataclasses.replace(options, closing=closing)
        built = kept_scenario(reconstruction.cloud, settings_of_cave, journal, _store(options), free_space)
    except AquanavError as error:
        if isinstance(error, ReconstructionError) and error.unregistered:
            facts["unregistered"] = list(error.unregistered)
        found = None if work.reconstruction is None else work.reconstruction.cloud
        _report_failure(error, options, journal, inputs, facts, staged, found, work)
        raise
    has_north = options.scale.knows_north
    return _finish(built, reconstruction.cloud, options, journal, inputs, facts, staged, work, has_north)


def _store(options: BuildOptions) -> StageStore:
    """Return where the stages keep what they make."""
    return StageStore(options.output / WORK_DIR)


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
    staged: Path,
    work: PhotoWork | None = None,
    has_north: bool = False,
    survey: SurveyLegs | None = None,
) -> BuildResult:
    """Write everything into a folder aside, and put it in the place of what was there."""
    source = Source(scan, inputs, facts, has_north, survey)
    routes = write_other_routes(built, source, options, journal, staged)
    scenario = write_folder(built, source, options, journal, staged, work, routes)
    check_room(staged)  # a recorder that ignores what the disk answers left a torn file
    publish(staged, options.output, build_key(options) if options.kind == "photos" else "")
    return BuildResult(dataclasses.replace(scenario, folder=options.output.resolve()), built, journal)


def _report_failure(
    error: AquanavError,
    options: BuildOptions,
    journal: Journal,
    inputs: dict[str, str],
    facts: dict[str, Any],
    staged: Path,
    surface: Mesh | PointCloud | None = None,
    work: PhotoWork | None = None,
) -> None:
    """Leave what is known about a build that stopped, and say in the error where."""
    outputs.write_json(outputs.build_record(options, inputs, journal, facts), staged / "build.json")
    warnings = [{"code": code, "text": text} for code, text in journal.notices]
    outputs.write_json({"error": str(error), "warnings": warnings, **facts}, staged / "report.json")
    figures: tuple[Figure, ...] = ()
    if surface is not None:
        figures = outputs.draw_failure(surface, error, staged / outputs.FAULTS_FILE)
    sections: tuple[Section, ...] = ()
    if not isinstance(error, ResourceError):  # on a full disk there is no room for drawings
        drawings = staged / DRAWINGS_DIR
        drawings.mkdir(exist_ok=True)
        if work is not None:
            sections = (partial_section(work, options.title, facts, drawings),)
        sections = (*sections, outputs.stage_section(journal, drawings))
    write_page(outputs.failure_page(options, error, journal, figures, sections), staged / "report.html")
    drawn = [figure.path.name for figure in figures]
    kept = [name for name in ("cloud.ply", "report.html", *drawn) if (staged / name).exists()]
    folder = publish_failure(staged, options.output)
    untouched = "" if folder == options.output else f" The scenario in {options.output} is as it was."
    error.args = (f"{error} Kept in {folder}: {', '.join(kept)}.{untouched}",)
