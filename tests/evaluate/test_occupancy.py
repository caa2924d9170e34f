"""What rays have met, and ways through it: by walls that are known, and beside another library's shortest ways."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.evaluate import occupancy
from aquanav_tools.evaluate.occupancy import CELL, GREED, UNKNOWN_COST, WALL_COST, Occupancy
from aquanav_tools.types import Array

ALL_ROUND = np.array([(np.cos(turn), np.sin(turn), 0.0) for turn in np.radians(np.arange(0.0, 360.0, 5.0))])


def pocket_ends(place: Array) -> tuple[Array, Array]:
    """Return where rays end in a pocket that is open towards -x: walls at x = 3 and y = -1 and 1, from z to z."""
    with np.errstate(divide="ignore", invalid="ignore"):
        to_head = np.where(ALL_ROUND[:, 0] > 1e-9, (3.0 - place[0]) / ALL_ROUND[:, 0], np.inf)
        to_side = np.where(
            np.abs(ALL_ROUND[:, 1]) > 1e-9,
            (np.sign(ALL_ROUND[:, 1]) - place[1]) / ALL_ROUND[:, 1],
            np.inf,
        )
    lengths = np.minimum(np.minimum(to_head, to_side), 4.0)
    return place + lengths[:, None] * ALL_ROUND, lengths < 4.0


def seen_pocket() -> Occupancy:
    """Return what is known when a vehicle has swum into the pocket: walls at several heights, floor and roof."""
    grid = Occupancy(np.zeros(3), np.array([9.0, 0.0, 0.0]), ALL_ROUND)
    for x in np.arange(-3.0, 2.6, 0.1):
        ends, has_echo = pocket_ends(np.array([x, 0.0, 0.0]))
        for height in np.arange(-1.8, 1.9, 0.1):
            grid.see(np.array([x, 0.0, 0.0]), ends + [0.0, 0.0, height], has_echo)
    for x in np.arange(-3.0, 3.1, 0.1):
        for y in np.arange(-1.0, 1.1, 0.1):
            for z in (-1.8, 1.8):
                ends = np.tile([x, y, z], (len(ALL_ROUND), 1))
                grid.see(np.array([min(x, 2.6), 0.7 * y, 0.0]), ends, np.ones(len(ends), dtype=bool))
    return grid


def test_where_nothing_is_known_the_way_is_straight() -> None:
    grid = Occupancy(np.zeros(3), np.array([6.0, 0.0, 0.0]), ALL_ROUND)
    way = grid.way(np.zeros(3))
    assert way is not None
    assert len(way) * CELL == pytest.approx(6.0, abs=2 * CELL)
    assert np.abs(way[:, 1:]).max() < CELL


def test_the_way_leads_back_out_of_a_dead_end() -> None:
    grid = seen_pocket()
    way = grid.way(np.array([2.4, 0.0, 0.0]))
    assert way is not None
    inside = (np.abs(way[:, 1]) < 0.8) & (np.abs(way[:, 2]) < 1.7)
    assert way[inside, 0].min() < -2.5  # it leaves by the open end
    assert np.linalg.norm(way[-1] - [9.0, 0.0, 0.0]) < CELL
    assert len(way) * CELL < 2 * (2.4 + 3.0) + 9.0 + 6.0


def test_a_wall_in_sight_is_no_clear_line_and_open_water_is_one() -> None:
    grid = seen_pocket()
    assert grid.is_clear(np.zeros(3), np.array([2.0, 0.0, 0.0]))
    assert not grid.is_clear(np.zeros(3), np.array([4.0, 0.0, 0.0]))


def test_walls_are_guessed_between_neighbouring_rays_until_one_goes_through() -> None:
    turns = np.radians([-10.0, 10.0, 0.0])
    directions = np.stack([np.cos(turns), np.sin(turns), np.zeros(3)], axis=1)
    grid, place = Occupancy(np.zeros(3), np.array([9.0, 0.0, 0.0]), directions[:2]), np.zeros(3)
    ends = place + 2.0 * directions[:2]
    grid.see(place, ends, np.array([True, True]))
    beyond = np.array([3.5, 0.0, 0.0])
    assert not grid.is_clear(place, beyond)
    grid.see(place, np.stack([beyond, beyond]), np.array([False, False]))
    assert grid.is_clear(place, beyond)


def test_a_way_costs_at_most_half_as_much_again_as_another_librarys_cheapest(
    rng: np.random.Generator,
) -> None:
    graph = pytest.importorskip("skimage.graph", reason="scikit-image comes with the extra build")
    shape = (14, 11, 9)
    cells = rng.choice(np.array([0, 1, 2, 3, 4], dtype=np.int8), size=shape, p=[0.3, 0.3, 0.3, 0.05, 0.05])
    costs = np.choose(cells, [UNKNOWN_COST, 1.0, WALL_COST, WALL_COST, 1.0])
    for _ in range(20):
        start, goal = (np.array([rng.integers(size) for size in shape]) for _ in range(2))
        way = occupancy._way(cells, start, goal).astype(int)
        assert (way[0] == start).all() and (way[-1] == goal).all()
        assert (np.abs(np.diff(way, axis=0)).sum(axis=1) == 1).all()
        found = graph.MCP(costs, fully_connected=False)
        totals, _ = found.find_costs([tuple(start.tolist())])
        own = costs[tuple(way[1:].T)].sum() + costs[tuple(start)]  # there the first cell counts as well
        assert totals[tuple(goal)] * (1.0 - 1e-5) <= own <= GREED * totals[tuple(goal)] * (1.0 + 1e-5)


def test_ends_of_another_number_of_rays_are_refused() -> None:
    """They would be read beyond their end."""
    grid = Occupancy(np.zeros(3), np.array([6.0, 0.0, 0.0]), ALL_ROUND)
    with pytest.raises(ValueError, match="72 rays"):
        grid.see(np.zeros(3), np.ones((2, 3)), np.array([True, True]))


def test_from_outside_of_the_grid_there_is_no_way() -> None:
    grid = Occupancy(np.zeros(3), np.array([6.0, 0.0, 0.0]), ALL_ROUND)
    assert grid.way(np.array([200.0, 0.0, 0.0])) is None
