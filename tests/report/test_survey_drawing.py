"""The drawings of a cave survey against caves whose outline is known."""

from __future__ import annotations

import dataclasses
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image

from aquanav_tools.cave.cavity import Cavity, to_manifold
from aquanav_tools.cave.measure.sections import cross_sections
from aquanav_tools.report.cave_map import CaveMap, Mark, lid_rings, signed_area, silhouette
from aquanav_tools.report.figures import WATER, round_length
from aquanav_tools.report.relief import View, plan_and_section
from aquanav_tools.report.section_sheet import draw_rose, draw_sections, draw_sizes
from aquanav_tools.report.survey_drawing import DPI, MARGIN_IN, draw_elevation, draw_long_section, draw_plan, profile
from aquanav_tools.report.survey_overlay import in_profile
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.survey.legs import SurveyLegs
from aquanav_tools.synthetic.caves import bend
from aquanav_tools.types import Mesh
from tests.cave.solids import closed
from tests.caves import TUBE_LENGTH, TUBE_RADIUS

X, Y, Z = np.eye(3)
DRAWINGS = (draw_plan, draw_elevation, draw_long_section, draw_sections, draw_sizes)


def map_of(cavity: Cavity, line: np.ndarray) -> CaveMap:
    middle = line[len(line) // 2]
    marks = (Mark(middle, "0.90 m", 0.9, False), Mark(line[len(line) // 4], "0.35 m", 0.35, True))
    return CaveMap("Test cave", cavity, line, cross_sections(cavity, line, 2.0), marks)


@pytest.fixture(scope="module")
def straight(tube: Scenario) -> CaveMap:
    return map_of(tube.cavity, tube.guide.centreline)


def area_of(rings: tuple[np.ndarray, ...]) -> float:
    return sum(signed_area(ring) for ring in rings)


def pixels_like(path: Path, colour: str) -> np.ndarray:
    wanted = [int(colour[n : n + 2], 16) for n in (1, 3, 5)]
    return np.abs(np.asarray(Image.open(path).convert("RGB")).astype(int) - wanted).max(axis=-1) < 12


def filled_columns(water: np.ndarray) -> np.ndarray:
    """Columns with more water than the pale rim of a letter has."""
    return np.flatnonzero(water.sum(axis=0) > 50)


def test_the_outline_of_a_tube_is_its_rectangle_from_the_side_and_its_polygon_along_it(tube: Scenario) -> None:
    mesh = tube.cavity.mesh
    assert area_of(silhouette(to_manifold(mesh), View(X, Y))) == pytest.approx(TUBE_LENGTH * 2 * TUBE_RADIUS, rel=1e-6)
    polygon = 0.5 * 64 * np.sin(2 * np.pi / 64) * TUBE_RADIUS**2
    assert area_of(silhouette(to_manifold(mesh), View(Y, Z))) == pytest.approx(polygon, rel=1e-6)


def test_the_plan_of_a_bend_is_its_ring_sector() -> None:
    radius, bend_radius, angle = 1.5, 6.0, np.pi / 2
    plan = silhouette(to_manifold(bend(radius, bend_radius, angle, rings=201).truth), View(X, Y))
    # (R + r)^2 - (R - r)^2 over two, times the angle; chords of 200 rings fall short by (angle / 200)^2 / 6 = 1e-5.
    assert area_of(plan) == pytest.approx(2.0 * bend_radius * radius * angle, rel=1e-4)


def test_one_sees_through_the_middle_of_a_ring() -> None:
    solid = trimesh.creation.torus(5.0, 1.0, major_sections=256, minor_sections=64)
    rings = silhouette(to_manifold(Mesh(np.array(solid.vertices), np.array(solid.faces))), View(X, Y))
    assert [signed_area(ring) > 0 for ring in sorted(rings, key=len)].count(False) == 1
    assert area_of(rings) == pytest.approx(np.pi * (6.0**2 - 4.0**2), rel=1e-3)  # 256 sides: 1 - sin(x) / x = 1e-4


def test_a_lid_is_a_line_from_above_and_a_disc_along_the_passage(tube: Scenario) -> None:
    (line,) = lid_rings(tube.cavity, 1, View(X, Y))
    assert np.ptp(line, axis=0) == pytest.approx([0.0, 2 * TUBE_RADIUS], abs=0.01)
    (disc,) = lid_rings(tube.cavity, 1, View(Y, Z))
    assert abs(signed_area(disc)) == pytest.approx(tube.cavity.portals[0].area, rel=0.005)  # a millimetre of rim


def test_the_scale_bar_tells_the_length_of_the_cave(straight: CaveMap, tmp_path: Path) -> None:
    draw_plan(straight, tmp_path / "plan.svg")
    water = pixels_like(tmp_path / "plan.png", WATER)
    cave = np.ptp(filled_columns(water)) + 1
    ink = np.asarray(Image.open(tmp_path / "plan.png").convert("L")) < 180
    rows = ink[-int(0.36 * DPI) : -int(0.27 * DPI)]  # of the bar, which stands 0.28 to 0.35 inches above the edge
    bar = np.flatnonzero(rows.any(axis=0))
    bar = bar[: np.argmax(np.diff(bar) > 1) + 1]  # up to the first gap; the key comes behind it
    assert bar.min() == pytest.approx(MARGIN_IN * DPI, abs=2)
    metres = round_length(11.0 / 8.0 / ((11.0 - 2 * MARGIN_IN) / TUBE_LENGTH))
    assert metres == 2.0
    assert TUBE_LENGTH * np.ptp(bar) / cave == pytest.approx(metres, rel=0.02)  # two pixels of 130


def test_the_long_section_shows_floor_and_ceiling_two_metres_from_the_route(straight: CaveMap, tmp_path: Path) -> None:
    draw_long_section(straight, tmp_path / "long.svg")
    water = pixels_like(tmp_path / "long.png", WATER)
    columns = filled_columns(water)
    rows = np.flatnonzero(water[:, columns[len(columns) // 3]])
    # 18 m of route and 4 m of height on one scale, less the ink of both walls (1.2 points each).
    expected = 4.0 / 18.0 * len(columns)
    assert np.ptp(rows) == pytest.approx(expected, abs=2.0 + 2 * 1.2 * DPI / 72)


@pytest.mark.parametrize("draw", DRAWINGS)
def test_same_drawing_is_the_same_file_without_a_date(straight: CaveMap, tmp_path: Path, draw: object) -> None:
    for name in ("a.svg", "b.svg"):
        draw(straight, tmp_path / name)  # type: ignore[operator]
    assert (tmp_path / "a.svg").read_bytes() == (tmp_path / "b.svg").read_bytes()
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    text = (tmp_path / "a.svg").read_text()
    ElementTree.fromstring(text)
    assert not re.search(r"dc:date|Matplotlib v", text)


@pytest.mark.parametrize("draw", DRAWINGS)
def test_a_cave_without_portals_and_marks_can_be_drawn(tube: Scenario, tmp_path: Path, draw: object) -> None:
    blind = closed(tube.cavity.mesh)
    line = tube.guide.centreline
    draw(CaveMap("Blind", blind, line, cross_sections(blind, line, 5.0)), tmp_path / "a.svg")  # type: ignore[operator]
    assert (tmp_path / "a.png").stat().st_size > 5_000


def test_a_flat_long_section_is_exaggerated_and_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    titles = []
    monkeypatch.setattr("aquanav_tools.report.survey_drawing.save_drawing", lambda figure, *_: titles.append(figure))
    solid = trimesh.creation.box((400.0, 4.0, 2.0))
    cave = closed(Mesh(np.array(solid.vertices), np.array(solid.faces)))
    line = np.linspace([-190.0, 0, 0], [190.0, 0, 0], 381)
    draw_long_section(CaveMap("Flat", cave, line, cross_sections(cave, line, 20.0)), tmp_path / "a.svg")
    # 2 m of 380 m on 9.6 inches are 0.05 inches; 20 times make an inch.
    assert any("heights 20 times exaggerated" in text.get_text() for text in titles[0].texts)


def test_places_beside_the_route_have_the_distance_of_the_nearest_point_on_it(straight: CaveMap) -> None:
    points = np.array([[1.0, 0.0, 0.0], [7.0, 1.5, -0.5], [30.0, 0.0, 0.0]])
    np.testing.assert_allclose(straight.along(points), [0.0, 6.0, 18.0], atol=1e-9)  # the route runs from x = 1 to 19
    assert straight.length == pytest.approx(18.0)


def texts_of(draw: object, cave: CaveMap, path: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """All that is written on a drawing, in its axes too."""
    figures: list[Any] = []
    monkeypatch.setattr("aquanav_tools.report.survey_drawing.save_drawing", lambda figure, *_: figures.append(figure))
    draw(cave, path)  # type: ignore[operator]
    (figure,) = figures
    return [text.get_text() for where in (figure, *figure.axes) for text in where.texts]


def test_a_plan_has_north_up_and_an_arrow_only_where_north_is_known(
    straight: CaveMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = dataclasses.replace(straight, has_north=True)
    texts = texts_of(draw_plan, known, tmp_path / "a.svg", monkeypatch)
    assert "N" in texts and "Plan, seen from above; north up" in texts
    unknown = dataclasses.replace(straight, north_unknown="the photos do not tell north")
    texts = texts_of(draw_plan, unknown, tmp_path / "b.svg", monkeypatch)
    assert "N" not in texts and "Plan, seen from above; y up; the photos do not tell north" in texts


def test_an_elevation_names_a_bearing_only_where_north_is_known(
    straight: CaveMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    known = texts_of(draw_elevation, dataclasses.replace(straight, has_north=True), tmp_path / "a.svg", monkeypatch)
    assert "Projected elevation, looking towards 0°" in known  # the tube runs east
    assert not any("°" in text for text in texts_of(draw_elevation, straight, tmp_path / "b.svg", monkeypatch))


def test_a_passage_to_the_north_runs_up_its_plan(tmp_path: Path) -> None:
    solid = trimesh.creation.box((4.0, 40.0, 4.0))
    cave = closed(Mesh(np.array(solid.vertices), np.array(solid.faces)))
    line = np.linspace([0.0, -19.0, 0], [0.0, 19.0, 0], 381)
    draw_plan(CaveMap("North", cave, line, cross_sections(cave, line, 5.0), has_north=True), tmp_path / "a.svg")
    water = pixels_like(tmp_path / "a.png", WATER)
    columns = filled_columns(water)
    assert np.ptp(np.flatnonzero(water[:, columns[len(columns) // 3]])) > 5 * np.ptp(columns)  # 40 m by 4 m


def survey_of(num_stations: int, aside: float = 0.0) -> SurveyLegs:
    """Stations from end to end of the tube, the first an entrance."""
    along = np.linspace(1.0, TUBE_LENGTH - 1.0, num_stations)
    positions = np.stack([along, np.full_like(along, aside), np.zeros_like(along)], axis=1)
    legs = np.stack([np.arange(num_stations - 1), np.arange(1, num_stations)], axis=1)
    return SurveyLegs(tuple(f"main.{n}" for n in range(num_stations)), positions, legs, along == along[0])


@pytest.mark.parametrize("draw", [draw_plan, draw_long_section])
def test_a_few_survey_stations_are_named_and_of_many_the_names_are_thinned_out(
    draw: object, straight: CaveMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = dataclasses.replace(straight, survey=survey_of(5))
    texts = texts_of(draw, few, tmp_path / "a.svg", monkeypatch)
    assert {f"main.{n}" for n in range(5)} <= set(texts)
    many = texts_of(draw, dataclasses.replace(straight, survey=survey_of(400)), tmp_path / "b.svg", monkeypatch)
    named = [text for text in many if text.startswith("main.")]
    # 18 m of route on 9.6 inches: 40 points are one name per 1.04 m.
    assert 5 <= len(named) <= 18
    assert {"main.0", "main.399"} <= set(named)  # entrance and end of the passage come first


def test_the_long_section_leaves_out_stations_that_are_not_in_its_passage(straight: CaveMap) -> None:
    along, floor, ceiling = profile(straight)[1:]
    beside = survey_of(5, aside=30.0)
    assert in_profile(straight, survey_of(5), along, floor, ceiling).all()
    assert not in_profile(straight, beside, along, floor, ceiling).any()


def test_north_points_to_world_y_on_a_plan_that_runs_south() -> None:
    plan, _ = plan_and_section(np.array([[0.0, 0, 0], [0.0, -30.0, 0]]))
    np.testing.assert_allclose(plan.project(Y), [-1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(plan.project(X), [0.0, 1.0], atol=1e-12)  # seen from above, east is left of south


@pytest.mark.parametrize("bearing", [0, 4, 9])
def test_the_rose_shows_a_passage_both_ways(bearing: int, tmp_path: Path) -> None:
    rose = np.zeros(18)
    rose[bearing] = 12.0
    draw_rose("Test cave", rose, tmp_path / "rose.svg")
    blue = pixels_like(tmp_path / "rose.png", "#1f6f8b")
    rows, columns = np.nonzero(blue)
    height, width = blue.shape
    middle = np.array([(1.0 - 0.06 - 0.355) * height, 0.5 * width])  # of the axes in draw_rose
    offsets = np.stack([columns - middle[1], middle[0] - rows], axis=1)
    bearings = np.degrees(np.arctan2(offsets[:, 0], offsets[:, 1])) % 180.0
    far = np.linalg.norm(offsets, axis=1) > 40
    difference = (bearings[far] - 10.0 * bearing + 90.0) % 180.0 - 90.0
    assert np.abs(difference).max() < 6.0  # a sector of 10 degrees, and a pixel at 40
    assert (offsets[far] @ [np.sin(np.radians(10 * bearing)), np.cos(np.radians(10 * bearing))] > 0).mean() == (
        pytest.approx(0.5, abs=0.1)
    )


@pytest.mark.parametrize(("longest", "length"), [(1.0, 1.0), (4.9, 2.0), (5.0, 5.0), (0.07, 0.05), (730.0, 500.0)])
def test_scale_bars_have_round_lengths(longest: float, length: float) -> None:
    assert round_length(longest) == pytest.approx(length)
