"""Whether two panels cross: exactly, as flat polygons in space."""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.route.guide import Panel
from aquanav_tools.geometry.plane import plane_axes
from aquanav_tools.types import Array

TOLERANCE = 1e-6
"""Panels that share less of a line than this only touch, m."""


def panels_cross(one: Panel, other: Panel) -> bool:
    """Return whether the polygons of two panels share a piece of a line.

    Both planes meet in a line; each polygon covers intervals of it. Polygons in parallel planes do not cross. One that
    goes on behind a pillar counts with the rock between its pieces: planes that meet there swap their order behind it.
    """
    direction = np.cross(one.normal, other.normal)
    if np.linalg.norm(direction) < TOLERANCE:
        return False
    direction /= np.linalg.norm(direction)
    ours = _cuts(_spanned(one), other.centre, other.normal, direction)
    theirs = _cuts(_spanned(other), one.centre, one.normal, direction)
    return _overlap(ours, theirs) > TOLERANCE


def _spanned(panel: Panel) -> Array:
    """Return the (K, 3) outline of a panel; its hull where it goes on behind a pillar."""
    import shapely

    if not panel.is_parted:
        return panel.polygon
    axes = plane_axes(panel.normal)
    hull = shapely.MultiPoint((panel.polygon - panel.centre) @ axes.T).convex_hull
    spanned: Array = np.asarray(hull.exterior.coords)[:-1] @ axes + panel.centre
    return spanned


def _cuts(polygon: Array, point: Array, normal: Array, direction: Array) -> Array:
    """Return the (I, 2) intervals along `direction` in which a plane cuts a (K, 3) polygon, m."""
    heights = (polygon - point) @ normal
    above = heights >= 0.0
    edges = np.flatnonzero(above != np.roll(above, -1))
    ends = (edges + 1) % len(polygon)
    share = heights[edges] / (heights[edges] - heights[ends])
    places = polygon[edges] + share[:, None] * (polygon[ends] - polygon[edges])
    intervals: Array = np.sort(places @ direction).reshape(-1, 2)  # a closed outline is cut an even number of times
    return intervals


def _overlap(ours: Array, theirs: Array) -> float:
    """Return the length that two sets of disjoint intervals share."""
    low = np.maximum(ours[:, None, 0], theirs[None, :, 0])
    high = np.minimum(ours[:, None, 1], theirs[None, :, 1])
    return float(np.maximum(high - low, 0.0).sum())
