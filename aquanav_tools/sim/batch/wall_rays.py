"""Exact rays to the triangles of a cave's wall.

A ray goes through the distance field's cells. Where the field says that no wall can be, it goes on as far as that
holds; in a cell with triangles it tries them all, eight at once. So it needs no tree, down which a ray took half a
microsecond or more: 28 rays take 7 to 9 us so, and 15 to 22 down Warp's own tree, which gives the same to float32's
rounding. Triangles are met by the watertight rule of Woop, Benthin and Wald (Journal of Computer Graphics Techniques 2,
2013): no ray gets through between two that share an edge.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.geometry.volume.cell_triangles import triangles_in_cells
from aquanav_tools.geometry.volume.field import BRICK, BRICK_BITS, DistanceField
from aquanav_tools.sim.batch.field import Grid
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.types import Array, Mesh

wp.set_module_options(OPTIONS)

LANES = 8
"""Triangles in a pack, which a processor tries at once; 16 are as fast."""
Pack = wp.types.matrix(shape=(9, LANES), dtype=wp.float32)
"""Corners x, y, z of the first, then of the second and the third corner, m from the meshes' middle; one triangle per
column, and what is left of it at one point, which no ray meets."""
SLACK = wp.constant(1.0)
"""Spacings by which a wall can be nearer than the field says: sqrt(3) / 2 by which it errs at most between samples
(`cave.water.field`), and what rounding adds."""
MARGIN = 0.02
"""Spacings by which cells are taken larger, so that neither rounding nor the next leaves out a wall between two."""
CROSSING = wp.constant(1e-3)
"""Spacings that a ray goes on beyond a cell's end, into the next one."""
BITS = wp.constant(BRICK_BITS)
MASK = wp.constant(BRICK - 1)
CELL_BITS = wp.constant(2)
CELL = 1 << int(CELL_BITS)
"""Spacings along a cell's edge, 8 cells to a brick; cells of 2 hold twice as many triangles and take longer."""
CELL_EDGE = wp.constant(float(CELL))


@wp.struct
class Wall:
    """A cave's wall for exact rays; without cells where there are none."""

    starts: wp.array(dtype=wp.int32)
    """(C + 1,) first pack of each cell of the field."""
    packs: wp.array(dtype=Pack)
    free: wp.array(dtype=wp.float32)
    """(C,) spacings from anywhere in a cell in which no wall can be; negative where its triangles are tried."""


def make_wall(mesh: Mesh, field: DistanceField, middle: Array, device: Any) -> Wall:
    """Return a wall on a device.

    Args:
        mesh: The wall.
        field: Its distance field.
        middle: (3,) where the mesh's origin is to be, world, m: rays are in float32.
        device: Warp's.

    Raises:
        MeshError: mesh and field are not of the same cave.
    """
    firsts, members = triangles_in_cells(mesh, field, CELL, MARGIN)
    counts = np.diff(firsts)
    starts = np.concatenate([[0], np.cumsum(-(-counts // LANES))])
    places = np.arange(len(members)) - np.repeat(firsts[:-1], counts)
    rows = np.repeat(starts[:-1], counts) + places // LANES
    packs = np.zeros((max(starts[-1], 1), 9, LANES), dtype=np.float32)
    packs[rows, :, places % LANES] = (mesh.triangles - middle).astype(np.float32).reshape(-1, 9)[members]
    wall = Wall()
    wall.starts = wp.array(starts.astype(np.int32), dtype=wp.int32, device=device)
    wall.packs = wp.array(packs, dtype=Pack, device=device)
    free = least_in_cells(field) / field.spacing - float(SLACK)
    wall.free = wp.array(free.ravel().astype(np.float32), dtype=wp.float32, device=device)
    return wall


def least_in_cells(field: DistanceField) -> Array:
    """Return the (B, 8) least clearance in the cells of a field's bricks, m; interpolation cannot go below it."""
    halves = (slice(0, CELL + 1), slice(CELL, None))
    parts = [field.samples[:, x, y, z].min(axis=(1, 2, 3)) for x in halves for y in halves for z in halves]
    return np.stack(parts, axis=1)


@wp.func
def cell_at(grid: Grid, place: wp.vec3):
    """Return the number of the cell that a place, in spacings, is in; outside the grid, the nearest."""
    i = int(wp.clamp(place[0], 0.0, grid.last[0]))
    j = int(wp.clamp(place[1], 0.0, grid.last[1]))
    k = int(wp.clamp(place[2], 0.0, grid.last[2]))
    brick = grid.bricks[((i >> BITS) * grid.num_y + (j >> BITS)) * grid.num_z + (k >> BITS)]
    x, y, z = (i & MASK) >> CELL_BITS, (j & MASK) >> CELL_BITS, (k & MASK) >> CELL_BITS
    return 8 * brick + 4 * x + 2 * y + z


@wp.struct
class Aim:
    """A ray's direction as the rule takes it: sheared so that the ray is an axis."""

    axis: wp.int32
    """Along which it is longest; the other two follow it in turn."""
    shear: wp.vec3


@wp.func
def aimed(direction: wp.vec3):
    """Return the aim of a ray."""
    aim, size = Aim(), wp.vec3(wp.abs(direction[0]), wp.abs(direction[1]), wp.abs(direction[2]))
    along, second, third = direction[2], direction[0], direction[1]
    aim.axis = 2
    if size[0] >= size[1] and size[0] >= size[2]:
        along, second, third = direction[0], direction[1], direction[2]
        aim.axis = 0
    elif size[1] >= size[2]:
        along, second, third = direction[1], direction[2], direction[0]
        aim.axis = 1
    aim.shear = wp.vec3(second / along, third / along, 1.0 / along)
    return aim


# In C++, whose loop over the lanes compilers turn into vectors; one triangle after the other takes three times as long.
# Without contraction two triangles compute the same for the edge that they share, but for the sign.
@wp.func_native(
    f"""
#if defined(__CUDA_ARCH__)
#define AQUANAV_TIMES(a, b) __fmul_rn(a, b)
#else
#pragma clang fp contract(off)
#define AQUANAV_TIMES(a, b) ((a) * (b))
#endif
    const int N = {LANES}, x = (axis + 1) % 3, y = (axis + 2) % 3, z = axis;
    const float* corners = &packs.data[pack].data[0][0];
    const float *px = corners + N * x, *py = corners + N * y, *pz = corners + N * z;
    const float ox = origin[x], oy = origin[y], oz = origin[z];
    float found[{LANES}];
    for (int n = 0; n < N; ++n) {{
        const float az = pz[n] - oz, bz = pz[n + 3 * N] - oz, cz = pz[n + 6 * N] - oz;
        const float ax = px[n] - ox - AQUANAV_TIMES(shear[0], az), ay = py[n] - oy - AQUANAV_TIMES(shear[1], az);
        const float bx = px[n + 3 * N] - ox - AQUANAV_TIMES(shear[0], bz);
        const float by = py[n + 3 * N] - oy - AQUANAV_TIMES(shear[1], bz);
        const float cx = px[n + 6 * N] - ox - AQUANAV_TIMES(shear[0], cz);
        const float cy = py[n + 6 * N] - oy - AQUANAV_TIMES(shear[1], cz);
        const float u = AQUANAV_TIMES(cx, by) - AQUANAV_TIMES(cy, bx);
        const float v = AQUANAV_TIMES(ax, cy) - AQUANAV_TIMES(ay, cx);
        const float w = AQUANAV_TIMES(bx, ay) - AQUANAV_TIMES(by, ax);
        const float low = u < v ? (u < w ? u : w) : (v < w ? v : w);
        const float high = u > v ? (u > w ? u : w) : (v > w ? v : w);
        const float t = shear[2] * (u * az + v * bz + w * cz) / (u + v + w);
        const bool is_met = ((low >= 0.0f) | (high <= 0.0f)) & (t >= 0.0f);
        found[n] = is_met ? t : best;
    }}
    float nearest = best;
    int lane = -1;
    for (int n = 0; n < N; ++n) {{
        lane = found[n] < nearest ? n : lane;
        nearest = found[n] < nearest ? found[n] : nearest;
    }}
    return wp::vec_t<2, float>(nearest, (float)lane);
"""
)
def nearest_in_pack(
    packs: wp.array(dtype=Pack), pack: int, origin: wp.vec3, axis: int, shear: wp.vec3, best: float
) -> wp.vec2:
    """Return how far the ray comes, at most `best` (m), and the column that it meets, or -1."""
    ...


@wp.struct
class Met:
    """What a ray comes to."""

    distance: wp.float32
    """m; its length where it meets nothing."""
    pack: wp.int32
    """Of the triangle that it meets; -1 for none."""
    lane: wp.int32


@wp.func
def to_leave(place: wp.vec3, low: wp.vec3, high: wp.vec3, inverse: wp.vec3):
    """Return how far it is out of a box from a place in it; `inverse` of the direction, component by component."""
    ways = wp.max(wp.cw_mul(low - place, inverse), wp.cw_mul(high - place, inverse))
    return wp.min(ways)


@wp.func
def inverse_of(component: float):
    """Return the inverse of a component of a direction, finite."""
    if wp.abs(component) < 1e-9:
        return 1e9
    return 1.0 / component


@wp.func
def meet_wall(wall: Wall, grid: Grid, start: wp.vec3, room: float, centre: wp.vec3, direction: wp.vec3, length: float):
    """Return what a ray from a place in the water comes to.

    Args:
        wall: That it meets.
        grid: Its field.
        start: The place, in spacings.
        room: Clearance there, spacings.
        centre: The place, m from the meshes' middle.
        direction: Unit vector.
        length: Of the ray, m.
    """
    met, aim, spacing = Met(), aimed(direction), float(grid.spacing)
    inverse = wp.vec3(inverse_of(direction[0]), inverse_of(direction[1]), inverse_of(direction[2]))
    met.distance = length
    met.pack = -1
    along = wp.max(room - SLACK, 0.0)
    end = wp.min(length / spacing, to_leave(start, wp.vec3(), grid.last, inverse))
    while along < end:
        place = start + along * direction
        cell = cell_at(grid, place)
        step = float(wall.free[cell])
        if step < 0.0:
            for pack in range(wall.starts[cell], wall.starts[cell + 1]):
                nearest = nearest_in_pack(wall.packs, pack, centre, aim.axis, aim.shear, met.distance)
                if nearest[0] < met.distance:
                    met.distance = nearest[0]
                    met.pack = pack
                    met.lane = int(nearest[1])
            end = wp.min(end, met.distance / spacing)
        if step < 1.0:
            low = CELL_EDGE * wp.vec3(
                wp.floor(place[0] / CELL_EDGE), wp.floor(place[1] / CELL_EDGE), wp.floor(place[2] / CELL_EDGE)
            )
            high = low + wp.vec3(CELL_EDGE, CELL_EDGE, CELL_EDGE)
            step = wp.max(step, to_leave(place, low, high, inverse) + CROSSING)
        along += step
    return met


@wp.func
def corner_of(wall: Wall, met: Met, corner: int):
    """Return a corner of the triangle that a ray has met, m."""
    corners = wall.packs[met.pack]
    return wp.vec3(corners[3 * corner, met.lane], corners[3 * corner + 1, met.lane], corners[3 * corner + 2, met.lane])


@wp.func
def face_normal(wall: Wall, met: Met):
    """Return the unit normal of the face that a ray has met, zero for none."""
    if met.pack < 0:
        return wp.vec3()
    first = corner_of(wall, met, 0)
    return wp.normalize(wp.cross(corner_of(wall, met, 1) - first, corner_of(wall, met, 2) - first))
