"""The numbers of a cave against closed forms."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from aquanav_tools.cave.cavity import WALL, Cavity
from aquanav_tools.cave.measure.statistics import mean_section, measure_cave, measure_fit, rose_of, wall_area
from aquanav_tools.errors import MeshError
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.synthetic.caves import bend, sweep
from aquanav_tools.types import Mesh
from tests.cave.solids import SHARE_OF_CIRCLE, SIDES, box_with, closed, helix
from tests.caves import TUBE_LENGTH, TUBE_RADIUS

EAST, NORTH = 9, 0


def straight(bearing_deg: float, length: float = 20.0, rise: float = 0.0) -> np.ndarray:
    way = np.array([np.sin(np.radians(bearing_deg)), np.cos(np.radians(bearing_deg)), rise])
    return np.linspace(0.0, length, 101)[:, None] * way


def test_numbers_of_the_tube_are_those_of_its_prism(tube: Scenario) -> None:
    numbers = measure_cave(tube.cavity, tube.field, tube.guide)
    section = SHARE_OF_CIRCLE * np.pi * TUBE_RADIUS**2
    side = 2.0 * TUBE_RADIUS * np.sin(np.pi / SIDES)
    assert numbers.volume == pytest.approx(section * TUBE_LENGTH, rel=1e-9)
    assert numbers.wall_area == pytest.approx(SIDES * side * TUBE_LENGTH, rel=1e-9)
    assert numbers.mean_section == pytest.approx(section, rel=1e-6)
    assert numbers.volume_per_metre == pytest.approx(section * TUBE_LENGTH / 18.0, rel=1e-9)
    assert (numbers.route_length, numbers.total_length) == pytest.approx((18.0, 18.0))
    assert (numbers.extent_east, numbers.extent_north) == pytest.approx((TUBE_LENGTH, 2 * TUBE_RADIUS))
    assert (numbers.lowest, numbers.highest, numbers.vertical_range) == pytest.approx((-2.0, 2.0, 4.0))
    assert (numbers.genus, numbers.num_portals, numbers.num_panels) == (0, 2, 10)


def test_branches_add_to_the_length_but_not_to_the_route(tube: Scenario) -> None:
    side_passage = np.array([[10.0, 0.0, 0.0], [10.0, 3.0, 4.0]])
    numbers = measure_cave(tube.cavity, tube.field, tube.guide, (tube.guide.centreline, side_passage))
    assert (numbers.route_length, numbers.total_length) == pytest.approx((18.0, 23.0))


def test_statistics_can_be_written_as_json(tube: Scenario) -> None:
    numbers = dataclasses.asdict(measure_cave(tube.cavity, tube.field, tube.guide))
    assert json.loads(json.dumps(numbers, allow_nan=False))["rose"][EAST] == pytest.approx(18.0)


def test_volume_area_and_section_of_a_bend_are_those_of_pappus() -> None:
    radius, bend_radius = 1.5, 6.0
    cave = bend(radius, bend_radius, np.pi, SIDES, 201)
    labels = np.full(len(cave.truth.faces), WALL)
    labels[-2 * SIDES :] = 1  # the two fans of lids
    cavity = Cavity(cave.truth, labels, labels == WALL, ())
    # Pappus: volume = section x way of its centroid, area = circumference x the same way. Chords fall short of the arc
    # by (angle per ring)^2 / 24 = 1e-5, of the circle by 1 - SHARE_OF_CIRCLE (volume) and (pi / SIDES)^2 / 6 (area).
    assert cavity.volume == pytest.approx(SHARE_OF_CIRCLE * np.pi * radius**2 * np.pi * bend_radius, rel=2e-4)
    assert wall_area(cavity) == pytest.approx(2.0 * np.pi * radius * np.pi * bend_radius, rel=1e-3)
    assert mean_section(cavity, cave.centreline) == pytest.approx(SHARE_OF_CIRCLE * np.pi * radius**2, rel=2e-3)


def test_volume_and_heights_of_a_helix_are_those_of_its_curve() -> None:
    radius, turn_radius, rise = 1.0, 6.0, 4.0
    cavity = closed(sweep(helix(turn_radius, rise), radius, SIDES).truth)
    length = np.hypot(2.0 * np.pi * turn_radius, rise)
    assert cavity.volume == pytest.approx(SHARE_OF_CIRCLE * np.pi * radius**2 * length, rel=1e-3)
    # The lids' highest points lie on the tube's upright radius, which leans by the climb.
    upright = radius * 2.0 * np.pi * turn_radius / length
    low, high = cavity.mesh.vertices[:, 2].min(), cavity.mesh.vertices[:, 2].max()
    assert (low, high) == pytest.approx((-upright, rise + upright), abs=2e-3)


def test_wall_area_of_a_box_with_a_pillar() -> None:
    whole = 2.0 * (5 * 30 + 5 * 4 + 30 * 4)
    circle, side = 0.25 * np.pi * SHARE_OF_CIRCLE, 2.0 * 0.5 * np.sin(np.pi / SIDES)
    assert wall_area(box_with()) == pytest.approx(whole)
    assert wall_area(box_with((1.0, 9.0, 0.5))) == pytest.approx(whole - 2 * circle + SIDES * side * 4.0)


@pytest.mark.parametrize(("bearing", "sector"), [(0, 0), (180, 0), (90, 9), (270, 9), (44, 4), (46, 5), (174, 17)])
def test_a_straight_passage_is_one_sector_of_the_rose(bearing: float, sector: int) -> None:
    rose = rose_of([straight(bearing)])
    assert rose[sector] == pytest.approx(20.0)
    assert np.delete(rose, sector) == pytest.approx(0.0)


def test_the_rose_weighs_by_horizontal_length() -> None:
    rose = rose_of([straight(0.0, 30.0), straight(90.0, 10.0, rise=1.0)])
    assert (rose[NORTH], rose[EAST], rose.sum()) == pytest.approx((30.0, 10.0, 40.0))


def test_a_shaft_has_no_bearing() -> None:
    assert rose_of([np.linspace([0.0, 0.0, 0.0], [0.0, 0.0, -30.0], 50)]).sum() == 0.0


def test_the_rose_of_a_circle_is_round() -> None:
    rose = rose_of([helix(60.0, 0.0)])
    # 377 legs of 1 m over 18 sectors: 21 each, one more or less.
    np.testing.assert_allclose(rose, 2.0 * np.pi * 60.0 / 18, atol=1.1)


def test_fit_counts_the_distance_of_points_to_the_surface() -> None:
    cavity = box_with()
    points = np.array([[-2.0, 5.0, 0.0], [-2.1, 6.0, 0.0], [3.0, 7.0, 1.0], [0.0, 8.0, 3.3]])
    fit = measure_fit(cavity, points, 0.2, cavity.mesh)
    assert (fit.median, fit.within_voxel) == pytest.approx((0.05, 0.75))


def test_scan_without_a_point_between_its_cuts_is_told_as_such() -> None:
    cavity = box_with()
    whole = Mesh(10.0 * cavity.mesh.vertices, cavity.mesh.faces)  # all of its corners were cut off
    with pytest.raises(MeshError, match=rf"None of the scan's {len(whole.vertices)} points is left between the cuts"):
        measure_fit(cavity, whole.vertices, 0.1, whole)


def test_a_moved_cave_keeps_its_numbers(tube: Scenario) -> None:
    shift = np.array([100.0, -50.0, 7.0])
    moved = Cavity(Mesh(tube.cavity.mesh.vertices + shift, tube.cavity.mesh.faces), tube.cavity.labels,
                   tube.cavity.observed, ())  # fmt: skip
    assert moved.volume == pytest.approx(tube.cavity.volume)
    assert mean_section(moved, tube.guide.centreline + shift) == pytest.approx(
        mean_section(tube.cavity, tube.guide.centreline)
    )
