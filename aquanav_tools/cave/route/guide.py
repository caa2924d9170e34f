"""The guide: panels across the passage along which progress is measured (the original's DistanceRewarder).

It is what a scenario keeps of the route. How far a vehicle has come by it is in `sim/batch/guide.py`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from aquanav_tools.geometry.volume.breadth_first import nearest_through_water
from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.types import Array, IntArray


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
        passed = int(np.searchsorted(self.stations, nearest, side="right")) - 1
        return int(np.clip(passed, 0, self.num_gates - 1))

    @cached_property
    def stations(self) -> IntArray:
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


def _across(normal: Array) -> Array:
    """Return two unit vectors across a normal and each other."""
    first = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)])
