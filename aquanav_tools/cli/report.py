"""aquanav report: the report and pictures of a scenario once more, from what its build keeps."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import tyro


@dataclass(frozen=True)
class Report:
    """Draw the report and pictures of a scenario anew: aquanav report caves/mine.

    For scenarios that aquanav-build-cave built, where their input and their folder work are still there: the cave is
    taken from what the build keeps there, and nothing is closed or measured again. Paths in build.json count from the
    folder that the build was started in.
    """

    scenario: tyro.conf.Positional[Path]
    """Scenario folder."""


def run_report(options: Report) -> None:
    """Draw the report and print where it is.

    Raises:
        InputError: there is nothing that it could be drawn from.
    """
    from aquanav_tools.build.redraw import redraw
    from aquanav_tools.cli.command import stage_bar

    redraw(options.scenario, stage_bar, lambda sentence: print(sentence, file=sys.stderr))
    print(f"Report: {options.scenario / 'report.html'}")
