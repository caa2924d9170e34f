"""The original's DistanceRewarder, for parity: a chain of panel centres.

The distance to go is that to the centre of the first panel not yet crossed, and from there along the centres to the
last one. When the vehicle has left a panel that it touched, on whichever side, the panel whose centre is nearest to it
(the last one never) and all before it count as crossed, for the rest of the episode.

The distance jumps where a panel is crossed off its centre, going back through a panel crosses it, and a panel of
another passage crosses those before it. `guide` has none of this and is what measures progress by default.
"""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.cave.route.guide import Guide, is_in_outline
from aquanav_tools.types import Array, Capsule


class PanelChain:
    """The chain of a guide's panels, and how far along it one vehicle is."""

    def __init__(self, guide: Guide, capsule: Capsule) -> None:
        self.num_crossed = 0
        """Panels crossed so far."""
        self._touched = np.zeros(len(guide.panels), dtype=np.bool_)
        steps = np.linalg.norm(np.diff(guide.centres, axis=0), axis=1)
        self._to_go: Array = np.append(np.cumsum(steps[::-1])[::-1], 0.0)
        self._panels = guide.centres, guide.normals, guide.axes, *guide.outlines
        self._hull = 0.5 * capsule.axis_length, capsule.radius

    def reset(self) -> None:
        """Forget all crossings."""
        self.num_crossed = 0
        self._touched[:] = False

    def follow(self, position: Array, ahead: Array) -> float:
        """Take note of the panels that a vehicle touches or has left, and return its distance to go, m.

        Args:
            position: (3,) of its middle, world, m.
            ahead: (3,) unit vector along its axis, world.
        """
        self.num_crossed = int(_cross(position, ahead, *self._hull, self.num_crossed, self._touched, *self._panels))
        following = self._panels[0][self.num_crossed]
        return float(np.linalg.norm(following - position) + self._to_go[self.num_crossed])


@numba.njit(cache=True)
def _cross(position, ahead, half_axis, radius, num_crossed, touched, centres, normals, axes, corners, ends):  # type: ignore[no-untyped-def]
    """Return how many panels are crossed now; `touched` keeps which ones the capsule touches."""
    for panel in range(len(centres)):
        normal = normals[panel]
        offset = position - centres[panel]
        along, reach = (offset * normal).sum(), half_axis * abs((ahead * normal).sum()) + radius
        is_touched = False
        if abs(along) <= reach:
            is_touched = is_in_outline(offset[0], offset[1], offset[2], panel, axes, corners, ends)
        if touched[panel] and not is_touched:
            num_crossed = max(num_crossed, _nearest(position, centres[:-1]) + 1)
        touched[panel] = is_touched
    return num_crossed


@numba.njit(cache=True)
def _nearest(position, centres):  # type: ignore[no-untyped-def]
    nearest, least = 0, np.inf
    for n in range(len(centres)):
        apart = ((centres[n] - position) ** 2).sum()
        if apart < least:
            nearest, least = n, apart
    return nearest
