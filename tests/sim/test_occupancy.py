"""What rays have met, and ways through it: by walls that are known, and beside another library's shortest ways."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.errors import ResourceError
from aquanav_tools.sim import occupancy, way
from aquanav_tools.sim.occupancy import CELL, ENDED, GUESSED, HIGHEST, LOWEST, PASSED, VISITED, Maps
from aquanav_tools.sim.way import GREED, UNKNOWN_COST, WALL_COST
from aquanav_tools.types import Array

ALL_ROUND = np.array([(np.cos(turn), np.sin(turn), 0.0) for turn in np.radians(np.arange(0.0, 360.0, 5.0))])
REACH = 4.0


def empty(goal: Array, place: Array | None = None) -> Maps:
    """Return a map that begins at the origin, or elsewhere, with nothing known."""
    maps = occupancy.make_maps(1)
    occupancy.begin(maps, 0, np.zeros(3) if place is None else place, goal)
    return maps


def look(maps: Maps, place: Array, rays: Array, ranges: Array) -> None:
    """Note what rays have met that reach 4 m."""
    reaches = np.full(len(rays), REACH)
    occupancy.see(maps, 0, place, rays, ranges, reaches)


def found_way(maps: Maps, place: Array, goal: Array) -> Array:
    """Return the (P, 3) middles of the first cells of the way, m."""
    way.plan(maps, 0, place, goal)
    return np.array([way.middle(maps, 0, p) for p in range(maps.lengths[0, 0])])


def known(maps: Maps, place: Array) -> int:
    """Return the evidence of the cell at a place: above 0 a wall, below 0 water."""
    return int(occupancy.evidence(maps, 0, *occupancy.cell_of(maps, 0, place)))


def pocket(goal: Array) -> Maps:
    """Return a known pocket, 2.4 m wide and 3.6 m high, from x = -3 m, where it is open, to x = 3 m."""
    maps = empty(goal)
    for x in np.arange(-3.0, 3.01, 0.5 * CELL):
        for y in np.arange(-1.2, 1.21, 0.5 * CELL):
            for z in np.arange(-1.8, 1.81, 0.5 * CELL):
                is_wall = x > 2.9 or abs(y) > 1.1 or abs(z) > 1.7
                place = np.array([x, y, z])
                if is_wall or known(maps, place) <= 0:
                    occupancy._add(maps, 0, *occupancy.cell_of(maps, 0, place), HIGHEST - LOWEST if is_wall else PASSED)
    return maps


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


def test_walls_are_guessed_around_walls_until_a_ray_goes_through() -> None:
    maps, ahead = empty(np.array([9.0, 0.0, 0.0])), np.array([[1.0, 0.0, 0.0]])
    beside, place = np.array([2.1, 2 * CELL + 0.1, 0.1]), np.array([0.0, 0.1, 0.1])
    assert known(maps, beside) == 0
    look(maps, place, ahead, np.array([2.1]))
    assert known(maps, np.array([2.1, 0.1, 0.1])) == ENDED and known(maps, beside) == GUESSED
    assert known(maps, beside + [0.0, CELL, 0.0]) == 0
    assert known(maps, np.array([1.1, 0.1, 0.1])) == PASSED
    look(maps, beside - [2.1, 0.0, 0.0], ahead, np.array([REACH]))
    assert known(maps, beside) == GUESSED + PASSED < 0
    look(maps, place, ahead, np.array([2.1]))
    assert known(maps, beside) < 0  # what is known is not guessed


def test_a_cell_through_which_most_rays_go_is_water_and_one_where_most_end_is_wall() -> None:
    maps, ahead, place = empty(np.array([9.0, 0.0, 0.0])), np.array([[1.0, 0.0, 0.0]]), np.array([0.0, 0.1, 0.1])
    cell = np.array([2.1, 0.1, 0.1])
    for _ in range(50):
        for length in (REACH, REACH, REACH, 2.1):
            look(maps, place, ahead, np.array([length]))
    assert LOWEST <= known(maps, cell) < 0
    for _ in range(50):
        for length in (2.1, 2.1, REACH):
            look(maps, place, ahead, np.array([length]))
    assert 0 < known(maps, cell) <= HIGHEST


def test_where_a_vehicle_was_and_around_the_goal_there_is_no_wall() -> None:
    goal = np.array([2.0, 0.1, 0.1])
    maps, ahead = empty(goal), np.array([[1.0, 0.0, 0.0]])
    look(maps, np.array([0.0, 0.1, 0.1]), ahead, np.array([2.0]))
    assert known(maps, goal) == VISITED
    look(maps, np.array([-3.0, 0.1, 0.1]), ahead, np.array([1.0]))
    assert known(maps, np.array([-2.0, 0.1, 0.1])) > 0
    look(maps, np.array([-2.0, 0.1, 0.1]), ahead, np.array([REACH]))
    look(maps, np.array([-3.0, 0.1, 0.1]), ahead, np.array([1.0]))
    assert known(maps, np.array([-2.0, 0.1, 0.1])) == VISITED


def test_a_way_costs_at_most_so_much_more_than_another_librarys_cheapest(rng: np.random.Generator) -> None:
    graph = pytest.importorskip("skimage.graph", reason="scikit-image comes with the extra build")
    shape = np.array([14, 11, 9])
    for _ in range(30):
        more = rng.choice(np.array([0, PASSED, ENDED, GUESSED]), size=shape, p=[0.3, 0.35, 0.3, 0.05])
        maps = empty(np.full(3, 200.0))  # its goal, which is known to be water, lies elsewhere
        corner = np.array(occupancy.cell_of(maps, 0, np.zeros(3)))
        for cell in np.ndindex(*shape):
            occupancy._add(maps, 0, *(corner + cell), more[cell])
        costs = np.where(more == 0, UNKNOWN_COST, np.where(more > 0, WALL_COST, 1.0))
        around = np.pad(costs, 40, constant_values=UNKNOWN_COST)  # ways lead around it, too
        start, goal = (np.array([rng.integers(size) for size in shape]) for _ in range(2))
        if costs[tuple(goal)] == WALL_COST:
            continue  # all cells are cheaper: see below
        cells = found_way(maps, (start + 0.5) * CELL, (goal + 0.5) * CELL)
        assert len(cells) == maps.lengths[0, 1] + 1  # all of it was kept
        steps = np.floor(cells / CELL).astype(int)
        assert (steps[0] == start).all() and (steps[-1] == goal).all()
        assert (np.abs(np.diff(steps, axis=0)).sum(axis=1) == 1).all()
        least = graph.MCP(around, fully_connected=False).find_costs([tuple((start + 40).tolist())])[0][tuple(goal + 40)]
        own = around[tuple((steps[1:] + 40).T)].sum() + around[tuple(start + 40)]  # there the first cell counts as well
        assert least * (1.0 - 1e-5) <= own <= GREED * least * (1.0 + 1e-5)


def test_a_search_that_may_go_no_further_ends_nearest_to_the_goal() -> None:
    """Around the goal stands a closed box of walls, so that all cells outside of it come first."""
    goal = np.array([30.0, 0.0, 0.0])
    maps = empty(goal)
    centre = np.array(occupancy.cell_of(maps, 0, goal))
    for cell in np.ndindex(13, 13, 13):
        if max(abs(c - 6) for c in cell) == 6:
            occupancy._add(maps, 0, *(centre + np.array(cell) - 6), ENDED)
    way.plan(maps, 0, np.zeros(3), goal)
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


def test_what_lies_outside_of_the_map_is_not_kept() -> None:
    maps = empty(np.array([9.0, 0.0, 0.0]))
    before = maps.counts[0]
    look(maps, np.array([0.0, 200.0, 0.0]), ALL_ROUND, np.full(len(ALL_ROUND), 1.0))
    assert maps.counts[0] == before


def test_a_map_that_begins_anew_knows_nothing_of_the_last() -> None:
    goal = np.array([9.0, 0.0, 0.0])
    maps, fresh = pocket(goal), empty(goal)
    occupancy.begin(maps, 0, np.zeros(3), goal)
    assert (maps.numbers == fresh.numbers).all() and (maps.blocks == fresh.blocks).all()


def test_what_is_packed_comes_back() -> None:
    goal = np.array([9.0, 0.0, 0.0])
    maps = pocket(goal)
    found_way(maps, np.zeros(3), goal)
    again = occupancy.unpacked(occupancy.packed(maps))
    for name, array in maps._asdict().items():
        is_kept = np.arange(maps.blocks.shape[1]) < maps.counts[0] if name == "places" else slice(None)
        assert (
            (array[:, is_kept] == getattr(again, name)[:, is_kept]).all()
            if name == "places"
            else (array == getattr(again, name)).all()
        )


def test_places_far_from_the_origin_make_the_same_map() -> None:
    far = np.array([4.0e5, 5.3e6, -300.0])
    goal = np.array([9.0, 0.0, 0.0])
    near_by, far_off = empty(goal), empty(far + goal, far)
    for maps, origin in ((near_by, np.zeros(3)), (far_off, far)):
        look(maps, origin + 0.1, ALL_ROUND, np.linspace(1.0, REACH, len(ALL_ROUND)))
    is_other = near_by.blocks != far_off.blocks  # where a ray lies on the edge between two cells
    assert is_other.sum() < 0.02 * (near_by.blocks != 0).sum()


def test_more_maps_than_memory_are_refused_with_a_sentence() -> None:
    with pytest.raises(ResourceError, match=r"Maps of 100000000 vehicles reserve .* Take fewer vehicles"):
        occupancy.make_maps(100_000_000)
