"""The vehicle's capsule against the distance field: how far its hull is from the wall.

The capsule's axis lies along body x, so its hull is as far from the wall as the nearest point of the axis, less the
radius. The axis is sampled at its ends and its middle, which misses at most a quarter of its length.
"""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.geometry.volume.field import interpolate


@numba.njit(cache=True)
def hull_clearance(state, half_axis, radius, bricks, samples, origin, spacing):  # type: ignore[no-untyped-def]
    """Return the distance from the capsule's hull to the nearest wall, m; negative when it overlaps.

    Args:
        state: (13,) position, quaternion, velocity.
        half_axis: Half the length of the capsule's cylinder, m.
        radius: Radius of the capsule, m.
        bricks: Of a DistanceField.
        samples: Of a DistanceField, m.
        origin: (3,) position of its first sample, m.
        spacing: Distance between its samples, m.
    """
    x, y, z = _nose_offset(state, half_axis)
    nearest = np.inf
    for share in (-1.0, 0.0, 1.0):
        clearance = interpolate(
            bricks, samples, origin, spacing, state[0] + share * x, state[1] + share * y, state[2] + share * z
        )
        nearest = min(nearest, clearance)
    return nearest - radius


@numba.njit(cache=True)
def _nose_offset(state, half_axis):  # type: ignore[no-untyped-def]
    """Return the axis's front end relative to the centre, in the world."""
    w, x, y, z = state[3], state[4], state[5], state[6]
    return (
        half_axis * (1.0 - 2.0 * (y * y + z * z)),
        half_axis * 2.0 * (x * y + z * w),
        half_axis * 2.0 * (x * z - y * w),
    )
