"""The vehicle's 28 range rays, in the original benchmark's pattern.

The original has four fans of rays over the frontal 180 degrees. A ray runs from the vehicle's middle to a point
`reach` away in the horizontal and `rise` above, all scaled by 0.25; within a fan the order is straight ahead, then
right and left alternately. Distances end at the ray's length when nothing is hit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.types import Array

NOTHING, WALL, START_WALL, UNTAGGED = range(4)
"""Tags of what the original's rays meet."""
SCALE = 0.25
"""The original's vehicle is drawn at a quarter of its size, and its rays with it."""
BOAT_REACH, BOAT_RADIUS = 30.0, 1.0
"""Rays of the original's boat and their spheres, m."""
SPHERE_RADIUS = 0.5
"""The original casts spheres of this radius, before scaling, m; their scale is that of the whole ray to its reach."""


@dataclass(frozen=True)
class Fan:
    """Rays over the frontal half plane, all with the same elevation."""

    num_per_side: int
    """Rays on either side of the one straight ahead."""
    reach: float
    """Horizontal extent before scaling, m."""
    rise: float
    """Vertical extent before scaling, m."""

    @property
    def num_rays(self) -> int:
        """On both sides, and the one straight ahead."""
        return 2 * self.num_per_side + 1


FANS = (Fan(4, 15.0, 4.0), Fan(4, 15.0, -4.0), Fan(2, 7.0, -8.0), Fan(2, 7.0, 8.0))
"""The original's sensors 0 to 3, elevation 14.9, -14.9, -48.8 and 48.8 degrees."""


@dataclass(frozen=True, eq=False)
class RayPattern:
    """Where the rays point."""

    directions: Array
    """(R, 3) unit vectors, body frame."""
    lengths: Array
    """(R,) m."""
    radii: Array
    """(R,) of the spheres that the original casts along the rays, m."""


def original_pattern() -> RayPattern:
    """Return the original's 28 rays."""
    ends = np.concatenate([_fan_ends(fan) for fan in FANS])
    lengths = np.linalg.norm(ends, axis=1)
    reaches = np.repeat([fan.reach for fan in FANS], [fan.num_rays for fan in FANS])
    return RayPattern(ends / lengths[:, None], lengths, SPHERE_RADIUS * lengths / reaches)


def boat_pattern() -> RayPattern:
    """Return the 7 level rays of the original's boat, which is drawn at twice its size."""
    azimuth = _azimuths(3)
    directions = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(azimuth.shape)], axis=1)
    return RayPattern(directions, np.full(7, BOAT_REACH), np.full(7, BOAT_RADIUS))


def _fan_ends(fan: Fan) -> Array:
    """Return the (2 * num_per_side + 1, 3) ends of a fan's rays relative to the vehicle, body frame, m."""
    azimuth = _azimuths(fan.num_per_side)
    ends = np.stack(
        [fan.reach * np.cos(azimuth), fan.reach * np.sin(azimuth), np.full(azimuth.shape, fan.rise)], axis=1
    )
    return SCALE * ends


def _azimuths(num_per_side: int) -> Array:
    """Return the (2 * num_per_side + 1,) angles of a fan: straight ahead, then right and left alternately, rad."""
    sides = np.radians(90.0) * np.arange(1, num_per_side + 1) / num_per_side
    return np.concatenate([[0.0], np.stack([-sides, sides], axis=1).ravel()])  # left is positive
