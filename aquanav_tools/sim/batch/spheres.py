"""The original's range sensor in Warp: a sphere is cast along each ray, and what it meets is told by a tag.

A sphere that leaves the vehicle's middle is stopped by the wall as soon as the clearance of its centre is its radius,
so it is traced through the distance field: each step goes as far as nothing can be met.

The original tags the cave's wall and a wall behind its start; what else a ray meets (the box around its goal) has no
tag. Here the portal where the guide begins stands for the wall behind the start, and any other portal has no tag.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.sim import sensors
from aquanav_tools.sim.batch.field import Grid, clearance_at
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
NOTHING, WALL, START_WALL, UNTAGGED = (
    wp.constant(tag) for tag in (sensors.NOTHING, sensors.WALL, sensors.START_WALL, sensors.UNTAGGED)
)
MIN_STEP = wp.constant(wp.float64(0.1))
"""Least step of a sphere along the wall, spacings of the field; one that slips by in it has hardly touched."""


@wp.struct
class Ends:
    """The portals of a cave as discs."""

    centres: wp.array(dtype=wp.vec3d)
    normals: wp.array(dtype=wp.vec3d)
    """Out of the water."""
    reaches: wp.array(dtype=f64)
    """From the centre to the farthest corner, m."""
    tags: wp.array(dtype=wp.int32)
    """START_WALL or UNTAGGED."""


def make_ends(cavity: Cavity, entrance: Array, goal: Array, device: Any) -> Ends:
    """Return a cavity's portals; one nearer to the (3,) entrance than to the goal is a wall behind the start."""
    mesh, portals = cavity.mesh, cavity.portals
    centres = np.array([portal.centre for portal in portals]).reshape(-1, 3)
    normals = np.array([portal.normal for portal in portals]).reshape(-1, 3)
    reaches = []
    for portal in portals:
        corners = mesh.vertices[np.unique(mesh.faces[cavity.labels == portal.label])]
        reaches.append(float(np.linalg.norm(corners - portal.centre, axis=1).max()))
    is_start = np.linalg.norm(centres - entrance, axis=1) < np.linalg.norm(centres - goal, axis=1)
    ends = Ends()
    ends.centres = wp.array(centres, dtype=wp.vec3d, device=device)
    ends.normals = wp.array(normals, dtype=wp.vec3d, device=device)
    ends.reaches = wp.array(np.array(reaches), dtype=wp.float64, device=device)
    ends.tags = wp.array(np.where(is_start, int(START_WALL), int(UNTAGGED)), dtype=wp.int32, device=device)
    return ends


@wp.func
def cast(grid: Grid, start: wp.vec3d, direction: wp.vec3d, length: f64, radius: f64):
    """Return how far a sphere's centre comes until it touches, m; twice the length when that is beyond `length`."""
    along, step, before = f64(0.0), f64(0.0), f64(0.0)
    distance = f64(2.0) * length
    while along < length:
        room = clearance_at(grid, start + along * direction) - radius
        if room <= f64(0.0):
            distance = along
            if along > f64(0.0):
                distance -= step * (room / (room - before))
            break
        step = wp.max(room, MIN_STEP * grid.spacing)
        before = room
        along += step
    return distance


@wp.func
def tag_at(place: wp.vec3d, reach: f64, ends: Ends):
    """Return the tag of what touches a sphere at `place` whose surface is `reach` away at most."""
    tag = int(WALL)
    for n in range(ends.tags.shape[0]):
        offset = ends.centres[n] - place
        beyond = wp.dot(offset, ends.normals[n])
        if beyond <= reach and wp.dot(offset, offset) - beyond * beyond <= ends.reaches[n] * ends.reaches[n]:
            tag = ends.tags[n]
            break
    return tag
