"""New bays: the same from the same seed, as the settings say, and always with a way for the boat."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
import shapely

from aquanav_tools.errors import InputError, ScenarioError
from aquanav_tools.report.sea_chart import draw_chart
from aquanav_tools.sea.generate import LONGEST_RIDGE, MapSettings, generate_map
from aquanav_tools.sea.sea_map import SeaMap, read_map, rock_solid, write_map

SEEDS = range(60)
SETTINGS = MapSettings()


@pytest.fixture(scope="module")
def bays() -> list[SeaMap]:
    return [generate_map(seed) for seed in SEEDS]


def polygons(sea: SeaMap) -> list[shapely.Polygon]:
    return [shapely.Polygon(rock.outline) for rock in sea.rocks]


def test_a_seed_gives_one_bay_and_another_seed_another(tmp_path: Path, bays: list[SeaMap]) -> None:
    for name, sea in (("first", bays[7]), ("again", generate_map(7)), ("other", bays[8])):
        write_map(sea, tmp_path / name)
    first, again, other = ((tmp_path / name).read_bytes() for name in ("first", "again", "other"))
    assert first == again
    assert first != other


def test_every_way_keeps_the_boats_room_from_every_rock(bays: list[SeaMap]) -> None:
    for sea in bays:
        way = shapely.LineString(sea.paths[0].points)
        rocks = shapely.union_all(polygons(sea))
        bend = SETTINGS.room * (1.0 - np.cos(np.radians(2.5)))  # a chord comes this much nearer than its arc
        assert way.distance(rocks) >= SETTINGS.room - bend - 1e-6
        assert shapely.box(*sea.edge).exterior.distance(way) >= SETTINGS.room - bend - 1e-6


def test_way_leads_from_the_start_into_the_goal(bays: list[SeaMap]) -> None:
    for sea in bays:
        points = sea.paths[0].points
        np.testing.assert_array_equal(points[0], sea.starts[0].position)
        assert np.linalg.norm(points[-1] - sea.goal.centre) == pytest.approx(sea.goal.tolerance)
        assert np.linalg.norm(sea.goal.centre - points[0]) >= SETTINGS.min_path * SETTINGS.length


def test_rocks_cover_the_density_and_at_most_one_rock_more(bays: list[SeaMap]) -> None:
    largest = np.pi * SETTINGS.max_radius**2 / (SETTINGS.length * SETTINGS.width)
    for sea in bays:
        area = sum(polygon.area for polygon in polygons(sea)) / (SETTINGS.length * SETTINGS.width)
        assert sea.density == pytest.approx(area)
        assert SETTINGS.density <= area < SETTINGS.density + largest


def test_rocks_overlap_in_a_ridge_or_keep_the_clearance(bays: list[SeaMap]) -> None:
    for sea in bays:
        shapes = polygons(sea)
        for one, other in combinations(range(len(shapes)), 2):
            if shapes[one].distance(shapes[other]) < SETTINGS.clearance - 1e-6:
                assert other - one < LONGEST_RIDGE  # both are of one ridge, whose rocks follow each other


def test_outlines_are_convex_and_heights_as_asked(bays: list[SeaMap]) -> None:
    tops = np.array([rock.top for sea in bays for rock in sea.rocks])
    for sea in bays:
        for shape in polygons(sea):
            assert shape.area == pytest.approx(shape.convex_hull.area)
    assert tops.min() >= -SETTINGS.reef_depth
    share, count = np.mean(tops < 0.0), len(tops)
    assert abs(share - SETTINGS.reef_share) < 4.0 * np.sqrt(0.3 * 0.7 / count)  # four standard deviations


def test_clearance_is_that_of_another_library(bays: list[SeaMap], rng: np.random.Generator) -> None:
    for sea in bays[:5]:
        rocks, edge = shapely.union_all(polygons(sea)), shapely.box(*sea.edge)
        for place in rng.uniform(sea.edge[:2], sea.edge[2:], (50, 2)):
            point = shapely.Point(place)
            if not rocks.contains(point):
                expected = min(rocks.distance(point), edge.exterior.distance(point))
                assert sea.clearance_at(place) == pytest.approx(expected)
            else:
                assert sea.clearance_at(place) < 0.0


def test_rocks_stand_as_closed_solids_from_the_bed_to_their_top(bays: list[SeaMap]) -> None:
    for rock, shape in zip(bays[0].rocks, polygons(bays[0]), strict=True):
        solid = rock_solid(rock, SETTINGS.depth)
        assert solid.to_trimesh().is_watertight
        assert solid.volume == pytest.approx(shape.area * (rock.top + SETTINGS.depth))


def test_a_map_is_read_as_it_was_written(tmp_path: Path, bays: list[SeaMap]) -> None:
    write_map(bays[3], tmp_path / "bay.json")
    write_map(read_map(tmp_path / "bay.json"), tmp_path / "again.json")
    assert (tmp_path / "bay.json").read_bytes() == (tmp_path / "again.json").read_bytes()


@pytest.mark.parametrize("text", ["", "{}", '{"format": 9}', "[1, 2]"])
def test_what_is_no_map_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bay.json"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=r"bay\.json"):
        read_map(path)


def test_settings_that_leave_no_room_say_what_to_change() -> None:
    with pytest.raises(InputError, match=r"at least boat and margins, 3\.59 m"):
        MapSettings(clearance=3.0)
    with pytest.raises(InputError, match="lower density, a smaller clearance"):
        generate_map(0, MapSettings(density=0.3, clearance=30.0))


def test_a_chart_is_drawn(tmp_path: Path, bays: list[SeaMap]) -> None:
    from PIL import Image

    draw_chart(bays[0], tmp_path / "chart.png", SETTINGS.boat_width)
    with Image.open(tmp_path / "chart.png") as picture:
        assert picture.width > 1000
        assert len(picture.convert("RGB").getcolors(1 << 20)) > 5
