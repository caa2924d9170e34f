"""The guide: panels across the passage that measure progress along it (the original's DistanceRewarder).

The original adds the distance to the next panel's centre to the chain of centres behind it. That jumps when a panel
is crossed off its centre, and its nearest-panel rule jumps at loops. Here progress between two panels is interpolated
by the angle between their planes, so that it is continuous at every panel and even along a circle's arc, and a vehicle
only changes its gate (the stretch between two panels) by passing through a panel's outline, forwards or backwards.

Progress has no jumps, but it is steeper than the way is long where panels stand closer than on the centreline: on the
inside of a bend of radius R by R / (R - r) at r from its middle line, which is the price of being even along it. (The
way that no move changes by more than its length is the shortest one: `cave/route/shortest.py`.) A vehicle that rounds
a loop on its other side is credited all of it at once where it meets the route again.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numba
import numpy as np

from aquanav_tools.cave.water.field import DistanceField
from aquanav_tools.cave.water.flood import nearest_through_water
from aquanav_tools.types import Array, IntArray

CATCH = 0.25
"""A vehicle within this distance of a panel is in it, m: half a step at 5 m/s and ten decisions per second, and less
than the rock between two passages."""
ARC_SAMPLES = 16
"""Within a gate progress is even along the centreline by so many pieces: its panels may lean away from it."""
PARALLEL = 1.0 - 1e-9
"""Cosine above which two planes do not meet within a hundred kilometres."""


@dataclass(frozen=True, eq=False)
class Panel:
    """A flat gate across the passage."""

    centre: Array
    """(3,) point of the centreline, m."""
    normal: Array
    """(3,) unit vector along the direction of travel."""
    polygon: Array
    """(K, 3) outline of the cross-section, m. Where it goes on behind a pillar, it comes back to its first corner."""
    arc_length: float
    """Distance along the centreline from the first panel, m."""
    clearance: float
    """Clearance at the centre, m."""

    @property
    def is_parted(self) -> bool:
        """Whether the outline goes on behind a pillar."""
        return bool((self.polygon[1:] == self.polygon[0]).all(axis=1).any())


@dataclass(frozen=True, eq=False)
class Guide:
    """The route from the entrance to the goal: a centreline and the panels across it.

    Gate g in 0 .. P - 2 is the stretch of passage between panels g and g + 1.
    """

    centreline: Array
    """(C, 3) from the entrance to the goal, m."""
    panels: tuple[Panel, ...]
    """At least two, with rising arc length; the first has arc length 0, the last is the goal."""

    def __post_init__(self) -> None:
        if len(self.panels) < 2:
            raise ValueError(f"A guide needs at least 2 panels, got {len(self.panels)}.")
        if self.panels[0].arc_length != 0.0 or np.any(np.diff(self.arc_lengths) <= 0):
            raise ValueError("The panels' arc lengths must start at 0 and rise.")

    @property
    def length(self) -> float:
        """Metres from the first panel to the last."""
        return self.panels[-1].arc_length

    @cached_property
    def centres(self) -> Array:
        """(P, 3) panel centres, m."""
        return np.array([panel.centre for panel in self.panels])

    @cached_property
    def normals(self) -> Array:
        """(P, 3) panel normals."""
        return np.array([panel.normal for panel in self.panels])

    @cached_property
    def arc_lengths(self) -> Array:
        """(P,) arc length of the panels, m."""
        return np.array([panel.arc_length for panel in self.panels])

    @cached_property
    def radii(self) -> Array:
        """(P,) distance from a panel's centre to the farthest point of its outline, m."""
        return np.array([np.linalg.norm(panel.polygon - panel.centre, axis=1).max() for panel in self.panels])

    @property
    def num_gates(self) -> int:
        """Number of stretches between panels."""
        return len(self.panels) - 1

    def locate(self, position: Array, field: DistanceField | None = None) -> int:
        """Return the gate of a (3,) world position that was not tracked before.

        With a field, it is the gate where the way through the water from there meets the centreline, which is right in
        side passages and dead ends, too. Without one, it is that of the nearest centreline point, be it behind rock.
        """
        nearest = None if field is None else nearest_through_water(position, self.centreline, field)
        if nearest is None:
            nearest = int(np.argmin(np.linalg.norm(self.centreline - position, axis=1)))
        passed = int(np.searchsorted(self._stations, nearest, side="right")) - 1
        return int(np.clip(passed, 0, self.num_gates - 1))

    def track(self, position: Array, gate: int) -> int:
        """Return the gate after a small move to a (3,) world position from somewhere in `gate`.

        The gate changes where the vehicle passes through a panel's outline, of whatever panel: in a dead end that runs
        beside the route it stays, and behind a loop it is found again where the route goes on.
        """
        return int(_track(np.asarray(position, dtype=np.float64), gate, *self._tracked))

    def follow(self, position: Array, gate: int) -> tuple[int, float]:
        """Return `track` and, in that gate, `remaining`: one call for both."""
        gate, remaining = _follow(position, gate, self._arcs, *self._tracked)
        return gate, remaining

    def progress(self, position: Array, gate: int) -> float:
        """Return the metres along the guide, in [0, length], of a (3,) world position in `gate`."""
        return float(_progress(position, gate, self.centres, self.normals, self._arcs))

    def remaining(self, position: Array, gate: int) -> float:
        """Return the metres still to go to the last panel, in [0, length]."""
        return self.length - self.progress(position, gate)

    @cached_property
    def _stations(self) -> IntArray:
        """(P,) centreline points at the panels."""
        return np.array([np.argmin(np.linalg.norm(self.centreline - centre, axis=1)) for centre in self.centres])

    @cached_property
    def outlines(self) -> tuple[Array, IntArray]:
        """(K, 2) corners of all outlines in their panels' planes, m, and the (P,) ends of each in them."""
        flat = [(panel.polygon - panel.centre) @ axes.T for panel, axes in zip(self.panels, self.axes, strict=True)]
        return np.concatenate(flat), np.cumsum([len(outline) for outline in flat])

    @cached_property
    def axes(self) -> Array:
        """(P, 2, 3) unit vectors in the panels' planes, across each other."""
        return np.array([_across(normal) for normal in self.normals])

    @cached_property
    def _arcs(self) -> Array:
        """(P - 1, ARC_SAMPLES + 1) progress at even shares of the angle in each gate, m: even along the centreline."""
        rows = []
        for gate, (first, last) in enumerate(pairwise(np.maximum.accumulate(self._stations))):
            points = self.centreline[first : last + 1]
            walked = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
            if len(points) < 2 or walked[-1] == 0.0:
                points, walked = self.centres[gate : gate + 2], np.array([0.0, 1.0])
            shares = np.array([_share(point, gate, self.centres, self.normals) for point in points])
            shares[0], shares[-1] = 0.0, 1.0
            even = np.interp(np.linspace(0, 1, ARC_SAMPLES + 1), np.maximum.accumulate(shares), walked / walked[-1])
            rows.append(self.arc_lengths[gate] + even * (self.arc_lengths[gate + 1] - self.arc_lengths[gate]))
        return np.array(rows)

    @cached_property
    def _tracked(self) -> tuple[Array | IntArray, ...]:
        """What the compiled functions read."""
        return self.centres, self.normals, self.axes, self.radii, *self.outlines


def _across(normal: Array) -> Array:
    """Return two unit vectors across a normal and each other."""
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])


@numba.njit(cache=True)
def _follow(position, gate, arcs, centres, normals, axes, radii, corners, ends):  # type: ignore[no-untyped-def]
    gate = _track(position, gate, centres, normals, axes, radii, corners, ends)
    return gate, arcs[-1, -1] - _progress(position, gate, centres, normals, arcs)


@numba.njit(cache=True)
def _track(position, gate, centres, normals, axes, radii, corners, ends):  # type: ignore[no-untyped-def]
    """Return the gate beside the nearest panel that the position is in; the old one where it is in none."""
    nearest, is_beyond, caught = CATCH, False, -1
    for panel in range(len(centres)):
        x, y, z = position[0] - centres[panel, 0], position[1] - centres[panel, 1], position[2] - centres[panel, 2]
        along = x * normals[panel, 0] + y * normals[panel, 1] + z * normals[panel, 2]
        reach = radii[panel] + CATCH
        if abs(along) <= nearest and x * x + y * y + z * z <= reach * reach:
            if is_in_outline(x, y, z, panel, axes, corners, ends):
                nearest, is_beyond, caught = abs(along), along >= 0.0, panel
    if caught >= 0:
        return min(max(caught if is_beyond else caught - 1, 0), len(centres) - 2)
    return gate


@numba.njit(cache=True)
def is_in_outline(x, y, z, panel, axes, corners, ends):  # type: ignore[no-untyped-def]
    """Return whether an offset from a panel's centre, seen along its normal, lies in its outline (even-odd rule)."""
    u = x * axes[panel, 0, 0] + y * axes[panel, 0, 1] + z * axes[panel, 0, 2]
    v = x * axes[panel, 1, 0] + y * axes[panel, 1, 1] + z * axes[panel, 1, 2]
    start = ends[panel - 1] if panel > 0 else 0
    before, is_inside = ends[panel] - 1, False
    for n in range(start, ends[panel]):
        if (corners[before, 1] > v) != (corners[n, 1] > v):
            share = (v - corners[before, 1]) / (corners[n, 1] - corners[before, 1])
            if u < corners[before, 0] + share * (corners[n, 0] - corners[before, 0]):
                is_inside = not is_inside
        before = n
    return is_inside


@numba.njit(cache=True)
def _progress(position, gate, centres, normals, arcs):  # type: ignore[no-untyped-def]
    """Return the metres along the guide."""
    place = _share(position, gate, centres, normals) * (arcs.shape[1] - 1)
    n = min(int(place), arcs.shape[1] - 2)
    return arcs[gate, n] + (place - n) * (arcs[gate, n + 1] - arcs[gate, n])


@numba.njit(cache=True)
def _share(position, gate, centres, normals):  # type: ignore[no-untyped-def]
    """Return how much of the angle between a gate's two planes lies behind a position; of the distance, if parallel."""
    behind, ahead, cosine = 0.0, 0.0, 0.0
    for axis in range(3):
        behind += (position[axis] - centres[gate, axis]) * normals[gate, axis]
        ahead += (centres[gate + 1, axis] - position[axis]) * normals[gate + 1, axis]
        cosine += normals[gate, axis] * normals[gate + 1, axis]
    behind, ahead = max(behind, 0.0), max(ahead, 0.0)
    if behind + ahead == 0.0:
        return 1.0
    if cosine > PARALLEL:
        return behind / (behind + ahead)
    sine = np.sqrt(max(1.0 - cosine * cosine, 0.0))
    return min(np.arctan2(behind * sine, ahead + behind * cosine) / np.arccos(max(cosine, -1.0)), 1.0)
