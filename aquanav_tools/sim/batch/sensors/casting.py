"""What sensors see: the walls of each vehicle's cave, met by rays through the distance field or the mesh."""

from __future__ import annotations

from typing import Any

import warp as wp

from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.sim.batch.field import Grid, make_grid, on_grid, room_at, traced
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.batch.water import sloping_room
from aquanav_tools.types import Mesh

wp.set_module_options(OPTIONS)


@wp.struct
class Walls:
    """A cave's walls, and the height from which depth counts."""

    grid: Grid
    ray_wall: wp.uint64
    """Mesh about `middle` that exact rays meet; 0 where they are traced through the grid."""
    middle: wp.vec3d
    entrance_height: wp.float64
    """m."""


def make_walls(scenario: Scenario, device: Any, mesh: Any = None) -> Walls:
    """Return a scenario's walls on a device; rays go to `mesh` (a `wp.Mesh` of `upload_mesh`) where there is one."""
    walls = Walls()
    walls.grid = make_grid(scenario.field, device)
    walls.middle = wp.vec3d(*scenario.cavity.mesh.vertices.mean(axis=0))
    walls.ray_wall = wp.uint64(0) if mesh is None else mesh.id
    walls.entrance_height = float(scenario.guide.centres[0][2])
    return walls


def upload_mesh(mesh: Mesh, device: Any) -> Any:
    """Return a `wp.Mesh` moved so that its middle is at the origin, as Warp's meshes are in float32."""
    points = wp.array((mesh.vertices - mesh.vertices.mean(axis=0)).astype("float32"), dtype=wp.vec3, device=device)
    return wp.Mesh(points, wp.array(mesh.faces.ravel().astype("int32"), dtype=wp.int32, device=device))


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
def origin_of(walls: Walls, position: wp.vec3d):
    """Return a place in the water as the origin of rays."""
    origin = Origin()
    origin.position = position
    if walls.ray_wall != wp.uint64(0):
        origin.centre = wp.vec3(position - walls.middle)
    else:
        origin.place = on_grid(walls.grid, position)
        origin.room = room_at(walls.grid, origin.place)
    return origin


@wp.func
def cast(walls: Walls, origin: Origin, way: wp.vec3, length: float):
    """Return how far a ray comes, at most `length` (m), and the normal of the face it meets, where rays go to a mesh.

    The normal is zero where rays go through the field; `cosine_at` finds it there.
    """
    distance = length
    normal = wp.vec3()
    if walls.ray_wall != wp.uint64(0):
        hit = wp.mesh_query_ray(walls.ray_wall, origin.centre, way, length)
        if hit.result:
            distance = hit.t
            normal = hit.normal
    else:
        spacing = float(walls.grid.spacing)
        distance = spacing * traced(walls.grid, origin.place, way, length / spacing, origin.room)
    return distance, normal


@wp.func
def normal_at(walls: Walls, origin: Origin, way: wp.vec3, distance: float, normal: wp.vec3):
    """Return the unit normal of the wall that a ray met, out of the wall, towards where the ray came from.

    In the field it is where the clearance grows. A ray that met a place where this has no direction has met it head on.
    """
    found = normal
    if walls.ray_wall == wp.uint64(0):
        _, away = sloping_room(walls.grid, origin.position + wp.float64(distance) * wp.vec3d(way))
        found = wp.vec3(away)
    size = wp.length(found)
    if size < 1.0e-6:
        return -way
    found = found / size
    if wp.dot(found, way) > 0.0:
        found = -found
    return found
