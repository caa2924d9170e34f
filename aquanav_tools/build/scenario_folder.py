"""All that a build writes into a scenario's folder: the scenario, its report, pictures, model and recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.build import outputs
from aquanav_tools.build.cave_report import DRAWINGS_DIR, cave_model, cave_page, map_of, survey_facts, write_drawings
from aquanav_tools.build.cave_stages import BuiltCave
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.build.photo_report import PhotoWork, photo_section
from aquanav_tools.build.water_stage import current_section
from aquanav_tools.report.html import Figure, Section, write_page
from aquanav_tools.report.picture import draw_cave
from aquanav_tools.report.recording.cave import CaveModel, record_cave
from aquanav_tools.report.recording.stream import NO_RECORDING, lack_of_recorder
from aquanav_tools.report.viewer_model import transfer_colours, write_glb
from aquanav_tools.scenario.folder import write_scenario
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.survey.legs import SurveyLegs
from aquanav_tools.types import Mesh, PointCloud


@dataclass(frozen=True, eq=False)
class Source:
    """What a cave was built from, as its report tells it."""

    scan: Mesh | PointCloud
    inputs: dict[str, str]
    """Hash of each file by its name."""
    facts: dict[str, Any]
    """What is known of it, as plain values."""
    has_north: bool = False
    """Whether y is north."""
    survey: SurveyLegs | None = None
    """What the cave was made from, in the scenario's frame."""

    def colours_of(self, mesh: Mesh) -> npt.NDArray[np.uint8] | None:
        """Return the scan's colours at a mesh's vertices; None when it has none."""
        if self.scan.colours is None:
            return None
        points = self.scan.vertices if isinstance(self.scan, Mesh) else self.scan.points
        return transfer_colours(mesh, points, self.scan.colours)


def write_folder(
    built: BuiltCave,
    source: Source,
    options: BuildOptions,
    journal: Journal,
    folder: Path,
    work: PhotoWork | None = None,
    routes: tuple[Section, ...] = (),
) -> Scenario:
    """Write a scenario with its report into a folder that exists.

    Args:
        built: what to write.
        source: what it was built from.
        options: settings of the stages.
        journal: whose stages and notices the report tells; further stages are added.
        folder: to write to.
        work: of the photo stages, where there were any.
        routes: what the report says of further routes.
    """
    with journal.stage("Writing the scenario"):
        scenario = write_scenario(built.scenario, folder)
        colours = source.colours_of(scenario.cavity.mesh)
        write_glb(scenario.cavity, scenario.collision, folder / "cave.glb", colours)
        model = cave_model(scenario, folder, colours)
        draw_cave(scenario, folder / "cave.png", source.has_north)
        if lack := lack_of_recorder():
            journal.warn(NO_RECORDING, f"There is no build.rrd. {lack}")
        else:
            record_cave(CaveModel(scenario), folder / "build.rrd")
    with journal.stage("Drawing the cave"):
        branches = [branch.points for branch in scenario.network.branches]
        cave = map_of(scenario, built.passability.marked, branches, source.has_north, source.survey)
        drawings = write_drawings(cave, scenario, built.statistics.rose, folder / DRAWINGS_DIR)
    sections, facts = list(routes), source.facts
    if work is not None:
        with journal.stage("Drawing what the photos gave"):
            section, found = photo_section(work, scenario, cave, facts, folder)
            sections, facts = [*sections, section], {**facts, **found}
    sections.append(current_section(scenario, cave, folder / DRAWINGS_DIR))
    sections.append(outputs.stage_section(journal, folder / DRAWINGS_DIR))
    figures = (*drawings, Figure(folder / "cave.png", outputs.PICTURE_CAPTION))
    page = cave_page(built, cave, figures, journal, sections, (model,))
    facts = {**facts, **outputs.cave_facts(built), **survey_facts(cave)}
    outputs.write_json(outputs.build_record(options, source.inputs, journal, facts), folder / "build.json")
    outputs.write_json(
        {"warnings": [{"code": c, "text": t} for c, t in journal.notices], **facts}, folder / "report.json"
    )
    write_page(page, folder / "report.html")
    return scenario
