"""Which points of a cloud from photos are wall, where it is known which are."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from aquanav_tools.cave.scan.confirmed import is_supported

CELL, RADIUS, NEIGHBOURS = 0.02, 0.06, 16
"""Points of a thinned cloud, and how far they support each other: a voxel of 4 cm."""


def wall(side: float, spacing: float, rng: np.random.Generator) -> np.ndarray:
    """Return points on a square of the plane z = 0, one in each cell of a grid."""
    axis = np.arange(0.0, side, spacing)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    return np.column_stack([grid + 0.5 * spacing * rng.random(grid.shape), np.zeros(len(grid))])


def test_wall_that_few_photos_saw_is_kept_and_a_curtain_of_chance_agreements_is_not(rng: np.random.Generator) -> None:
    seen_well, seen_twice = wall(2.0, CELL, rng), wall(2.0, 1.75 * CELL, rng) + [3.0, 0.0, 0.0]
    # Across the passage, 3 m before the wall: as many points as a dark opening of 2 x 2 x 0.5 m showed by chance.
    curtain = rng.random((400, 3)) * [2.0, 2.0, 0.5] + [0.0, 0.0, 3.0]
    points = np.concatenate([seen_well, seen_twice, curtain])
    is_wall = np.repeat([True, True, False], [len(seen_well), len(seen_twice), len(curtain)])
    votes = np.repeat([20.0, 2.0, 2.0], [len(seen_well), len(seen_twice), len(curtain)])
    distances, neighbours = cKDTree(points).query(points, k=NEIGHBOURS + 1)
    kept = is_supported(votes, distances, neighbours, RADIUS)
    is_rim = (np.abs(points[:, :2] % 3.0 - 1.0) > 1.0 - RADIUS).any(axis=1)
    assert kept[is_wall & ~is_rim].all()
    assert kept[~is_wall].mean() < 0.02
