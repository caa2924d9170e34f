"""The guide: panels across the passage that measure progress along it (the original's DistanceRewarder).

The original adds the distance to the next panel's centre to the chain of centres behind it. That jumps when a panel
is crossed off its centre, and its nearest-panel rule jumps at loops. Here progress between two panels is interpolated
by the distances to their planes, so that it is continuous at every panel, and a vehicle only changes its gate (the
stretch between two panels) by passing through a panel, forwards or backwards.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np

from aquanav_tools.cave.water.field import DistanceField
from aquanav_tools.cave.water.flood import nearest_through_water
from aquanav_tools.types import Array, IntArray

CATCH = 0.25
"""A lost vehicle within this distance of a panel is found again, m: more than a step at 2 m/s and ten decisions per
second, less than the rock between two passages."""


@dataclass(frozen=True, eq=False)
class Panel:
    """A flat gate across the passage."""

    centre: Array
    """(3,) point of the centreline, m."""
    normal: Array
    """(3,) unit vector along the direction of travel."""
    polygon: Array
    """(K, 3) outline of the cross-section, m."""
    arc_length: float
    """Distance along the centreline from the first panel, m."""
    clearance: float
    """Clearance at the centre, m."""


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

        A panel counts as crossed where its outline is: within its radius of its centre. A vehicle that has left its
        gate sideways, through a loop or around a pillar, is found again where it passes through a panel's outline.
        """
        corners, ends = self.outlines
        arrays = self.centres, self.normals, self._reach, corners, ends
        return int(_track(np.asarray(position, dtype=np.float64), gate, *arrays))

    def progress(self, position: Array, gate: int) -> float:
        """Return the metres along the guide, in [0, length], of a (3,) world position in `gate`."""
        return float(_progress(position, gate, self.centres, self.normals, self.arc_lengths))

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
        flat = [(panel.polygon - panel.centre) @ _plane(panel.normal).T for panel in self.panels]
        return np.concatenate(flat), np.cumsum([len(outline) for outline in flat])

    @cached_property
    def _reach(self) -> Array:
        """(P,) distance from a panel's centre within which its plane means something, m: its outline and one gate."""
        spacing = np.diff(self.arc_lengths)
        return self.radii + np.append(spacing, spacing[-1])


def _plane(normal: Array) -> Array:
    """Return two unit vectors across a normal."""
    return np.stack(across(np.asarray(normal, dtype=np.float64)))


@numba.njit(cache=True)
def across(normal):  # type: ignore[no-untyped-def]
    """Return two unit vectors across a normal and each other."""
    helper = np.zeros(3)
    helper[np.argmin(np.abs(normal))] = 1.0
    first = np.cross(normal, helper)
    first /= np.sqrt((first * first).sum())
    return first, np.cross(normal, first)


@numba.njit(cache=True)
def _track(position, gate, centres, normals, reach, corners, ends):  # type: ignore[no-untyped-def]
    while gate < len(centres) - 2 and _is_past(position, centres[gate + 1], normals[gate + 1], reach[gate + 1], 1.0):
        gate += 1
    while gate > 0 and _is_past(position, centres[gate], normals[gate], reach[gate], -1.0):
        gate -= 1
    if _is_far(position, centres[gate], reach[gate]) and _is_far(position, centres[gate + 1], reach[gate + 1]):
        return _found_again(position, gate, centres, normals, corners, ends)
    return gate


@numba.njit(cache=True)
def _is_far(position, centre, reach):  # type: ignore[no-untyped-def]
    x, y, z = position[0] - centre[0], position[1] - centre[1], position[2] - centre[2]
    return x * x + y * y + z * z > reach * reach


@numba.njit(cache=True)
def _found_again(position, gate, centres, normals, corners, ends):  # type: ignore[no-untyped-def]
    """Return the gate beside the panel that a position is in, within CATCH of its plane; the same gate if in none."""
    for panel in range(len(centres)):
        offset = position - centres[panel]
        along = (offset * normals[panel]).sum()
        if abs(along) > CATCH:
            continue
        first, second = across(normals[panel])
        start = ends[panel - 1] if panel > 0 else 0
        if is_inside((offset * first).sum(), (offset * second).sum(), corners[start : ends[panel]]):
            return min(max(panel if along >= 0.0 else panel - 1, 0), len(centres) - 2)
    return gate


@numba.njit(cache=True)
def is_inside(u, v, outline):  # type: ignore[no-untyped-def]
    """Return whether a point of the plane is inside a closed polygon (even-odd rule)."""
    is_inside = False
    for n in range(len(outline)):
        a, b = outline[n - 1], outline[n]
        if (a[1] > v) != (b[1] > v) and u < a[0] + (v - a[1]) / (b[1] - a[1]) * (b[0] - a[0]):
            is_inside = not is_inside
    return is_inside


@numba.njit(cache=True)
def _is_past(position, centre, normal, reach, direction):  # type: ignore[no-untyped-def]
    """Return whether a position near a panel lies beyond it (direction 1) or strictly before it (-1)."""
    x, y, z = position[0] - centre[0], position[1] - centre[1], position[2] - centre[2]
    along = x * normal[0] + y * normal[1] + z * normal[2]
    is_past = along >= 0.0 if direction > 0.0 else along < 0.0
    return is_past and x * x + y * y + z * z <= reach * reach


@numba.njit(cache=True)
def _progress(position, gate, centres, normals, arc_lengths):  # type: ignore[no-untyped-def]
    behind, ahead = 0.0, 0.0
    for axis in range(3):
        behind += (position[axis] - centres[gate, axis]) * normals[gate, axis]
        ahead += (centres[gate + 1, axis] - position[axis]) * normals[gate + 1, axis]
    behind, ahead = max(behind, 0.0), max(ahead, 0.0)
    share = behind / (behind + ahead) if behind + ahead > 0.0 else 1.0
    return arc_lengths[gate] + share * (arc_lengths[gate + 1] - arc_lengths[gate])
