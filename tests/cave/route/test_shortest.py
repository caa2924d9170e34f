from __future__ import annotations

import itertools

import numpy as np
import pytest

from aquanav_tools.cave.route.shortest import ShortestPaths, shortest_paths
from aquanav_tools.errors import MeshError
from tests.cave.closed_caves import BRANCH, MAIN, field_of, fork, joined, swept, walk
from tests.caves import tube_field

RADIUS = 0.25


def along(ways: ShortestPaths, line: np.ndarray) -> np.ndarray:
    return np.array([ways.remaining(point) for point in line])


def test_in_a_tube_it_is_the_straight_way(rng: np.random.Generator) -> None:
    goal = np.array([19.0, 0.0, 0.0])
    ways = shortest_paths(tube_field(), goal, RADIUS)
    angle, aside = rng.uniform(0, 2 * np.pi, 200), rng.uniform(0, 1.7, 200)
    places = np.stack([rng.uniform(0.5, 15.0, 200), aside * np.cos(angle), aside * np.sin(angle)], axis=1)
    # within 1 % by the ways, and half a cell of 0.2 m between samples
    np.testing.assert_allclose(along(ways, places), np.linalg.norm(places - goal, axis=1), rtol=0.01, atol=0.1)


def test_around_a_bend_it_is_the_taut_string() -> None:
    line = walk((0, 0, 0), (8, 0, 0), (8, 8, 0), turn=2.0)
    ways = shortest_paths(field_of(swept(line, 1.0)), np.array([8.0, 7.5, 0.0]), RADIUS)
    # The vehicle keeps 0.25 m from the wall: a string around a peg of radius 2 - 1 + 0.25 at (6, 2).
    peg, far = 1.25, np.hypot(5.5, 2.0)
    leg = np.sqrt(far**2 - peg**2)
    around = 3 * np.pi / 2 - 2 * np.arctan2(2.0, 5.5)  # from end to end, seen from the peg's middle
    taut = 2 * leg + peg * (around - 2 * np.arccos(peg / far))
    # samples at 0.15 m: their ways keep up to one more from the peg
    assert taut < ways.remaining(np.array([0.5, 0.0, 0.0])) < 1.02 * taut


def test_a_move_changes_it_by_no_more_than_its_length(rng: np.random.Generator) -> None:
    cave = joined(swept(MAIN, 1.0), swept(BRANCH, 1.0))
    ways = shortest_paths(field_of(cave), np.array([15.5, 0.0, 0.0]), RADIUS)
    for line in (MAIN[5:-5], BRANCH[:-5], MAIN[5:-5] + [0.0, 0.6, 0.0]):
        fine = np.concatenate([np.linspace(a, b, 10, endpoint=False) for a, b in itertools.pairwise(line)])
        steps = np.abs(np.diff(along(ways, fine)))
        lengths = np.linalg.norm(np.diff(fine, axis=0), axis=1)
        assert (steps / lengths).max() < 1.1  # the slope of a trilinear map of lengths that are 1 % off


def test_a_dead_end_beside_the_way_leads_back_to_its_mouth() -> None:
    ways = shortest_paths(field_of(fork()), np.array([15.5, 0.0, 0.0]), RADIUS)
    inwards = along(ways, BRANCH[30:-6])
    assert np.diff(inwards).min() > 0.0  # ever farther, though it runs beside the way to the goal
    assert along(ways, MAIN[140:141])[0] < 2.0 < 15.0 < inwards[-1]


def test_a_map_is_made_once_for_its_goal_and_vehicle() -> None:
    field, goal = tube_field(), np.array([19.0, 0.0, 0.0])
    assert shortest_paths(field, goal, RADIUS) is shortest_paths(field, goal, RADIUS)
    assert shortest_paths(field, goal, RADIUS) is not shortest_paths(field, goal, 0.3)


def test_a_vehicle_wider_than_the_cave_is_refused() -> None:
    with pytest.raises(MeshError, match="No place in the water is wide enough"):
        shortest_paths(tube_field(), np.array([19.0, 0.0, 0.0]), 2.5)
