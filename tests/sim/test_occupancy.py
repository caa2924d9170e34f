"""What rays have met."""

from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.errors import ResourceError
from aquanav_tools.sim import occupancy
from aquanav_tools.sim.occupancy import CELL, ENDED, GUESSED, HIGHEST, LOWEST, PASSED, VISITED
from tests.sim.maps import ALL_ROUND, REACH, empty, found_way, known, look, pocket


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


def test_a_ray_passes_all_cells_that_it_crosses_and_no_others(rng: np.random.Generator) -> None:
    """Beside a hundred places on each cell's edge."""
    for _ in range(50):
        start, ray = rng.uniform(-1.0, 1.0, 3), rng.normal(size=3)
        ray /= np.linalg.norm(ray)
        maps = empty(np.full(3, 90.0), np.full(3, -40.0))
        before = (maps.blocks != 0).sum()
        occupancy._pass(maps, 0, start, ray, 3.0)
        crossed = {occupancy.cell_of(maps, 0, start + along * ray) for along in np.arange(0.0, 3.0, 0.01 * CELL)}
        assert all(occupancy.evidence(maps, 0, *cell) == PASSED for cell in crossed)
        num = (maps.blocks != 0).sum() - before
        assert len(crossed) <= num <= len(crossed) + 2  # corners of cells, which places so far apart may miss


def test_what_lies_outside_of_the_map_is_not_kept() -> None:
    maps = empty(np.array([9.0, 0.0, 0.0]))
    before = maps.counts[0]
    look(maps, np.array([0.0, 200.0, 0.0]), ALL_ROUND, np.full(len(ALL_ROUND), 1.0))
    assert maps.counts[0] == before


def test_a_map_that_begins_anew_knows_nothing_of_the_last() -> None:
    goal = np.array([9.0, 0.0, 0.0])
    maps, fresh = pocket(goal), empty(goal)
    occupancy.begin(maps, 0, np.zeros(3), goal, 0.5 * np.pi)
    assert (maps.numbers == fresh.numbers).all() and (maps.blocks == fresh.blocks).all()


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
