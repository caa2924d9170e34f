"""Where scanners stood: from there to the points that they measured everything is free space."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from aquanav_tools.types import Array, BoolArray, PointCloud

BOX_MARGIN = 0.1
"""A scanner stands within the box around its points, grown by this share of its diagonal; else its pose is none: many
programs merge scans, move them into map coordinates, and write the origin for a pose."""
NUM_DIRECTIONS = 200
"""Cells that the sphere around a scanner is divided into."""
LEAST_COVERED = 0.8
"""Share of all directions in which a scanner inside a cave sees wall. The blind cone under a tripod, of 30 degrees, is
0.07 of the sphere; under the open sky half of it is lost."""
MIN_POINTS = 20 * NUM_DIRECTIONS
"""A station with fewer points after thinning tells nothing about directions."""


def believable_stations(points: Array, seen_from: Array) -> Array:
    """Return the (N, 3) places that points were seen from, NaN where the pose cannot be a scanner's.

    Args:
        points: (N, 3).
        seen_from: (N, 3) as the file says; NaN where it does not.
    """
    result = seen_from.copy()
    for station, is_its in _by_station(seen_from):
        low, high = points[is_its].min(axis=0), points[is_its].max(axis=0)
        margin = BOX_MARGIN * float(np.linalg.norm(high - low))
        if (station < low - margin).any() or (station > high + margin).any():
            result[is_its] = np.nan
    return result


def enclosed_stations(cloud: PointCloud) -> Array:
    """Return the (K, 3) stations around which wall was measured in nearly all directions: they stood in the cave."""
    if cloud.seen_from is None:
        return np.zeros((0, 3))
    spheres = _directions()
    found = []
    for station, is_its in _by_station(cloud.seen_from):
        rays = cloud.points[is_its] - station
        rays = rays[np.linalg.norm(rays, axis=1) > 0.0]
        if len(rays) >= MIN_POINTS:
            covered = np.unique(np.argmax(rays / np.linalg.norm(rays, axis=1, keepdims=True) @ spheres.T, axis=1))
            if len(covered) >= LEAST_COVERED * NUM_DIRECTIONS:
                found.append(station)
    return np.array(found).reshape(-1, 3)


def _by_station(seen_from: Array) -> Iterator[tuple[Array, BoolArray]]:
    """Yield each known station and the (N,) flags of the points seen from it."""
    known: BoolArray = np.asarray(np.isfinite(seen_from).all(axis=1))
    stations, ids = np.unique(seen_from[known], axis=0, return_inverse=True)
    for number, station in enumerate(stations):
        is_its: BoolArray = known.copy()
        is_its[known] = ids.ravel() == number
        yield station, is_its


def _directions() -> Array:
    """Return (NUM_DIRECTIONS, 3) unit vectors, spread evenly (Fibonacci)."""
    index = np.arange(NUM_DIRECTIONS) + 0.5
    z = 1.0 - 2.0 * index / NUM_DIRECTIONS
    angle = np.pi * (1.0 + np.sqrt(5.0)) * index
    radius = np.sqrt(1.0 - z**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
