"""The vehicle's capsule against the distance field: how far its hull is from the wall, and moving while that is far.

The capsule's axis lies along body x, so its hull is as far from the wall as the nearest point of the axis, less the
radius. The axis is sampled at its ends and its middle, which misses at most a quarter of its length.
"""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.cave.water.field import interpolate
from aquanav_tools.sim.motion import advance


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
def glide(state, wrenches, first, current, parameters, dt, half_axis, reach, bricks, samples, origin, spacing, after):  # type: ignore[no-untyped-def]
    """Advance `state` in place through wrenches[first:] for as long as the hull stays clear of the wall.

    Args:
        state: (13,) position, quaternion, velocity over ground in the body frame.
        wrenches: (N, 6) wrench per step, body frame.
        first: Index of the first wrench to apply.
        current: (3,) velocity of the water, world frame, m/s.
        parameters: (20,) from `hydrodynamics.pack_parameters`.
        dt: Step, s.
        half_axis: Half the length of the capsule's cylinder, m.
        reach: A step is taken only when the axis keeps farther than this from the wall all the way, m.
        bricks: Of a DistanceField.
        samples: Of a DistanceField, m.
        origin: (3,) position of its first sample, m.
        spacing: Distance between its samples, m.
        after: (13,) receives the state where the step that was not taken would lead were there no wall.

    Returns:
        The index of the first wrench that was not applied; N when all were.
    """
    for index in range(first, len(wrenches)):
        after[:] = advance(state, wrenches[index], current, parameters, dt)
        room = hull_clearance(state, half_axis, reach, bricks, samples, origin, spacing)
        if room <= _largest_move(state, after, half_axis):
            return index
        state[:] = after
    return len(wrenches)


@numba.njit(cache=True)
def _largest_move(before, after, half_axis):  # type: ignore[no-untyped-def]
    """Return how far an end of the capsule's axis moves, m; no point of the axis moves farther."""
    ax, ay, az = _nose_offset(before, half_axis)
    bx, by, bz = _nose_offset(after, half_axis)
    dx, dy, dz = after[0] - before[0], after[1] - before[1], after[2] - before[2]
    nose = (dx + bx - ax) ** 2 + (dy + by - ay) ** 2 + (dz + bz - az) ** 2
    tail = (dx - bx + ax) ** 2 + (dy - by + ay) ** 2 + (dz - bz + az) ** 2
    return np.sqrt(max(nose, tail))


@numba.njit(cache=True)
def _nose_offset(state, half_axis):  # type: ignore[no-untyped-def]
    """Return the axis's front end relative to the centre, in the world."""
    w, x, y, z = state[3], state[4], state[5], state[6]
    return (
        half_axis * (1.0 - 2.0 * (y * y + z * z)),
        half_axis * 2.0 * (x * y + z * w),
        half_axis * 2.0 * (x * z - y * w),
    )
