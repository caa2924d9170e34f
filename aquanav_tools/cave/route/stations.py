"""Choosing where along the route panels stand: closer in bends and narrow places, and in sight of each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.cave.options import PanelOptions
from aquanav_tools.errors import MeshError
from aquanav_tools.geometry.mesh.contact import Surface
from aquanav_tools.types import Array, IntArray

MIN_PANELS = 6
"""The original benchmark's number of panels."""
SPACING_PER_CLEARANCE = 2.0
"""A gate is at most about as long as the passage is wide, so that its two panels bound it."""
MAX_TURN = float(np.deg2rad(20.0))
"""A gate turns by at most about this, so that the planes of its panels say how far along a place is."""
TIGHT_SHARE = 0.95
"""Where the passage is tight, segments between panels keep this share of what the route itself keeps."""
PROBE_RADIUS = 1e-6
"""Radius of the thinnest capsule that FCL takes, m: a line."""


@dataclass(frozen=True, eq=False)
class Line:
    """An evenly spaced line through the water, with what is needed to place panels on it."""

    points: Array
    """(C, 3) m."""
    step: float
    """Distance between points along the line, m."""
    tangents: Array
    """(C, 3) unit directions, averaged."""
    clearance: Array
    """(C,) m."""


def direct(points: Array, step: float, clearance: Array, tangent_length: float) -> Line:
    """Return the line through (C, 3) points with its directions averaged over `tangent_length` (m)."""
    half_window = max(1, round(0.5 * tangent_length / step))
    index = np.arange(len(points))
    chords = points[np.minimum(index + half_window, len(points) - 1)] - points[np.maximum(index - half_window, 0)]
    return Line(points, step, chords / np.linalg.norm(chords, axis=1, keepdims=True), clearance)


class Sight:
    """Tells whether a vehicle may swim straight from one point of a line to another."""

    def __init__(self, line: Line, surface: Surface, radius: float, margin: float) -> None:
        self._line, self._surface, self._radius, self._margin = line, surface, radius, margin
        a, b = line.points[:-1], line.points[1:]
        # What a leg keeps beyond what `needed` looks at changes nothing, so there a bound will do.
        self._route = surface.distance(0.5 * (a + b)) - 0.5 * np.linalg.norm(b - a, axis=1)
        for n in np.flatnonzero(self._route <= (radius + margin) / TIGHT_SHARE):
            self._route[n] = surface.gap(a[n], b[n], PROBE_RADIUS) + PROBE_RADIUS

    def needed(self, before: int, after: int) -> float:
        """Return the clearance, m, that the segment between two points of the line must have.

        The vehicle's radius and the margin; where the route keeps less, most of what it keeps, and the radius wherever
        the route keeps that.
        """
        kept = float(self._route[before:after].min())
        return min(self._radius + self._margin, max(TIGHT_SHARE * kept, min(self._radius, kept)))

    def is_clear(self, before: int, after: int) -> bool:
        """Return whether the straight segment between two points of the line has the clearance it needs."""
        if after == before + 1:
            return True  # the segment is a leg of the line itself
        ends = self._line.points[before], self._line.points[after]
        return self._surface.gap(*ends, max(self.needed(before, after), PROBE_RADIUS)) > 0.0


def choose_stations(line: Line, sight: Sight, options: PanelOptions) -> IntArray:
    """Return the indices of the points of the line where panels stand, first and last among them.

    Raises:
        MeshError: the line is too short for MIN_PANELS panels.
    """
    length = (len(line.points) - 1) * line.step
    if length < (MIN_PANELS - 1) * options.min_spacing or len(line.points) < MIN_PANELS:
        raise MeshError(
            f"The passage leaves {length:.2f} m of route between its ends, too short for {MIN_PANELS} panels at least "
            f"{options.min_spacing:.2f} m apart. The unit is wrong or the passage too short: check --unit, or allow "
            "closer panels with --panels.min-spacing."
        )
    rate = 1.0 / _spacings(line, options)
    gates = np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * line.step)])
    count = max(MIN_PANELS, int(np.ceil(gates[-1])) + 1)
    stations = np.searchsorted(gates, np.linspace(0.0, gates[-1], count) - 1e-9)
    stations = np.maximum(stations, np.arange(count))  # distinct, also at the ends
    stations = np.minimum(stations, len(line.points) - np.arange(count, 0, -1))
    return _split_until_clear(np.unique(stations), sight)


def _spacings(line: Line, options: PanelOptions) -> Array:
    """Return the (C,) distances between panels that suit each point, m."""
    cosines = np.einsum("ci,ci->c", line.tangents[1:], line.tangents[:-1])
    turns = np.arccos(np.clip(cosines, -1.0, 1.0)) / line.step
    per_metre = np.maximum(np.append(turns, turns[-1]), np.append(turns[0], turns))
    wanted = np.minimum(SPACING_PER_CLEARANCE * line.clearance, MAX_TURN / np.maximum(per_metre, 1e-9))
    return np.clip(wanted, options.min_spacing, options.spacing)


def _split_until_clear(stations: IntArray, sight: Sight) -> IntArray:
    kept = [int(stations[0])]
    ahead = [int(station) for station in stations[:0:-1]]
    while ahead:
        if sight.is_clear(kept[-1], ahead[-1]):
            kept.append(ahead.pop())
        else:
            ahead.append((kept[-1] + ahead[-1]) // 2)
    return np.array(kept)
