"""Ways by walls that are known, and beside another library's shortest ways."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from aquanav_tools.sim import occupancy, way
from aquanav_tools.sim.occupancy import ASTERN, CELL, ENDED, GUESSED, HIGHEST, LOWEST, PASSED, VISITED
from aquanav_tools.sim.way import (
    BESIDE,
    CLOSE_COST,
    FREE_COST,
    GREED,
    GUESSED_COST,
    LOOKED_ALONG,
    ROOM,
    UNKNOWN_COST,
    WALL_COST,
)
from tests.sim.maps import REACH, empty, found_way, known, look, pocket


def test_where_nothing_is_known_the_way_is_straight() -> None:
    goal = np.array([6.0, 0.0, 0.0])
    maps = empty(goal)
    cells = found_way(maps, np.zeros(3), goal)
    assert maps.lengths[0, 1] * CELL == pytest.approx(6.0, abs=CELL)
    assert np.abs(cells[:, 1:]).max() < CELL
    np.testing.assert_allclose(cells[-1], goal, atol=CELL)


def test_the_way_leads_back_out_of_a_dead_end() -> None:
    goal = np.array([9.0, 0.0, 0.0])
    cells = found_way(pocket(goal), np.array([2.4, 0.0, 0.0]), goal)
    inside = (np.abs(cells[:, 1]) < 1.0) & (np.abs(cells[:, 2]) < 1.6) & (cells[:, 0] < 2.8)
    assert cells[inside, 0].min() < -2.8  # it leaves by the open end
    assert (np.diff(inside.astype(int)) > 0).sum() == 0
    assert len(cells) * CELL > 2.4 + 3.0 + 9.0  # and goes around


def test_the_farthest_place_in_sight_lies_before_a_bend() -> None:
    goal = np.array([9.0, 0.0, 0.0])
    maps, place = pocket(goal), np.array([2.25, 0.0, 0.0])
    found_way(maps, place, goal)
    here, ahead, unknown = way.look_along(maps, 0, place)
    assert here == 0 and ahead > way.LEAST_AHEAD
    assert way.middle(maps, 0, ahead)[0] < 2.4 - 2.0  # astern, out of the pocket
    assert unknown == 0.0
    assert way._is_clear(maps, 0, place, way.middle(maps, 0, ahead))


def test_a_wall_in_sight_is_no_clear_line_and_open_water_is_one() -> None:
    maps = pocket(np.array([9.0, 0.0, 0.0]))
    assert way._is_clear(maps, 0, np.zeros(3), np.array([2.0, 0.0, 0.0]))
    assert not way._is_clear(maps, 0, np.zeros(3), np.array([4.0, 0.0, 0.0]))


def test_a_way_costs_at_most_so_much_more_than_another_librarys_cheapest(rng: np.random.Generator) -> None:
    graph = pytest.importorskip("skimage.graph", reason="scikit-image comes with the extra build")
    shape = np.array([14, 11, 9])
    for _ in range(30):
        more = rng.choice(np.array([0, PASSED, ENDED, GUESSED]), size=shape, p=[0.3, 0.35, 0.3, 0.05])
        maps = empty(np.full(3, 200.0), np.full(3, -40.0))  # its goal and its start, which are known, lie elsewhere
        corner = np.array(occupancy.cell_of(maps, 0, np.zeros(3)))
        for cell in np.ndindex(*shape):
            occupancy._add(maps, 0, *(corner + cell), more[cell])
        around = np.pad(more, 40)  # ways lead around it, too
        steps = np.full(around.shape, ROOM + 1)  # to the nearest wall across a face
        for reach in range(ROOM, 0, -1):
            cells = np.abs(np.mgrid[(slice(-reach, reach + 1),) * 3])
            steps[ndimage.binary_dilation(around > 0, (cells > 0).sum(axis=0) <= 1)] = reach
        unknown = np.where(steps <= BESIDE, GUESSED_COST, UNKNOWN_COST)
        water = FREE_COST + CLOSE_COST * (ROOM + 1 - steps)
        walls = np.where(around < ENDED, GUESSED_COST, WALL_COST)
        around = np.where(around == 0, unknown, np.where(around > 0, walls, water))
        start, goal = (np.array([rng.integers(size) for size in shape]) for _ in range(2))
        if around[tuple(goal + 40)] == WALL_COST:
            continue  # all cells are cheaper: see below
        cells = found_way(maps, (start + 0.5) * CELL, (goal + 0.5) * CELL)
        assert len(cells) == maps.lengths[0, 1] + 1  # all of it was kept
        steps = np.floor(cells / CELL).astype(int)
        assert (steps[0] == start).all() and (steps[-1] == goal).all()
        assert (np.abs(np.diff(steps, axis=0)).sum(axis=1) == 1).all()
        least = graph.MCP(around, fully_connected=False).find_costs([tuple((start + 40).tolist())])[0][tuple(goal + 40)]
        own = around[tuple((steps[1:] + 40).T)].sum() + around[tuple(start + 40)]  # there the first cell counts as well
        assert least * (1.0 - 1e-5) <= own <= GREED / FREE_COST * least * (1.0 + 1e-5)


def test_the_way_leads_out_of_a_chamber_of_a_hundred_thousand_cells() -> None:
    """A closed cube of 10 m, whose one hole is on the side that looks away from the goal."""
    goal, num = np.array([30.0, 0.0, 0.0]), 50
    maps = empty(goal)
    corner = np.array(occupancy.cell_of(maps, 0, np.zeros(3))) - num // 2
    for cell in np.ndindex(num, num, num):
        is_wall = min(cell) == 0 or max(cell) == num - 1
        is_hole = cell[0] == 0 and max(abs(c - num // 2) for c in cell[1:]) < 3
        occupancy._add(maps, 0, *(corner + cell), ENDED if is_wall and not is_hole else PASSED)
    found_way(maps, np.array([4.0, 0.0, 0.0]), goal)
    around = 4.0 + 5.0 + 2 * 5.0 + 5.0 + 30.0  # to the hole, to an edge and back, and past the cube to the goal
    assert around - 1.0 < maps.lengths[0, 1] * CELL < GREED / FREE_COST * around


def test_the_way_does_not_lead_back_past_where_the_dive_began() -> None:
    """A tunnel, 2 m wide, known for 3 m to both sides; the goal lies behind its wall, once ahead and once astern."""
    goal = np.array([-2.0, 12.0, 0.1])
    for heading, side in ((0.0, 1.0), (np.pi, -1.0)):
        maps = empty(goal, np.array([0.0, 0.1, 0.1]), heading)
        for x in np.arange(-3.0, 3.01, 0.5 * CELL):
            for y in np.arange(-1.2, 1.21, 0.5 * CELL):
                for z in np.arange(-1.2, 1.21, 0.5 * CELL):
                    is_wall = max(abs(y), abs(z)) > 1.0
                    cell = occupancy.cell_of(maps, 0, np.array([x, y, z]))
                    if is_wall or occupancy.evidence(maps, 0, *cell) <= 0:
                        occupancy._add(maps, 0, *cell, HIGHEST - LOWEST if is_wall else PASSED)
        cells = found_way(maps, np.array([0.0, 0.1, 0.1]), goal)
        inside = np.abs(cells[:, 1]) < 1.0
        assert (side * cells[inside, 0]).min() > -0.2 and (side * cells[inside, 0]).max() > 2.8


def test_who_swims_back_past_the_start_finds_the_way_open() -> None:
    goal = np.array([12.0, 0.1, 0.1])
    maps = empty(goal, np.array([0.0, 0.1, 0.1]), 0.0)
    for x in np.arange(-0.1, -2.0, -0.2):  # 2 m/s, astern
        assert (maps.blocks == ASTERN).any() == (x > -1.0)
        occupancy.be_at(maps, 0, np.array([x, 0.1, 0.1]))
    cells = found_way(maps, np.array([-1.9, 0.1, 0.1]), goal)
    assert np.abs(cells[:, 1:] - 0.1).max() < CELL
    assert known(maps, np.array([-0.3, 0.1, 0.1])) == VISITED


def test_the_way_leads_through_the_middle_of_a_passage() -> None:
    """From beside the wall at its closed end to beyond its open one."""
    goal = np.array([-4.5, 0.9, 0.1])
    cells = found_way(pocket(goal), np.array([2.7, 0.9, 0.1]), goal)
    assert np.abs(cells[np.abs(cells[:, 0]) < 1.5, 1]).max() < 0.4


def test_beside_a_wall_what_is_unknown_is_taken_for_wall_where_there_is_another_way() -> None:
    """A wall, 3 m wide and 1.2 m thick, with a hole of one cell of which nothing is known."""
    goal, start = np.array([6.1, 0.1, 0.1]), np.array([0.1, 0.1, 0.1])
    maps = empty(goal)
    hole = np.array(occupancy.cell_of(maps, 0, np.array([2.5, 0.1, 0.1])))
    for cell in np.ndindex(6, 15, 15):
        if cell[1:] != (7, 7):
            occupancy._add(maps, 0, *(hole + cell - [0, 7, 7]), ENDED)
    cells = found_way(maps, start, goal)
    assert np.abs(cells[np.abs(cells[:, 0] - 3.1) < 0.05, 1:]).max() > 1.4
    for _ in range(2):
        look(maps, np.array([1.1, 0.1, 0.1]), np.array([[1.0, 0.0, 0.0]]), np.array([REACH]))
    maps.lengths[0] = 0
    assert len(found_way(maps, start, goal)) == 31  # by the hole, which a ray went through


def test_one_room_for_searches_serves_many() -> None:
    goals = (np.array([9.0, 0.0, 0.0]), np.array([-7.0, 4.0, 1.0]), np.array([9.0, 0.0, 0.0]))
    search = way.make_search()
    for goal in goals:
        maps, fresh = pocket(goal), pocket(goal)
        way.plan(maps, search, 0, np.array([2.4, 0.0, 0.0]), goal)
        found_way(fresh, np.array([2.4, 0.0, 0.0]), goal)
        assert (maps.ways == fresh.ways).all() and (maps.lengths == fresh.lengths).all()
        assert not search.numbers.any()


def test_a_way_is_kept_until_a_wall_is_met_on_it() -> None:
    """The pocket gets a second hole when the way out has been found."""
    goal, place = np.array([9.0, 0.0, 0.0]), np.array([2.4, 0.0, 0.0])
    maps = pocket(goal)
    out = found_way(maps, place, goal)
    for x in (2.9, 3.1):
        occupancy._visit(maps, 0, *occupancy.cell_of(maps, 0, np.array([x, 0.1, 0.1])))
    assert way.holds(maps, 0, place)
    np.testing.assert_array_equal(found_way(maps, place, goal), out)
    occupancy._add(maps, 0, *maps.ways[0, 40], ENDED + HIGHEST)
    assert not way.holds(maps, 0, place)
    assert len(found_way(maps, place, goal)) < len(out)  # by the hole


def test_a_way_is_left_by_who_has_strayed_from_it_or_comes_to_the_end_of_what_was_kept() -> None:
    goal = np.array([40.0, 0.0, 0.0])
    maps = empty(goal)
    cells = found_way(maps, np.zeros(3), goal)
    assert len(cells) == occupancy.MOST_AHEAD < maps.lengths[0, 1]
    assert way.holds(maps, 0, cells[50] + [0.0, 0.9 * way.STRAYED, 0.0])
    assert not way.holds(maps, 0, cells[50] + [0.0, 1.1 * way.STRAYED, 0.0])
    assert not way.holds(maps, 0, cells[-LOOKED_ALONG])
    near = found_way(maps, np.array([35.0, 0.0, 0.0]), goal)
    assert way.holds(maps, 0, near[-2])  # it ends at the goal


def test_a_search_that_may_go_no_further_ends_nearest_to_the_goal() -> None:
    """Around the goal stands a closed box of walls, so that all cells outside of it come first."""
    goal = np.array([30.0, 0.0, 0.0])
    maps = empty(goal)
    centre = np.array(occupancy.cell_of(maps, 0, goal))
    for cell in np.ndindex(13, 13, 13):
        if max(abs(c - 6) for c in cell) == 6:
            occupancy._add(maps, 0, *(centre + np.array(cell) - 6), ENDED)
    way.plan(maps, way.make_search(), 0, np.zeros(3), goal)
    assert maps.lengths[0, 0] == occupancy.MOST_AHEAD
    assert maps.lengths[0, 1] * CELL == pytest.approx(30.0, abs=4.0)


def test_from_outside_of_the_map_there_is_no_way() -> None:
    goal = np.array([9.0, 0.0, 0.0])
    maps = empty(goal)
    assert len(found_way(maps, np.array([0.0, 200.0, 0.0]), goal)) == 0
    assert way.look_along(maps, 0, np.zeros(3))[1] == -1


def test_to_a_goal_outside_of_the_map_the_way_leads_to_the_end_of_the_map_before_it() -> None:
    goal = np.array([500.0, 10.0, 0.0])
    maps = empty(goal)
    cells = found_way(maps, np.zeros(3), goal)
    edge = 0.5 * occupancy.NUM_X * CELL
    assert maps.lengths[0, 1] * CELL == pytest.approx(edge + 10.0, abs=2 * CELL)
    assert (np.diff(cells[:, 0]) >= 0.0).all() and (np.diff(cells[:, 1]) >= 0.0).all()
