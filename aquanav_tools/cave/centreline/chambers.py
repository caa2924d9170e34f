"""Chambers: where a passage widens into a room."""

from __future__ import annotations

import numpy as np

from aquanav_tools.cave.centreline.graph import Chamber, Line
from aquanav_tools.types import BoolArray, IntArray

MIN_WIDENING = 1.5
"""A chamber has at least this many times the clearance of every way out of it, and of half of all centreline: more than
twice their section."""
MAX_ELONGATION = 3.0
"""What is longer than this many of its largest clearances to one side is a wide stretch of passage, no chamber."""


def find_chambers(line: Line, portals: IntArray) -> tuple[Chamber, ...]:
    """Return the chambers along a centreline, roomiest first.

    From its roomiest point on, the stretch that is wider than 1 / MIN_WIDENING of it must end in narrower passage all
    around: it may neither reach a portal nor be all there is.

    Args:
        line: points, clearance and steps of the graph.
        portals: which of the points are portals.
    """
    is_portal = np.zeros(len(line.points), dtype=bool)
    is_portal[portals] = True
    chambers: list[Chamber] = []
    usual = float(np.median(line.clearance))
    for peak in _peaks(line):
        radius = float(line.clearance[peak])
        if radius < MIN_WIDENING * usual:
            break  # so are all that follow
        stretch = _stretch(line, int(peak))
        is_known = any((line.points[stretch] == chamber.centre).all(axis=1).any() for chamber in chambers)
        is_top = not is_known and not (line.clearance[stretch] > radius).any()
        is_compact = np.linalg.norm(line.points[stretch] - line.points[peak], axis=1).max() <= MAX_ELONGATION * radius
        if is_top and is_compact and not is_portal[stretch].any() and _has_way_out(line, stretch):
            chambers.append(Chamber(line.points[peak], radius, int(line.branch[peak])))
    return tuple(chambers)


def _peaks(line: Line) -> IntArray:
    """Return the points that are no narrower than their neighbours, roomiest first."""
    is_peak = np.ones(len(line.points), dtype=bool)
    first, second = line.steps.T
    is_peak[first[line.clearance[first] < line.clearance[second]]] = False
    is_peak[second[line.clearance[second] < line.clearance[first]]] = False
    peaks = np.flatnonzero(is_peak)
    return peaks[np.argsort(-line.clearance[peaks], kind="stable")]


def _stretch(line: Line, peak: int) -> BoolArray:
    """Return which points hang together with a peak and are not narrow beside it."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    is_wide = line.clearance * MIN_WIDENING > line.clearance[peak]
    steps = line.steps[is_wide[line.steps].all(axis=1)]
    size = len(line.points)
    links = coo_array((np.ones(len(steps)), (steps[:, 0], steps[:, 1])), shape=(size, size))
    part = connected_components(links, directed=False)[1]
    return np.asarray(is_wide & (part == part[peak]))


def _has_way_out(line: Line, stretch: BoolArray) -> bool:
    inside = stretch[line.steps]
    return bool((inside[:, 0] != inside[:, 1]).any())
