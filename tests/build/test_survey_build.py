"""Building from a survey, and from a scan beside a survey of the same cave."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import SURVEY_SUFFIXES, BuildOptions
from aquanav_tools.build.recipe import BuildResult, build_cave
from aquanav_tools.build.survey_stages import hold_against, model_walls
from aquanav_tools.cave.options import StartOptions
from aquanav_tools.errors import InputError
from aquanav_tools.survey import read
from aquanav_tools.survey.read import read_survey
from aquanav_tools.synthetic.caves import tube
from aquanav_tools.types import silent
from tests.lighter import lighten_builds

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
    lighten_builds(monkeypatch)
    survey_of_a_tube(tmp_path / "tube.svx")
    announced: list[str] = []
    result = build_cave(options(tmp_path / "tube.svx", tmp_path / "cave"), announce=announced.append)
    cavity = result.scenario.cavity
    assert result.scenario.settings.built.kind == "survey"
    assert len(cavity.portals) == 2
    # The walls are fitted through points on a circle of 1.2 m, on a grid of 0.2 m, between stations 6 m apart.
    assert cavity.volume == pytest.approx(np.pi * 1.2**2 * 2.0 * NUM_LEGS, rel=0.1)
    assert 0.0 < cavity.observed_share < 1.0
    assert {code for code, _ in result.journal.notices} >= {"modelled-wall"}
    # Nothing was scanned, and no text says so: neither on the terminal nor in the report.
    told = [*announced, *(sentence for _, sentence in result.journal.notices)]
    told.append(
        re.sub(r"<style.*?</style>|base64,[^\"]*", "", (tmp_path / "cave" / "report.html").read_text(), flags=re.S)
    )
    assert not [found for text in told for found in re.findall(r".{,30}\bscan\w*.{,30}", text)]
    report = json.loads((tmp_path / "cave" / "report.json").read_text())
    assert report["has_north"]
    assert {code for code, _ in result.journal.notices}.isdisjoint({"unobserved-wall"})
    # One tube: the largest vehicle, the narrowest place and twice the clearance are all its width, on a grid of 0.2 m.
    assert report["passability"]["largest_vehicle"] == report["passability"]["narrowest"]["width"]
    assert report["passability"]["largest_vehicle"] == pytest.approx(2.4, abs=0.2)
    exported = read_survey(tmp_path / "cave" / "drawings" / "centreline.svx")
    places = [exported.find(f"survey.{station}").position for station in range(NUM_LEGS + 1)]
    np.testing.assert_allclose(places, [[2.0 * station, 0.0, 0.0] for station in range(NUM_LEGS + 1)], atol=1e-4)


def test_a_survey_without_measured_walls_says_that_no_width_is_known(tmp_path: Path) -> None:
    (tmp_path / "bare.svx").write_text("*fix 0 0 0 0\n*entrance 0\n*data cartesian from to dx dy dz\n0 1 6 0 0\n")
    journal = Journal(silent)
    facts = model_walls(read_survey(tmp_path / "bare.svx"), journal).facts
    assert json.loads(json.dumps(facts, allow_nan=False))["median_misfit"] is None
    assert "nothing about the passage's width is known" in dict(journal.notices)["modelled-wall"]


def test_a_file_of_two_caves_is_refused_with_their_names_before_anything_is_written(tmp_path: Path) -> None:
    for name, height in (("upper", 0), ("lower", -50)):
        survey_of_a_tube(tmp_path / f"{name}.svx")
        text = (tmp_path / f"{name}.svx").read_text().replace("tube", name)
        (tmp_path / f"{name}.svx").write_text(text.replace("*fix 0 0 0 0", f"*fix 0 0 0 {height}"))
    (tmp_path / "two.svx").write_text("*include upper\n*include lower\n")
    with pytest.raises(InputError, match=r"holds 2 caves .*upper \(6 m\).*--cave NAME"):
        build_cave(options(tmp_path / "two.svx", tmp_path / "cave"))
    assert not (tmp_path / "cave").exists()


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
        lighten_builds(patch)
        return build_cave(options(scan, scan.with_name("cave"), scan.with_name("tube.svx")))


def test_a_survey_that_fits_the_scan_says_so(fitting: BuildResult, scan: Path) -> None:
    facts = json.loads((scan.with_name("cave") / "report.json").read_text())["survey"]
    assert facts["median_residual"] < 0.02  # the prism over 32 sides lies up to 1.2 (1 - cos(pi / 32)) = 6 mm inside
    assert facts["blocked_legs"] == []
    assert json.loads((scan.with_name("cave") / "report.json").read_text())["has_north"]  # the survey's compass
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
