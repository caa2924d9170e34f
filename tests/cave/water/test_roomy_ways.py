"""Where the roomiest ways lead: in a straight tube along its axis, in closed form; in a winding passage, its line."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.cave.water.roomy_ways import BLOCK, NO_NODE, REACH, RoomyWays, roomy_ways
from aquanav_tools.errors import MeshError
from aquanav_tools.types import Array
from tests.caves import TUBE_RADIUS, tube_field
from tests.evaluate.winding import RADIUS, winding_scenario

HULL, GOAL = 0.2, np.array([18.0, 0.0, 0.0])


def node_of(ways: RoomyWays, place: Array) -> int:
    """The sample that a place goes by."""
    cell = np.rint((place - ways.origin) / ways.spacing).astype(int)
    block = ways.blocks[tuple(cell // BLOCK)]
    assert block != NO_NODE
    return int(ways.cells[block, np.ravel_multi_index(tuple(cell % BLOCK), (BLOCK,) * 3)])


def test_in_a_tube_ways_lead_along_the_axis(rng: np.random.Generator) -> None:
    field = tube_field(0.2)
    ways = roomy_ways(field, GOAL, HULL)
    for place in rng.uniform([2.0, -0.1, -0.1], [16.0, 0.1, 0.1], (50, 3)):
        node = node_of(ways, place)
        # A place goes by a sample up to half a diagonal of a cell away, and its way by steps of up to as much.
        assert ways.aims[node, 0] - place[0] == pytest.approx(REACH, abs=2 * field.spacing)
        assert np.abs(ways.aims[node, 1:]).max() < field.spacing
        remaining = ways.beyond[node] + np.linalg.norm(ways.aims[node] - place)
        assert remaining == pytest.approx(GOAL[0] - place[0], abs=2 * field.spacing)
        assert ways.rooms[node] == pytest.approx(TUBE_RADIUS - HULL, abs=field.spacing)
        assert abs(ways.heights[node]) < field.spacing


def test_beside_the_wall_ways_lead_to_the_middle() -> None:
    ways = roomy_ways(tube_field(0.2), GOAL, HULL)
    for side in ([0.0, 1.6, 0.0], [0.0, 0.0, -1.6]):
        node = node_of(ways, np.array([5.0, 0.0, 0.0]) + side)
        assert np.linalg.norm(ways.aims[node, 1:]) < 1.6 - 0.3
        assert ways.aims[node, 0] > 5.0


def test_ways_follow_a_passage_that_winds_and_get_shorter_by_what_they_pass() -> None:
    scenario = winding_scenario()
    goal = np.array(scenario.settings.goal.position)
    ways = roomy_ways(scenario.field, goal, HULL)
    line = scenario.guide.centreline
    at, walked = line[20].copy(), 0.0
    start = ways.beyond[node_of(ways, at)]
    while np.linalg.norm(at - goal) > REACH:
        aim = ways.aims[node_of(ways, at)]
        assert np.linalg.norm(line - aim, axis=1).min() < 0.35 * RADIUS
        walked += np.linalg.norm(aim - at)
        at = aim
        assert walked < 40.0, "it goes in circles"
    assert walked == pytest.approx(start, rel=0.1)
    assert ways.beyond[node_of(ways, goal)] == 0.0


def test_a_hull_that_fits_nowhere_has_no_way() -> None:
    with pytest.raises(MeshError, match="No place in the water is wide enough"):
        roomy_ways(tube_field(0.2), GOAL, TUBE_RADIUS + 0.5)
