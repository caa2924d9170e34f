"""The original's range sensor: a sphere is cast along each ray, and what it meets is told by a tag.

A sphere that leaves the vehicle's middle is stopped by the wall as soon as the clearance of its centre is its radius,
so it is traced through the distance field: each step goes as far as nothing can be met.

The original tags the cave's wall and a wall behind its start; what else a ray meets (the box around its goal) has no
tag. Here the portal where the guide begins stands for the wall behind the start, and any other portal has no tag.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.cavity import Cavity
from aquanav_tools.cave.water.field import DistanceField, interpolate
from aquanav_tools.sim.rotation import rotation_rows
from aquanav_tools.sim.sensors import RayPattern
from aquanav_tools.types import Array

NOTHING, WALL, START_WALL, UNTAGGED = range(4)
MIN_STEP = 0.1
"""Least step of a sphere along the wall, spacings of the field; one that slips by in it has hardly touched."""


class Ends(NamedTuple):
    """The portals of a cave as discs."""

    centres: Array
    """(K, 3) m."""
    normals: Array
    """(K, 3) out of the water."""
    reaches: Array
    """(K,) from the centre to the farthest corner, m."""
    tags: npt.NDArray[np.int64]
    """(K,) START_WALL or UNTAGGED."""


def find_ends(cavity: Cavity, entrance: Array, goal: Array) -> Ends:
    """Return a cavity's portals; one nearer to the (3,) entrance than to the goal is a wall behind the start."""
    mesh, portals = cavity.mesh, cavity.portals
    centres = np.array([portal.centre for portal in portals]).reshape(-1, 3)
    normals = np.array([portal.normal for portal in portals]).reshape(-1, 3)
    reaches = []
    for portal in portals:
        corners = mesh.vertices[np.unique(mesh.faces[cavity.labels == portal.label])]
        reaches.append(float(np.linalg.norm(corners - portal.centre, axis=1).max()))
    is_start = np.linalg.norm(centres - entrance, axis=1) < np.linalg.norm(centres - goal, axis=1)
    return Ends(centres, normals, np.array(reaches), np.where(is_start, START_WALL, UNTAGGED))


class SphereSensor:
    """Casts the spheres of a pattern through the water."""

    def __init__(self, field: DistanceField, ends: Ends, pattern: RayPattern) -> None:
        self.tags = np.full(len(pattern.lengths), NOTHING)
        """(R,) what the last spheres met: NOTHING, WALL, START_WALL or UNTAGGED."""
        self._grid = field.grid
        self._ends = ends
        self._rays = tuple(np.ascontiguousarray(part) for part in (pattern.directions, pattern.lengths, pattern.radii))

    def sense(self, state: Array) -> npt.NDArray[np.float32]:
        """Return how far each sphere's centre came from a (13,) state, (R,) m; at most the rays' lengths."""
        distances = np.empty(len(self.tags), dtype=np.float32)
        _cast_all(state, *self._rays, *self._ends, *self._grid, distances, self.tags)
        return distances


@numba.njit(cache=True)
def _cast_all(  # type: ignore[no-untyped-def]
    state,
    directions,
    lengths,
    radii,
    centres,
    normals,
    reaches,
    end_tags,
    bricks,
    samples,
    origin,
    spacing,
    distances,
    tags,
):
    """Write how far each sphere comes and what it meets."""
    rotation = rotation_rows(state)
    way, place = np.empty(3), np.empty(3)
    for n in range(len(lengths)):
        for axis in range(3):
            row = rotation[axis]
            way[axis] = row[0] * directions[n, 0] + row[1] * directions[n, 1] + row[2] * directions[n, 2]
        distance = _cast(state, way, lengths[n], radii[n], bricks, samples, origin, spacing)
        distances[n] = min(distance, lengths[n])
        tags[n] = NOTHING
        if distance < lengths[n]:
            for axis in range(3):
                place[axis] = state[axis] + distance * way[axis]
            tags[n] = _tag(place, radii[n] + 0.5 * spacing, centres, normals, reaches, end_tags)


@numba.njit(cache=True)
def _cast(start, way, length, radius, bricks, samples, origin, spacing):  # type: ignore[no-untyped-def]
    """Return how far a sphere's centre comes until it touches, m; inf when that is beyond `length`."""
    along, step, before = 0.0, 0.0, 0.0
    while along < length:
        x, y, z = start[0] + along * way[0], start[1] + along * way[1], start[2] + along * way[2]
        room = interpolate(bricks, samples, origin, spacing, x, y, z) - radius
        if room <= 0.0:
            return along - step * (room / (room - before) if along > 0.0 else 0.0)
        step, before = max(room, MIN_STEP * spacing), room
        along += step
    return np.inf


@numba.njit(cache=True)
def _tag(place, reach, centres, normals, reaches, end_tags):  # type: ignore[no-untyped-def]
    """Return the tag of what touches a sphere at `place` whose surface is `reach` away at most."""
    for k in range(len(end_tags)):
        beyond, apart = 0.0, 0.0
        for axis in range(3):
            offset = centres[k, axis] - place[axis]
            beyond += offset * normals[k, axis]
            apart += offset * offset
        if beyond <= reach and apart - beyond * beyond <= reaches[k] * reaches[k]:
            return end_tags[k]
    return WALL
