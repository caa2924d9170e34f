"""Rays: through the distance field, or to the mesh."""

from __future__ import annotations

import warp as wp

from aquanav_tools.sim.batch.caves import Cave
from aquanav_tools.sim.batch.eddies import sloping_room
from aquanav_tools.sim.batch.field import TURNS, mat_turns, on_grid, room_at, traced, traced_in_turns, vec_turns
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.wall_rays import face_normal, meet_wall

wp.set_module_options(OPTIONS)


@wp.struct
class Origin:
    """Where rays start, prepared once for all of them."""

    place: wp.vec3
    """In spacings of the field."""
    room: wp.float32
    """Clearance there, spacings."""
    centre: wp.vec3
    """m, from the mesh's middle."""
    position: wp.vec3d
    """World, m."""


@wp.func
def origin_of(cave: Cave, position: wp.vec3d):
    """Return a place in the water as the origin of rays."""
    origin = Origin()
    origin.position = position
    origin.centre = wp.vec3(position - cave.middle)
    origin.place = on_grid(cave.grid, position)
    origin.room = room_at(cave.grid, origin.place)
    return origin


@wp.func
def cast_ray(cave: Cave, origin: Origin, direction: wp.vec3, length: float):
    """Return how far a ray comes, at most `length` (m), and the normal of the face it meets, where rays go to a mesh.

    The normal is zero where rays go through the field; `normal_at` finds it there.
    """
    distance = float(length)
    normal = wp.vec3()
    if cave.ray_wall.starts.shape[0] > 0:
        met = meet_wall(cave.ray_wall, cave.grid, origin.place, origin.room, origin.centre, direction, length)
        distance = met.distance
        normal = face_normal(cave.ray_wall, met)
    else:
        spacing = float(cave.grid.spacing)
        distance = spacing * traced(cave.grid, origin.place, direction, length * (1.0 / spacing), origin.room)
    return distance, normal


@wp.func
def cast_in_turns(cave: Cave, origin: Origin, directions: mat_turns, lengths: vec_turns):
    """Return how far many rays come, each as by `cast_ray`; one of length zero is none."""
    if cave.ray_wall.starts.shape[0] == 0:
        spacing = float(cave.grid.spacing)
        inverse = 1.0 / spacing
        return spacing * traced_in_turns(cave.grid, origin.place, directions, lengths * inverse, origin.room)
    come = lengths
    for k in range(TURNS):
        if lengths[k] > 0.0:
            met = meet_wall(
                cave.ray_wall, cave.grid, origin.place, origin.room, origin.centre, directions[k], lengths[k]
            )
            come[k] = met.distance
    return come


@wp.func
def normal_at(cave: Cave, origin: Origin, direction: wp.vec3, distance: float, normal: wp.vec3):
    """Return the unit normal of the wall that a ray met, out of the wall, towards where the ray came from.

    Where no face is known, it is where the clearance grows. A ray that met a place where this has no direction has met
    it head on.
    """
    found = normal
    if wp.length_sq(found) == 0.0:
        _, away = sloping_room(cave.grid, origin.position + wp.float64(distance) * wp.vec3d(direction))
        found = wp.vec3(away)
    size = wp.length(found)
    if size < 1.0e-6:
        return -direction
    found = found / size
    if wp.dot(found, direction) > 0.0:
        found = -found
    return found
