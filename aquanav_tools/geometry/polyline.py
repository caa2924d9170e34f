"""Lines through space, as points one after the other."""

from __future__ import annotations

import numpy as np

from aquanav_tools.types import Array


def arc_lengths(points: Array) -> Array:
    """Return the (C,) distances of a (C, 3) polyline's points from its first, along it, m."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def length_of(points: Array) -> float:
    """Return the length of a (C, 3) polyline, m."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def point_at(points: Array, lengths: Array, stations: Array) -> Array:
    """Return the (S, 3) points of a polyline at (S,) distances along it; `lengths` are its `arc_lengths`."""
    return np.stack([np.interp(stations, lengths, points[:, axis]) for axis in range(3)], axis=1)


def resample(points: Array, step: float) -> Array:
    """Return a polyline's points at equal distances of about `step` along it, m, ends kept."""
    lengths = arc_lengths(points)
    return point_at(points, lengths, np.linspace(0.0, lengths[-1], max(2, round(lengths[-1] / step) + 1)))
