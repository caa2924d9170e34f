"""Builds with coarse currents, few measurements and no pictures, reports without: for tests of what else they leave.

Drawing takes a third of a small build's time, and nine tenths of an evaluation's of a few episodes.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image

from aquanav_tools.build import cave_report, outputs, scenario_folder, water_stage
from aquanav_tools.cave.closing import collision
from aquanav_tools.cave.water import flow
from aquanav_tools.evaluate import bay_adapter, cave_adapter, comparison_report, reporting, stress_report
from aquanav_tools.report import learning_plot


def lighten_builds(patch: pytest.MonkeyPatch) -> None:
    """Leave out a build's pictures, let its currents be coarse, and measure its collision mesh at fewer places.

    Finding currents in as many cells as a small cave has by default takes a quarter of its time, and measuring at 2 cm
    what is measured at 6 cm so nearly a half of what is left.
    """
    leave_out_pictures(patch)
    patch.setattr(flow, "FEW_CELLS", 20_000)
    patch.setattr(collision, "NUM_PLACES", 20_000)


def leave_out_pictures(patch: pytest.MonkeyPatch) -> None:
    """Let every drawing of a build be an empty picture, and whatever else is drawn be saved as one."""
    names = ("plan", "long_section", "sections", "elevation", "sizes", "rose", "views", "ends")
    drawings = [(cave_report, f"draw_{name}") for name in names]
    for place in (*drawings, (scenario_folder, "draw_cave"), (outputs, "draw_stages"), (water_stage, "draw_flow")):
        patch.setattr(*place, blank)
    patch.setattr("matplotlib.figure.Figure.savefig", blank)


def lighten_reports(patch: pytest.MonkeyPatch) -> None:
    """Let the reports of evaluations, comparisons, searches and trainings hold empty pictures in place of each."""
    for place in (
        (reporting, "plot_outcomes"),
        (reporting, "plot_progress"),
        (reporting, "plot_clearance"),
        (comparison_report, "plot_outcomes"),
        (stress_report, "plot_cases"),
        (bay_adapter, "draw_chart"),
        (learning_plot, "save_figure"),
    ):
        patch.setattr(*place, blank)
    patch.setattr(cave_adapter, "CavePicture", BlankPicture)


class BlankPicture:
    """In place of `report.picture.CavePicture`."""

    is_shared = True

    def __init__(self, *scenario: object) -> None:
        pass

    def draw(self, *arguments: object, **options: object) -> None:
        blank(*arguments)


def blank(*arguments: object, **options: object) -> None:
    """Write an empty picture to the first path among the arguments; of a drawing with a PNG beside it, both."""
    path = next(argument for argument in arguments if isinstance(argument, Path))
    if path.suffix == ".svg":
        path.write_text('<svg xmlns="http://www.w3.org/2000/svg"/>')
        path = path.with_suffix(".png")
    Image.new("RGB", (8, 8)).save(path)
