"""Moving a line to the middle of its passage."""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.geometry.polyline import arc_lengths
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.types import Array, BoolArray

SMOOTHING = 3.0
"""Half the length of line that a smoothed point is fitted to, in clearances: a cubic over three widths of passage
follows bends and drops the relief of the walls."""
MIN_WINDOW = 4.0
"""The least such half length, in steps of the line: a cubic has four coefficients."""
FIRST_MOVE = 0.4
"""First trial distance across the passage, in clearances."""
NUM_HALVINGS = 6
"""How often the trial distance is halved: down to 1 % of the clearance."""
NUM_DIRECTIONS = 6
"""Directions across the passage that are tried; four would let a line stick on a ridge between two of them."""


class Wall:
    """Exact distances to the wall of a cavity; portals are openings here, no walls."""

    def __init__(self, cavity: Cavity, field: DistanceField) -> None:
        self.field = field
        self._surface = cavity.wall_surface

    def clearance(self, points: Array) -> Array:
        """Return the (N,) distance from (N, 3) points to the nearest wall, m."""
        return self._surface.distance(np.ascontiguousarray(points))

    def is_water(self, points: Array) -> BoolArray:
        """Return which of (N, 3) points are in the water and not beyond a portal."""
        return np.asarray(self.field.clearance(points) > 0.0)

    def ahead(self, point: Array, direction: Array, limit: float) -> float:
        """Return the metres from a (3,) point to the wall in a (3,) unit direction, `limit` at most."""
        way = 0.0
        while way < limit:
            free = float(self.clearance((point + way * direction)[None])[0])
            if free < 1e-3 * limit:
                break
            way += free
        return min(way, limit)


def centre(points: Array, wall: Wall) -> Array:
    """Return the points of a (K, 3) line moved across it to where the clearance is largest nearby.

    A point stays in its first ball, so that it crosses no wall, and in front of portals.
    """
    ahead = _directions(points)
    side = np.cross(ahead, np.eye(3)[np.argmin(np.abs(ahead), axis=1)])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(ahead, side)
    best, clearance = points.copy(), wall.clearance(points)
    ball = clearance.copy()
    size = FIRST_MOVE * ball
    for _ in range(NUM_HALVINGS):
        for angle in np.linspace(0.0, 2.0 * np.pi, NUM_DIRECTIONS, endpoint=False):
            trial = best + size[:, None] * (np.cos(angle) * side + np.sin(angle) * up)
            there = wall.clearance(trial)
            is_better = (there > clearance) & (np.linalg.norm(trial - points, axis=1) < ball) & wall.is_water(trial)
            best[is_better], clearance[is_better] = trial[is_better], there[is_better]
        size = 0.5 * size
    return best


def smooth(points: Array, clearance: Array, weights: Array) -> Array:
    """Return a (K, 3) line with every point replaced by a cubic fitted around it (local regression, tricube weights).

    Args:
        points: about evenly spaced, m.
        clearance: (K,) m.
        weights: (K,) how much each point counts in the fits.
    """
    along = arc_lengths(points)
    if len(points) < 2 * MIN_WINDOW:
        return points
    window = np.maximum(SMOOTHING * clearance, MIN_WINDOW * along[-1] / (len(points) - 1))
    return np.array([_fit(points, along, weights, n, window[n]) for n in range(len(points))])


def _fit(points: Array, along: Array, weights: Array, n: int, window: float) -> Array:
    first, last = np.searchsorted(along, [along[n] - window, along[n] + window])
    offset = (along[first:last] - along[n]) / window
    root = np.sqrt(weights[first:last]) * np.maximum(1.0 - np.abs(offset) ** 3, 0.0) ** 1.5
    powers = offset[:, None] ** np.arange(4)
    return np.asarray(np.linalg.lstsq(root[:, None] * powers, root[:, None] * points[first:last], rcond=None)[0][0])


def _directions(points: Array) -> Array:
    ahead = np.gradient(points, axis=0)
    return np.asarray(ahead / np.maximum(np.linalg.norm(ahead, axis=1, keepdims=True), 1e-12))
