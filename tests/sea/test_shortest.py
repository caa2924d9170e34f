"""The shortest way against closed forms, and against a visibility graph of another library's grown outlines."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from aquanav_tools.sea.generate import MapSettings, generate_map
from aquanav_tools.sea.sea_map import Goal, Outlines, Rock, SeaMap
from aquanav_tools.sea.shortest import shortest_path
from aquanav_tools.types import Array

SQUARE = np.array([[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0]])
NEAR_SEGMENTS = 24
"""Pieces to a quarter turn of the grown outlines; their chords lie within the arcs by 0.05 % of the radius."""


def bay(*outlines: Array, goal: Goal | None = None, half: float = 50.0) -> SeaMap:
    edge = np.array([-half, -half, half, half])
    return SeaMap("bay", edge, 5.0, tuple(Rock(one, 1.0) for one in outlines), goal or Goal(np.zeros((1, 2))), (), ())


def way_between(outlines: Outlines, start: tuple[float, float], goal: Goal, clearance: float) -> float:
    way = shortest_path(outlines, np.array(start), goal, clearance)
    assert way is not None
    drawn = np.linalg.norm(np.diff(way.points, axis=0), axis=1).sum()
    assert drawn <= way.length + 1e-9  # chords are shorter than arcs,
    assert drawn >= way.length * (1.0 - 4e-4)  # by 1 - sin(2.5 deg) / 2.5 deg = 3e-4 at most
    return way.length


@pytest.mark.parametrize("clearance", [1e-3, 1.0, 4.0])
def test_way_past_a_square_is_two_tangents_two_arcs_and_a_side(clearance: float) -> None:
    goal = Goal(np.array([[20.0, 0.0]]))
    apart = np.hypot(18.0, 2.0)  # from an end to the nearest corner
    tangent, turn = np.sqrt(apart**2 - clearance**2), np.arctan2(2.0, 18.0) + np.arcsin(clearance / apart)
    length = way_between(bay(SQUARE).outlines, (-20.0, 0.0), goal, clearance)
    assert length == pytest.approx(2.0 * (tangent + clearance * turn) + 4.0, abs=1e-9)


def test_a_way_without_clearance_is_refused() -> None:
    with pytest.raises(ValueError, match="clearance above"):
        shortest_path(bay(SQUARE).outlines, np.array([-20.0, 0.0]), Goal(np.array([[20.0, 0.0]])), 0.0)


def test_way_past_a_round_rock_is_that_past_a_circle() -> None:
    angles = np.linspace(0.0, 2.0 * np.pi, 361)[:-1]
    circle = 5.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    radius, apart = 5.0 + 1.5, 30.0
    expected = 2.0 * (np.sqrt(apart**2 - radius**2) + radius * np.arcsin(radius / apart))
    found = way_between(bay(circle).outlines, (-apart, 0.0), Goal(np.array([[apart, 0.0]])), 1.5)
    assert found == pytest.approx(expected, rel=1e-5)  # the polygon's sides lie up to 1 - cos(0.5 deg) = 4e-5 inside


def test_tolerance_of_the_goal_shortens_the_way() -> None:
    outlines = bay(SQUARE).outlines
    point = np.array([[20.0, 0.0]])
    whole = way_between(outlines, (-20.0, 0.0), Goal(point), 1.0)
    assert way_between(outlines, (-20.0, 0.0), Goal(point, 5.0), 1.0) == pytest.approx(whole - 5.0)


def test_a_goal_line_is_met_at_a_right_angle_or_at_its_end() -> None:
    line = Goal(np.array([[20.0, -10.0], [20.0, 10.0]]))
    assert way_between(bay().outlines, (-10.0, 3.0), line, 1.0) == pytest.approx(30.0)
    assert way_between(bay().outlines, (-10.0, 16.0), line, 1.0) == pytest.approx(np.hypot(30.0, 6.0))


def test_a_gap_is_passed_down_to_twice_the_clearance_and_no_narrower() -> None:
    wall = np.array([[-1.0, 1.5], [1.0, 1.5], [1.0, 60.0], [-1.0, 60.0]])
    outlines = bay(wall, -wall).outlines
    goal = Goal(np.array([[20.0, 0.0]]))
    assert way_between(outlines, (-20.0, 0.0), goal, 1.499) == pytest.approx(40.0)
    assert shortest_path(outlines, np.array([-20.0, 0.0]), goal, 1.501) is None


def test_way_out_of_a_hollow_rock_goes_round_its_arm() -> None:
    hollow = np.array([[-4, -4], [5, -4], [5, 4], [-4, 4], [-4, 2], [3, 2], [3, -2], [-4, -2]], dtype=np.float64)
    goal = Goal(np.array([[3.0, 5.0]]))
    found = way_between(bay(hollow).outlines, (2.0, 1.0), goal, 1.0)
    west, east = 2.0 + 4.0, 3.0 + 4.0  # lines one metre below and above the arm, which is two metres thick
    assert found == pytest.approx(west + east + np.pi + 2.0)


def visibility_length(sea: SeaMap, start: Array, goal: Array, clearance: float) -> float:
    """Return the shortest way along straight lines between corners of outlines grown by shapely."""
    grown = shapely.union_all([shapely.Polygon(rock.outline).buffer(clearance, NEAR_SEGMENTS) for rock in sea.rocks])
    edge = sea.edge + clearance * np.array([1.0, 1.0, -1.0, -1.0])
    free = shapely.box(*edge).buffer(1e-6).difference(grown.buffer(-1e-6))
    nodes = np.concatenate([[start, goal], shapely.get_coordinates(grown)])
    keep = (nodes[:, 0] >= edge[0]) & (nodes[:, 0] <= edge[2]) & (nodes[:, 1] >= edge[1]) & (nodes[:, 1] <= edge[3])
    nodes = nodes[keep]
    i, j = np.triu_indices(len(nodes), 1)
    lengths = np.linalg.norm(nodes[i] - nodes[j], axis=1)
    shapely.prepare(free)
    seen = shapely.contains(free, shapely.linestrings(np.stack([nodes[i], nodes[j]], axis=1)))
    graph = coo_matrix((lengths[seen], (i[seen], j[seen])), shape=(len(nodes), len(nodes)))
    return float(dijkstra(graph, directed=False, indices=0)[1])


@pytest.mark.parametrize("seed", range(3))
def test_ways_are_as_short_as_those_of_a_visibility_graph(seed: int) -> None:
    sea = generate_map(seed, MapSettings(length=70.0, width=45.0, min_radius=3.0, max_radius=6.0, density=0.15))
    start, goal, way = sea.starts[0].position, sea.goal, sea.paths[0]
    expected = visibility_length(sea, start, goal.centre, way.clearance) - goal.tolerance
    # A chord of the grown outline is inside its arc, the outline's corners on it: ways differ by a thousandth.
    assert way.length == pytest.approx(expected, rel=1e-3)
