from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from aquanav_tools.cave.scan.thinning import EvenThinner


def a_wall(number: int, rng: np.random.Generator) -> np.ndarray:
    """Points on the unit square, far denser at one edge, with their number in a fourth column."""
    x = rng.random(number) ** 3
    return np.column_stack([x, rng.random(number), np.zeros(number), np.arange(number)])


def thinned(table: np.ndarray, max_points: int, pieces: int) -> tuple[np.ndarray, float]:
    thinner = EvenThinner(max_points)
    for piece in np.array_split(table, pieces):
        thinner.add(piece)
    assert thinner.num_seen == len(table)
    return thinner.result(), thinner.cell


def test_a_small_cloud_stays_as_it_is(rng: np.random.Generator) -> None:
    wall = a_wall(1000, rng)
    kept, cell = thinned(wall, 1000, 3)
    assert np.array_equal(kept, wall)
    assert cell == 0.0


def test_a_large_cloud_is_thinned_to_at_most_the_limit_and_covers_the_wall_evenly(rng: np.random.Generator) -> None:
    wall = a_wall(60_000, rng)
    kept, cell = thinned(wall, 2000, 20)
    assert 1000 / np.sqrt(2.0) < len(kept) <= 2000
    # Whatever was scanned has a point that was kept in its own cell, or in one it was in before cells grew.
    distance, _ = cKDTree(kept[:, :3]).query(wall[:, :3])
    assert distance.max() < 2.0 * np.sqrt(3.0) * cell


def test_kept_rows_are_rows_that_came_in_their_order(rng: np.random.Generator) -> None:
    wall = a_wall(20_000, rng)
    kept, _ = thinned(wall, 2000, 7)
    assert (np.diff(kept[:, 3]) > 0).all()
    assert np.array_equal(kept, wall[kept[:, 3].astype(int)])


def test_one_point_far_away_does_not_cost_the_others(rng: np.random.Generator) -> None:
    wall = a_wall(20_000, rng)
    wall[7, :3] = 1e6
    kept, _ = thinned(wall, 2000, 7)
    assert len(kept) > 500
