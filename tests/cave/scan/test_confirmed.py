"""Which points of a cloud from photos are wall, where it is known which are."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from aquanav_tools.cave.scan.confirmed import MAX_SPACING, is_supported

CELL, RADIUS, NEIGHBOURS = 0.02, 0.06, 16
"""Points of a thinned cloud, and how far they support each other: a voxel of 4 cm."""


def wall(side: float, spacing: float, rng: np.random.Generator) -> np.ndarray:
    """Return points within 5 mm of a square of the plane z = 0, one in each cell of a grid."""
    axis = np.arange(0.0, side, spacing)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    return np.column_stack([grid + 0.5 * spacing * rng.random(grid.shape), rng.uniform(-0.005, 0.005, len(grid))])


def test_wall_that_few_photos_saw_is_kept_and_chance_agreements_are_not(rng: np.random.Generator) -> None:
    seen_well, seen_twice = wall(2.0, CELL, rng), wall(2.0, 1.75 * CELL, rng) + [3.0, 0.0, 0.0]
    # Across the passage, 3 m before the wall: as many points as a dark opening of 2 x 2 x 0.5 m showed by chance; and
    # close together, as at such an opening's rim.
    curtain = rng.random((400, 3)) * [2.0, 2.0, 0.5] + [0.0, 0.0, 3.0]
    rim = rng.random((1200, 3)) * [0.5, 0.5, 0.5] + [0.0, 0.0, 6.0]
    parts = [seen_well, seen_twice, curtain, rim]
    points, sizes = np.concatenate(parts), [len(part) for part in parts]
    part, votes = np.repeat(range(4), sizes), np.repeat([20.0, 2.0, 1.0, 1.0], sizes)
    distances, neighbours = cKDTree(points).query(points, k=NEIGHBOURS + 1)
    kept = is_supported(points, votes, distances, neighbours, RADIUS)
    is_edge = (np.abs(points[:, :2] % 3.0 - 1.0) > 1.0 - RADIUS).any(axis=1)
    assert kept[(part < 2) & ~is_edge].all()
    assert kept[part == 2].mean() < 0.02
    assert distances[part == 3, 1:].mean() < MAX_SPACING * RADIUS
    assert kept[part == 3].mean() < 0.1
