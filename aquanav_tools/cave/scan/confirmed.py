"""Clouds from photos: points are averaged by how many photos confirm them, and dropped where too few do.

Where a passage is open, photos show darkness, and stereo draws a thin curtain of chance agreements across it: each of
its points is confirmed by two photos or three, as many a true one is. But around a true point lie others, seen by
others; around a false one there is nothing.
"""

from __future__ import annotations

import numpy as np

from aquanav_tools.types import Array, BoolArray, IntArray, PointCloud

MIN_SUPPORT = 0.1
"""A point's surroundings have at least this share of the confirmations of a typical point's. Measured on the demo's
photos: drops nine tenths of the curtains across its ends, three quarters of all false points and 1.5 % of the true."""
MAX_SPACING, MAX_THICKNESS = 1.7, 0.5
"""A point whose neighbours lie this near on average, radii of support, in a layer this thin, over its width, belongs to
wall that few photos saw at a slant: sparse, but flat, as curtains are not. Measured on photos of a loop and of a dark
dive: of what has too little support, this brings back 36 and 59 % of the points within 5 cm of wall, and 6 and 5 % of
those more than 10 cm off."""
MIN_NORMAL = 0.3
"""The mean of a cell's unit normals is at least this long, or photos contradict each other there."""
KEY_BITS = 21


def thin_confirmed(cloud: PointCloud, cell: float) -> tuple[Array, Array, Array]:
    """Return one point per cell of a grid, the mean of its points, each weighted by how many photos confirm it.

    Args:
        cloud: with normals and `num_photos`.
        cell: edge of the cells, m.

    Returns:
        (N, 3) points, m; their (N, 3) unit normals, 0 where they contradict each other; (N,) photos in all.
    """
    assert cloud.normals is not None and cloud.num_photos is not None
    places = np.floor((cloud.points - cloud.points.min(axis=0)) / cell).astype(np.int64)
    keys = (places[:, 0] << 2 * KEY_BITS) + (places[:, 1] << KEY_BITS) + places[:, 2]
    order = np.argsort(keys, kind="stable")
    starts = np.flatnonzero(np.diff(keys[order], prepend=-1))
    weights = cloud.num_photos[order].astype(np.float64)
    votes = np.add.reduceat(weights, starts)
    points = np.add.reduceat(weights[:, None] * cloud.points[order], starts) / votes[:, None]
    normals = np.add.reduceat(weights[:, None] * cloud.normals[order], starts) / votes[:, None]
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    return points, np.where(length > MIN_NORMAL, normals / np.maximum(length, MIN_NORMAL), 0.0), votes


def is_supported(points: Array, votes: Array, distances: Array, neighbours: IntArray, radius: float) -> BoolArray:
    """Return the (N,) flags of points with enough confirmations around them, or on thin, flat wall.

    Args:
        points: (N, 3), m.
        votes: (N,) photos that confirm each.
        distances: (N, K) to its nearest ones, itself first, m.
        neighbours: (N, K) which those are.
        radius: how far support reaches, m.
    """
    support = np.where(distances <= radius, votes[neighbours], 0.0).sum(axis=1)
    supported: BoolArray = support >= MIN_SUPPORT * np.median(support)
    sparse = np.flatnonzero(~supported & (distances[:, 1:].mean(axis=1) <= MAX_SPACING * radius))
    supported[sparse] = thickness(points, neighbours[sparse]) <= MAX_THICKNESS
    return supported


def thickness(points: Array, groups: IntArray) -> Array:
    """Return the (M,) thickness over width of groups of points, given by their (M, K) indices."""
    offsets = points[groups] - points[groups].mean(axis=1, keepdims=True)
    variances = np.linalg.eigvalsh(np.einsum("mki,mkj->mij", offsets, offsets))
    ratio: Array = np.sqrt(np.maximum(variances[:, 0], 0.0) / np.maximum(variances[:, 1], 1e-30))
    return ratio
