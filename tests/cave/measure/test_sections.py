"""Cross-sections and LRUD against closed forms: tube, bend, helix, box and pillar."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.cave.measure.sections import Section, cross_sections, floor_and_ceiling, station_spacing
from aquanav_tools.synthetic.caves import bend, sweep
from aquanav_tools.types import Mesh
from tests.cave.solids import APOTHEM, SHARE_OF_CIRCLE, SIDES, box_with, closed, helix


def line(*points: tuple[float, float, float]) -> np.ndarray:
    return np.array(points, dtype=float)


def lrud(section: Section) -> tuple[float, float, float, float]:
    return section.left, section.right, section.up, section.down


def test_left_and_right_in_a_box_are_those_of_a_caver_looking_ahead() -> None:
    (section,) = cross_sections(box_with(), line((0, 10, 0), (0, 11, 0)), 5.0)
    # Looking along +y, left is -x: 2 m to that wall, 3 m to the other. Exact up to rounding.
    assert lrud(section) == pytest.approx((2.0, 3.0, 3.0, 1.0), abs=1e-9)
    assert (section.width, section.height, section.area, section.perimeter) == pytest.approx((5.0, 4.0, 20.0, 18.0))


def test_turning_round_swaps_left_and_right() -> None:
    (section,) = cross_sections(box_with(), line((0, 10, 0), (0, 9, 0)), 5.0)
    assert lrud(section) == pytest.approx((3.0, 2.0, 3.0, 1.0), abs=1e-9)


def test_stations_stand_every_so_many_metres_from_the_beginning() -> None:
    sections = cross_sections(box_with(), line((0, 5, 0), (0, 25, 0)), 4.0)
    assert [section.arc_length for section in sections] == pytest.approx([0, 4, 8, 12, 16, 20])
    np.testing.assert_allclose([s.centre for s in sections], [(0, y, 0) for y in (5, 9, 13, 17, 21, 25)], atol=1e-12)


def test_a_pillar_is_a_hole_in_a_level_section_and_the_first_wall_that_is_met() -> None:
    (section,) = cross_sections(box_with((1.5, 10.0, 0.5)), line((0, 10, 0), (0, 10, 1)), 5.0)  # upwards: a shaft
    assert len(section.holes) == 1
    assert section.area == pytest.approx(150.0 - 0.25 * np.pi * SHARE_OF_CIRCLE, rel=1e-6)
    across = sorted(lrud(section))
    assert across == pytest.approx([1.0, 2.0, 10.0, 20.0], abs=1e-9)  # 1 m to the pillar, 3 m to the wall behind it


def test_only_the_ring_around_the_station_counts() -> None:
    two_halves = box_with((0.0, 10.0, 1.0))  # the plane at y = 10 cuts a pillar from floor to ceiling
    (section,) = cross_sections(two_halves, line((2, 10, 0), (2, 10.5, 0)), 5.0)
    assert lrud(section) == pytest.approx((1.0, 1.0, 3.0, 1.0), abs=1e-9)
    assert section.area == pytest.approx(2.0 * 4.0)


def test_a_station_in_the_rock_has_no_section() -> None:
    assert cross_sections(box_with((0.0, 10.0, 1.0)), line((0, 10, 0), (0, 10.5, 0)), 5.0) == ()


@pytest.mark.parametrize("climb", [0.0, 6.0])
def test_sections_of_a_swept_tube_are_its_circle_wherever_it_turns_and_climbs(climb: float) -> None:
    radius = 1.5
    centreline = helix(8.0, climb) if climb else bend(radius, 8.0, np.pi, rings=201).centreline
    cavity = closed(sweep(centreline, radius, SIDES).truth)
    sections = cross_sections(cavity, centreline, 2.0)[1:-1]  # the first and last planes are the lids
    areas = np.array([section.area for section in sections])
    # The wall is made of chords: between two of its rings, up to 8 (1 - cos(angle / 2)) = 0.25 mm inside the tube.
    np.testing.assert_allclose(areas, SHARE_OF_CIRCLE * np.pi * radius**2, rtol=1e-3)
    distances = np.array([lrud(section) for section in sections])
    assert (distances > APOTHEM * radius - 0.005).all()
    assert (distances < radius + 0.005).all()


def test_sections_turn_with_the_cave(rng: np.random.Generator) -> None:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    route = line((0, 5, 0), (1, 15, 0.5), (0, 25, 0))
    still, shift = box_with((1.5, 12.0, 0.4)), np.array([30.0, -7.0, 4.0])
    moved = closed(Mesh(still.mesh.vertices @ turn.T + shift, still.mesh.faces))
    first = cross_sections(still, route, 3.0)
    second = cross_sections(moved, route @ turn.T + shift, 3.0)
    np.testing.assert_allclose([lrud(s) for s in first], [lrud(s) for s in second], atol=1e-9)
    np.testing.assert_allclose([s.area for s in first], [s.area for s in second], rtol=1e-9)


def test_world_outline_lies_on_the_wall_and_in_the_plane() -> None:
    (section,) = cross_sections(box_with(), line((0, 10, 0), (1, 11, 0)), 5.0)
    ring = section.outline_world
    np.testing.assert_allclose((ring - section.centre) @ section.normal, 0.0, atol=1e-12)
    assert ring[:, 0].min() == pytest.approx(-2.0)
    assert ring[:, 0].max() == pytest.approx(3.0)


def test_floor_and_ceiling_are_straight_below_and_above() -> None:
    points = np.array([[0.0, 10.0, 0.0], [2.0, 3.0, 2.5], [50.0, 3.0, 2.5]])
    floor, ceiling = floor_and_ceiling(box_with().mesh, points)
    np.testing.assert_allclose(floor, [-1.0, -1.0, np.nan], atol=1e-6)  # float32 rays
    np.testing.assert_allclose(ceiling, [3.0, 3.0, np.nan], atol=1e-6)


@pytest.mark.parametrize(("length", "spacing"), [(3.0, 0.1), (9.3, 0.5), (29.3, 1.0), (35.0, 1.0), (120.0, 5.0)])
def test_stations_are_a_round_distance_apart_and_fit_a_sheet(length: float, spacing: float) -> None:
    assert station_spacing(length) == pytest.approx(spacing)


def test_spacing_must_be_positive() -> None:
    with pytest.raises(ValueError, match="must be positive, not 0"):
        cross_sections(box_with(), line((0, 5, 0), (0, 25, 0)), 0.0)
