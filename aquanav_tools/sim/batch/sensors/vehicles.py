"""The vehicles of a batch as sensors see them, as a structure on the device."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.motion import vec6
from aquanav_tools.sim.batch.runtime import OPTIONS

wp.set_module_options(OPTIONS)


@wp.struct
class Vehicles:
    """One row of each array per vehicle."""

    order: wp.array(dtype=wp.int32)
    """(N,) vehicles in the order in which they are computed."""
    restarted: wp.array(dtype=wp.int32)
    """Whether the last step began an episode."""
    positions: wp.array(dtype=wp.vec3d)
    """World, m."""
    orientations: wp.array(dtype=wp.vec4d)
    """World from body: (w, x, y, z)."""
    velocities: wp.array(dtype=vec6)
    """Over ground, body frame: m/s and rad/s."""
    seeds: wp.array(dtype=wp.int32)
    """Of the episodes: 32 bits each."""
    decisions: wp.array(dtype=wp.int32)
    """Made so far in each episode."""
    cave_of: wp.array(dtype=wp.int32)
    """Index of the cave that each vehicle is in."""


@wp.func
def chosen(vehicles: Vehicles, row: int, only_restarted: int):
    """Return the vehicle that is computed at a row; -1 where it is not asked for."""
    i = vehicles.order[row]
    if only_restarted == 1 and vehicles.restarted[i] == 0:
        return -1
    return i
