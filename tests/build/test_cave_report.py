"""The report and the drawings' folder of a finished build."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from aquanav_tools.build.cave_report import cave_page, heading, map_of, survey_facts, write_drawings
from aquanav_tools.build.cave_tables import end_names
from aquanav_tools.build.journal import Journal
from aquanav_tools.build.options import BuildOptions
from aquanav_tools.build.outputs import draw_failure, failure_page
from aquanav_tools.cave.cavity import Portal
from aquanav_tools.cave.measure.statistics import ScanFit, measure_cave
from aquanav_tools.cave.route.passability import Narrow, Passability, RouteClearance
from aquanav_tools.errors import MeshError
from aquanav_tools.report.faults import MAX_GRAINS, grains
from aquanav_tools.report.html import Page, write_page
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.survey.svx import read_svx
from aquanav_tools.types import PointCloud, silent
from tests.caves import TUBE_RADIUS, tube_scenario

WIDE = Narrow(np.array([2.0, 0.0, 0.0]), 1.0, 1.4, 0.457)
PASSABLE = Narrow(np.array([7.0, 0.0, 0.0]), 6.0, 0.6, 0.457)
TIGHT = Narrow(np.array([12.0, 0.0, 0.0]), 11.0, 0.41, 0.457)
BESIDE = RouteClearance(0.19, 8.0, np.array([9.0, 0.0, 0.0]), 1.2, 0.8, 0.7)
PASSABILITY = Passability(0.457, TIGHT, (PASSABLE, TIGHT), TIGHT.width, BESIDE)
DRAWINGS = {
    "centreline.svx", "views.png", "ends.png",
    *(f"{name}.{kind}" for kind in ("svg", "png")
      for name in ("plan", "long-section", "cross-sections", "elevation", "sizes", "rose")),
}  # fmt: skip


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scenario")


@pytest.fixture(scope="module")
def page(tube: Scenario, folder: Path) -> Page:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("aquanav_tools.report.views.DPI", 40)
        statistics = measure_cave(tube.cavity, tube.field, tube.guide)
        cave = map_of(tube, PASSABILITY.marked)
        figures = write_drawings(cave, tube, statistics.rose, folder / "drawings")
    fit = ScanFit(0.002, 0.02, 0.99)
    built = SimpleNamespace(scenario=tube, statistics=statistics, fit=fit, voxel=0.05, passability=PASSABILITY)
    journal = Journal(silent)
    journal.warn("few-starts", "Only 3 starts.")
    return cave_page(built, cave, figures, journal)  # type: ignore[arg-type]


def table_of(page: Page, title: str) -> list[tuple[str, ...]]:
    (table,) = (table for table in page.tables if table.title.startswith(title))
    return list(table.rows)


def test_every_drawing_is_a_file_and_every_file_has_content(page: Page, folder: Path) -> None:
    files = {path.name: path.stat().st_size for path in (folder / "drawings").iterdir()}
    assert set(files) == DRAWINGS
    assert min(files.values()) > 500
    assert {figure.path.name for figure in page.figures} < DRAWINGS


def test_the_summary_tells_a_caver_whether_the_vehicle_gets_through(page: Page) -> None:
    assert "18.0 m of passage between -2.0 and 2.0 m of height" in page.summary
    assert "does not pass 1 place; the tightest leaves 0.41 m" in page.summary


@pytest.mark.parametrize(
    ("name", "title"),
    [("kiss", "Cave kiss"), ("cave", "Cave"), ("demo-cave", "Demo-cave"), ("Caverna Rossa", "Caverna Rossa")],
)
def test_the_heading_says_cave_once(name: str, title: str) -> None:
    assert heading(name) == title


def test_stations_have_the_tube_radius_on_all_four_sides(page: Page) -> None:
    rows = table_of(page, "Stations")
    assert [row[1] for row in rows] == [f"{along:g}" for along in range(19)]  # 18 m, one every metre
    for row in rows:
        assert [float(value) for value in row[3:7]] == pytest.approx([2.0] * 4, abs=0.006)  # 64 sides, two decimals


def test_narrow_places_have_their_verdict(page: Page) -> None:
    assert [row[:4] for row in table_of(page, "Narrow places (below 0.91 m, 2 times the vehicle's width)")] == [
        ("6.0", "0.600", "0.457", "passes"),
        ("11.0", "0.410", "0.457", "does not pass"),
    ]


def test_ends_have_names_and_the_metres_of_the_route_that_a_cut_takes(page: Page) -> None:
    assert [row[:3] for row in table_of(page, "Open ends")] == [
        ("1", "entrance", "0.0"),
        ("2", "goal", "18.0"),
    ]  # panels at 1 to 19 m


def test_an_end_that_the_route_passes_by_is_a_side_end() -> None:
    tube = tube_scenario()
    side = Portal(3, np.array([10.0, 2.0, 0.0]), np.array([0.0, 1.0, 0.0]), 1.0)
    cavity = dataclasses.replace(tube.cavity, portals=(*tube.cavity.portals, side))
    assert end_names(dataclasses.replace(tube, cavity=cavity)) == ["entrance", "goal", "side end 3"]
    assert end_names(dataclasses.replace(tube, cavity=dataclasses.replace(cavity, portals=()))) == []


def test_statistics_are_those_of_the_tube(page: Page) -> None:
    rows = dict(table_of(page, "Statistics"))  # type: ignore[arg-type]
    assert rows["Length of the route"] == "18.00 m"
    assert rows["Vertical range"] == "4.00 m"
    # A made-up cave: its y is nobody's north.
    assert rows["Main bearing"].startswith("90° or 270° from y, 100%")
    assert "Extent x and y" in rows


def test_the_page_is_one_file_with_all_that(page: Page, folder: Path) -> None:
    write_page(page, folder / "report.html")
    text = (folder / "report.html").read_text()
    assert text.count("data:image/svg+xml") == 6
    assert "few-starts" in text
    assert "http" not in text


def test_the_centreline_is_a_map_of_the_same_length(page: Page, folder: Path) -> None:
    assert page.figures
    line = read_svx(folder / "drawings" / "centreline.svx")
    positions = np.array([station.position for station in line.stations])
    legs = [np.linalg.norm(positions[leg.end] - positions[leg.start]) for leg in line.legs]
    assert sum(legs) == pytest.approx(18.0, abs=0.002)  # 18 legs, each rounded to a tenth of a millimetre
    np.testing.assert_allclose(line.passages[0].lrud, TUBE_RADIUS, atol=0.003)  # 64 sides


def test_every_part_of_the_page_has_the_same_narrowest_place(page: Page) -> None:
    rows = dict(table_of(page, "Statistics"))  # type: ignore[arg-type]
    facts = {fact.label: (fact.value, fact.note) for fact in page.facts}
    assert facts["Largest vehicle"] == ("0.41 m", "wide, held up 11.0 m along the route")
    assert rows["Largest vehicle (largest sphere that gets through)"] == "0.41 m wide, at the narrowest place"
    narrowest = rows["Narrowest place of the route (width of the passage)"]
    assert narrowest == "0.41 m wide, 11.0 m along the route, (12.00, 0.00, 0.00) m"
    # The route runs beside the middle there: not a second narrowest place, and the row says so.
    clearance = rows["Least clearance of the route (to the nearest wall)"]
    assert clearance.startswith("0.19 m, 8.0 m along the route,")
    assert clearance.endswith("where the passage is 1.20 m wide")


def test_a_narrowest_place_that_is_not_narrow_is_marked_but_not_listed() -> None:
    roomy = Passability(0.457, WIDE, (), WIDE.width, BESIDE)
    assert roomy.marked == (WIDE,)
    assert roomy.facts()["narrow_places"] == []
    assert roomy.facts()["narrowest"]["width"] == 1.4


def test_stations_and_narrow_places_can_be_written_as_json(tube: Scenario) -> None:
    facts = json.loads(json.dumps(survey_facts(map_of(tube, (TIGHT,))), allow_nan=False))
    assert len(facts["stations"]) == 19
    assert facts["stations"][3]["left"] == pytest.approx(TUBE_RADIUS, abs=0.003)
    assert json.loads(json.dumps(PASSABILITY.facts(), allow_nan=False))["narrow_places"][1] == {
        "position": [12.0, 0.0, 0.0], "arc_length": 11.0, "width": 0.41, "is_passable": False, "text": str(TIGHT),
    }  # fmt: skip


def test_a_failure_shows_and_lists_the_places_of_its_error(tube: Scenario, tmp_path: Path) -> None:
    error = MeshError("The surface has 1 hole.", [((3.0, 2.0, 0.0), "hole, 0.42 m wide")])
    figures = draw_failure(tube.cavity.mesh, error, tmp_path / "faults.png")
    options = BuildOptions(tmp_path / "scan.stl", tmp_path / "out")
    write_page(failure_page(options, error, Journal(silent), figures), tmp_path / "report.html")
    text = (tmp_path / "report.html").read_text()
    for part in ("The surface has 1 hole.", "3.00, 2.00, 0.00", "hole, 0.42 m wide", "data:image/png"):
        assert part in text


def test_a_failure_without_places_has_no_picture(tube: Scenario, tmp_path: Path) -> None:
    assert draw_failure(tube.cavity.mesh, MeshError("It is flat."), tmp_path / "faults.png") == ()
    assert not (tmp_path / "faults.png").exists()


def test_a_cloud_is_drawn_with_the_places_too(rng: np.random.Generator, tmp_path: Path) -> None:
    cloud = PointCloud(rng.uniform(0.0, 5.0, (2_000, 3)))
    error = MeshError("The points lie on no surface.", [((1.0, 2.0, 3.0), "0.84 times as thick as wide")])
    (figure,) = draw_failure(cloud, error, tmp_path / "faults.png")
    assert figure.path.stat().st_size > 10_000
    drawn = grains(cloud.points)
    middles = drawn.vertices.reshape(-1, 4, 3).mean(axis=1)
    np.testing.assert_allclose(middles, cloud.points, atol=1e-9)
    assert len(grains(np.zeros((200_000, 3))).faces) == 4 * MAX_GRAINS  # of millions of points, some
