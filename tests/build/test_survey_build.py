"""Building from a survey, and from a scan beside a survey of the same cave."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import SURVEY_SUFFIXES, BuildOptions
from aquanav_tools.build.recipe import BuildResult, build_cave
from aquanav_tools.build.survey_stages import hold_against
from aquanav_tools.cave.options import StartOptions
from aquanav_tools.cave.survey import read
from aquanav_tools.cave.survey.read import read_survey
from aquanav_tools.cave.synthetic.caves import tube
from aquanav_tools.errors import InputError
from aquanav_tools.types import silent
from tests.build.pictures import leave_out_pictures

NUM_LEGS = 3


def survey_of_a_tube(path: Path, scale: float = 1.0) -> None:
    """Legs of 2 m along the axis of a tube of 1.2 m radius, with twelve shots to the wall at every station."""
    lines = ["*begin tube", "*fix 0 0 0 0", "*entrance 0", f"*entrance {NUM_LEGS}", "*alias station - .."]
    lines += ["*data cartesian from to easting northing altitude"]
    for station in range(NUM_LEGS):
        lines.append(f"{station} {station + 1} {2.0 * scale} 0 0")
    for station in range(NUM_LEGS + 1):
        for angle in np.arange(12) * np.pi / 6:
            lines.append(f"{station} - 0 {1.2 * scale * np.cos(angle):.4f} {1.2 * scale * np.sin(angle):.4f}")
    path.write_text("\n".join([*lines, "*end tube", ""]))


def options(source: Path, output: Path, survey: Path | None = None) -> BuildOptions:
    return BuildOptions(source, output, survey=survey, starts=StartOptions(count=6))


def test_suffixes_of_surveys_are_those_that_can_be_read() -> None:
    assert set(SURVEY_SUFFIXES) == read.SURVEY_SUFFIXES


def test_a_survey_alone_becomes_a_cave_between_its_entrances(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    leave_out_pictures(monkeypatch)
    survey_of_a_tube(tmp_path / "tube.svx")
    result = build_cave(options(tmp_path / "tube.svx", tmp_path / "cave"))
    cavity = result.scenario.cavity
    assert result.scenario.settings.built.kind == "survey"
    assert len(cavity.portals) == 2
    # The walls are fitted through points on a circle of 1.2 m, on a grid of 0.2 m, between stations 6 m apart.
    assert cavity.volume == pytest.approx(np.pi * 1.2**2 * 2.0 * NUM_LEGS, rel=0.1)
    assert 0.0 < cavity.observed_share < 1.0
    assert {code for code, _ in result.journal.notices} >= {"modelled-wall"}


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scan") / "tube.stl"
    mesh = tube(1.2, 7.0, sections=32, rings=36).mesh.to_trimesh()
    mesh.apply_translation([-0.5, 0.0, 0.0])
    mesh.export(path)
    return path


@pytest.fixture(scope="module")
def fitting(scan: Path) -> BuildResult:
    """The scan built beside a survey of the same tube, into the folder `cave` beside it."""
    survey_of_a_tube(scan.with_name("tube.svx"))
    with pytest.MonkeyPatch.context() as patch:
        leave_out_pictures(patch)
        return build_cave(options(scan, scan.with_name("cave"), scan.with_name("tube.svx")))


def test_a_survey_that_fits_the_scan_says_so(fitting: BuildResult, scan: Path) -> None:
    facts = json.loads((scan.with_name("cave") / "report.json").read_text())["survey"]
    assert facts["median_residual"] < 0.02  # the prism over 32 sides lies up to 1.2 (1 - cos(pi / 32)) = 6 mm inside
    assert facts["blocked_legs"] == []
    assert "survey-differs" not in {code for code, _ in fitting.journal.notices}


def test_a_scan_that_is_too_small_for_its_survey_is_found_out(fitting: BuildResult, tmp_path: Path) -> None:
    survey_of_a_tube(tmp_path / "tube.svx", scale=1.05)
    journal = Journal(silent)
    facts = hold_against(read_survey(tmp_path / "tube.svx"), fitting.scenario.cavity.mesh, np.zeros(3), journal)
    assert "survey-differs" in dict(journal.notices)
    assert facts["suggested_scale"] == pytest.approx(1.05, abs=0.01)


def test_an_unknown_ending_is_answered(scan: Path, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no survey")
    with pytest.raises(InputError, match="surveys end in"):
        build_cave(options(scan, tmp_path / "cave", tmp_path / "notes.txt"))
