"""The wall that hulls meet: a bounding volume hierarchy with eight boxes to a node and eight triangles to a leaf.

A processor tries eight at once: what is nearest to both ends of a capsule's axis is found in 0.3 us so, where Warp's
own tree, with two boxes to a node, takes 1.1.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.errors import ResourceError
from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.types import Array, Mesh

wp.set_module_options(OPTIONS)

LANES = 8
"""Boxes in a node, and triangles in a leaf."""
MAX_LEVELS = 8
"""Of nodes: 8^8 leaves."""
FOUND = 16
"""Leaves that are returned at once."""
FAR = 1e9
"""m; where there is no triangle, and no box."""
Leaf = wp.types.matrix(shape=(10, LANES), dtype=wp.float32)
"""Corners x, y, z of the first, then of the second and the third corner, m; then which edges (1, 2 and 4, from these
corners on) are to be tried here, as each is of two triangles. One triangle per column."""
Node = wp.types.matrix(shape=(6, LANES), dtype=wp.float32)
"""Least x, y, z and largest x, y, z of the boxes, m; one box per column."""
ivec_levels = wp.types.vector(length=MAX_LEVELS, dtype=wp.int32)
ivec_found = wp.types.vector(length=FOUND + 1, dtype=wp.int32)
vec5 = wp.types.vector(length=5, dtype=wp.float32)


@wp.struct
class Bvh:
    """A wall's triangles."""

    leaves: wp.array(dtype=Leaf)
    nodes: wp.array(dtype=Node)
    """Level by level; the lowest first, whose boxes hold a leaf each."""
    firsts: ivec_levels
    """Each level's first node."""
    num_levels: wp.int32


def make_bvh(mesh: Mesh, middle: Array, device: Any) -> Bvh:
    """Return a mesh on a device, moved so that `middle`, (3,) world, m, is at the origin: hulls meet it in float32.

    Raises:
        ResourceError: there are too many triangles.
    """
    num_leaves = -(-len(mesh.faces) // LANES)
    if num_leaves > LANES**MAX_LEVELS:
        raise ResourceError(
            f"The wall that vehicles meet has {len(mesh.faces):,} triangles; a batch can hold "
            f"{LANES ** (MAX_LEVELS + 1):,}. Build the cave with a larger voxel."
        )
    triangles = (mesh.triangles - middle).astype(np.float32)
    order = _compact_order(triangles.mean(axis=1))
    leaves = np.full((num_leaves * LANES, 10), FAR, dtype=np.float32)
    leaves[: len(order), :9] = triangles[order].reshape(-1, 9)
    leaves[:, 9] = 0.0
    leaves[: len(order), 9] = _own_edges(mesh.faces)[order]
    low = np.full((num_leaves * LANES, 3), FAR, dtype=np.float32)
    high = -low
    low[: len(order)], high[: len(order)] = triangles[order].min(axis=1), triangles[order].max(axis=1)
    bvh, levels = Bvh(), []
    low, high = low.reshape(-1, LANES, 3).min(axis=1), high.reshape(-1, LANES, 3).max(axis=1)
    while not levels or len(levels[-1]) > 1:
        missing = -len(low) % LANES
        low = np.pad(low, ((0, missing), (0, 0)), constant_values=FAR).reshape(-1, LANES, 3)
        high = np.pad(high, ((0, missing), (0, 0)), constant_values=-FAR).reshape(-1, LANES, 3)
        levels.append(np.concatenate([low, high], axis=2).swapaxes(1, 2))
        low, high = low.min(axis=1), high.max(axis=1)
    firsts = np.cumsum([0] + [len(level) for level in levels[:-1]])
    bvh.num_levels, bvh.firsts = len(levels), ivec_levels(*firsts, *[0] * (MAX_LEVELS - len(levels)))
    columns = np.ascontiguousarray(leaves.reshape(-1, LANES, 10).swapaxes(1, 2))
    bvh.leaves = wp.array(columns, dtype=Leaf, device=device)
    bvh.nodes = wp.array(np.concatenate(levels), dtype=Node, device=device)
    return bvh


def _compact_order(points: npt.NDArray[np.float32]) -> npt.NDArray[np.int64]:
    """Return an order of (N, 3) points in which runs of 8, 16, 32 ... are compact: halves along the longest side."""
    order, size = np.arange(len(points)), LANES
    while size < len(points):
        size *= 2
    while size > LANES:
        groups = np.arange(len(points)) // size
        firsts = np.arange(0, len(points), size)
        sides = np.maximum.reduceat(points[order], firsts) - np.minimum.reduceat(points[order], firsts)
        along = points[order, sides.argmax(axis=1)[groups]]
        order = order[np.lexsort((along, groups))]
        size //= 2
    return order


def _own_edges(faces: npt.NDArray[np.integer]) -> npt.NDArray[np.int64]:
    """Return for (T, 3) faces the sum of 1, 2 and 4 for the edges from each corner on that no earlier face has."""
    edges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    keys = edges[:, 0].astype(np.int64) * (int(faces.max()) + 1) + edges[:, 1]
    is_first = np.zeros(len(keys), dtype=np.int64)
    is_first[np.unique(keys, return_index=True)[1]] = 1
    return is_first.reshape(-1, 3) @ np.array([1, 2, 4])


# What follows is in C++, whose loops over the lanes compilers turn into vectors.
TRIANGLE = """
const float ax = corners[n], ay = corners[n + 8], az = corners[n + 16];
const float abx = corners[n + 24] - ax, aby = corners[n + 32] - ay, abz = corners[n + 40] - az;
const float acx = corners[n + 48] - ax, acy = corners[n + 56] - ay, acz = corners[n + 64] - az;
const float bb = abx * abx + aby * aby + abz * abz, cc = acx * acx + acy * acy + acz * acz;
"""
"""The triangle of column n: its first corner a, its edges ab and ac from there, and their products."""
HIGHEST_BIT = """
#ifdef __CUDA_ARCH__
#define HIGHEST_BIT(mask) (31 - __clz(mask))
#else
#define HIGHEST_BIT(mask) (31 - __builtin_clz(mask))
#endif
"""
"""Number of the highest bit that is set: what is near is found in masks without a branch for each that is not."""


@wp.func_native(
    f"""{HIGHEST_BIT}
    wp::vec_t<{FOUND + 1}, int> found;
    for (int n = 0; n <= {FOUND}; ++n) found[n] = -1;
    int groups[{LANES * MAX_LEVELS}], levels[{LANES * MAX_LEVELS}], num = 0, top = 1;
    groups[0] = 0;
    levels[0] = num_levels - 1;
    while (top > 0) {{
        --top;
        const int level = levels[top], group = groups[top];
        if (((long long)(group + 1) << (3 * level + 3)) <= first) continue;
        const float* box = &nodes.data[firsts[level] + group].data[0][0];
        unsigned near = 0;
        for (int n = 0; n < 8; ++n) {{
            float square = 0.0f;
            for (int axis = 0; axis < 3; ++axis) {{
                const float before = box[8 * axis + n] - high[axis], behind = low[axis] - box[8 * axis + 24 + n];
                float apart = before > behind ? before : behind;
                apart = apart > 0.0f ? apart : 0.0f;
                square += apart * apart;
            }}
            near |= (square <= reach * reach ? 1u : 0u) << n;
        }}
        for (; level > 0 && near; near ^= 1u << HIGHEST_BIT(near)) {{
            groups[top] = 8 * group + HIGHEST_BIT(near);
            levels[top++] = level - 1;
        }}
        for (; near; near &= near - 1) {{
            const int leaf = 8 * group + HIGHEST_BIT(near & (0u - near));
            if (leaf < first) continue;
            if (num == {FOUND}) {{
                found[num] = leaf;
                return found;
            }}
            found[num++] = leaf;
        }}
    }}
    return found;
"""
)
def leaves_near(
    nodes: wp.array(dtype=Node), firsts: ivec_levels, num_levels: int, low: wp.vec3, high: wp.vec3, reach: float,
    first: int,
) -> ivec_found:  # fmt: skip
    """Return the leaves from `first` on whose boxes are within `reach` of another box, in order, then -1.

    Behind FOUND leaves comes from which one on there are more, or -1.
    """
    ...


@wp.func_native(
    """
    const float* corners = &leaves.data[leaf].data[0][0];
    wp::vec_t<5, float> result;
    for (int end = 0; end < 2; ++end) {
        const float x = end ? tail[0] : nose[0], y = end ? tail[1] : nose[1], z = end ? tail[2] : nose[2];
        unsigned keys[8], nearest = 0xffffffffu;
        for (int n = 0; n < 8; ++n) {
            TRIANGLE
            const float bc = abx * acx + aby * acy + abz * acz;
            const float px = x - ax, py = y - ay, pz = z - az;
            const float d1 = abx * px + aby * py + abz * pz, d2 = acx * px + acy * py + acz * pz;
            const float d3 = d1 - bb, d4 = d2 - bc, d5 = d1 - bc, d6 = d2 - cc;
            const float va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;
            const float part = (d4 - d3) / ((d4 - d3) + (d5 - d6)), on_b = d1 / (d1 - d3), on_c = d2 / (d2 - d6);
            float v = vb / (va + vb + vc), w = vc / (va + vb + vc);
            const bool is_bc = (va <= 0.0f) & (d4 >= d3) & (d5 >= d6);
            v = is_bc ? 1.0f - part : v;
            w = is_bc ? part : w;
            const bool is_ac = (vb <= 0.0f) & (d2 >= 0.0f) & (d6 <= 0.0f);
            v = is_ac ? 0.0f : v;
            w = is_ac ? on_c : w;
            const bool is_ab = (vc <= 0.0f) & (d1 >= 0.0f) & (d3 <= 0.0f);
            v = is_ab ? on_b : v;
            w = is_ab ? 0.0f : w;
            const bool is_c = (d6 >= 0.0f) & (d5 <= d6), is_b = (d3 >= 0.0f) & (d4 <= d3);
            const bool is_a = (d1 <= 0.0f) & (d2 <= 0.0f);
            v = is_c ? 0.0f : v;
            w = is_c ? 1.0f : w;
            v = is_b ? 1.0f : v;
            w = is_b ? 0.0f : w;
            v = is_a ? 0.0f : v;
            w = is_a ? 0.0f : w;
            const float dx = px - v * abx - w * acx, dy = py - v * aby - w * acy, dz = pz - v * abz - w * acz;
            const union { float square; unsigned bits; } key = {dx * dx + dy * dy + dz * dz};
            keys[n] = (key.bits & ~7u) | n;
        }
        for (int n = 0; n < 8; ++n) nearest = keys[n] < nearest ? keys[n] : nearest;
        const union { unsigned bits; float square; } least = {nearest & ~7u};
        result[2 * end] = least.square;
        result[2 * end + 1] = (float)(nearest & 7u);
    }
    const float ux = nose[0] - tail[0], uy = nose[1] - tail[1], uz = nose[2] - tail[2];
    const float length = ux * ux + uy * uy + uz * uz, inverse = length > 0.0f ? 1.0f / length : 0.0f;
    int beside = 0;
    for (int n = 0; n < 8; ++n) {
        TRIANGLE
        const float tx = ax - tail[0], ty = ay - tail[1], tz = az - tail[2];
        const float a = tx * ux + ty * uy + tz * uz, b = a + abx * ux + aby * uy + abz * uz;
        const float c = a + acx * ux + acy * uy + acz * uz;
        const float low = b < c ? b : c, high = b > c ? b : c, longest = bb > cc ? bb : cc;
        const float least = a < low ? a : low, most = a > high ? a : high;
        const float away = tx * tx + ty * ty + tz * tz - a * a * inverse - 2.0f * longest;
        const bool is_beside = (least < length) & (most > 0.0f) & (away <= 2.0f * reach * reach);
        beside |= (is_beside ? 1 : 0) << n;
    }
    result[4] = 0.0f;
    if (!beside) return result;
    int near = 0;
    for (int side = 0; side < 3; ++side) {
        const float* from = corners + 24 * side;
        const float* to = corners + 24 * ((side + 1) % 3);
        for (int n = 0; n < 8; ++n) {
            const float ex = to[n] - from[n], ey = to[n + 8] - from[n + 8], ez = to[n + 16] - from[n + 16];
            const float mx = from[n] + 0.5f * ex - tail[0], my = from[n + 8] + 0.5f * ey - tail[1];
            const float mz = from[n + 16] + 0.5f * ez - tail[2];
            float share = (mx * ux + my * uy + mz * uz) * inverse;
            share = share > 0.0f ? share : 0.0f;
            share = share < 1.0f ? share : 1.0f;
            const float ox = mx - share * ux, oy = my - share * uy, oz = mz - share * uz;
            const float most = reach + 0.5f * sqrtf(ex * ex + ey * ey + ez * ez);
            const bool is_own = ((int)corners[n + 72] >> side) & 1;
            const bool is_near = is_own & (ox * ox + oy * oy + oz * oz <= most * most);
            near |= (is_near ? 1 : 0) << (8 * side + n);
        }
    }
    result[4] = (float)near;
    return result;
""".replace("TRIANGLE", TRIANGLE)
)
def nearest_in_leaf(leaves: wp.array(dtype=Leaf), leaf: int, nose: wp.vec3, tail: wp.vec3, reach: float) -> vec5:
    """Return what of a leaf is nearest to both ends of an axis, and what may be near to what lies between them.

    These are the square of the distance and the column for the nose, the same for the tail, and the sum of
    2^(8 s + n) for the edges from corner s of column n that may be within `reach` of a place between the ends.
    Squares that differ by less than a millionth count as equal: their last three bits hold the column.
    """
    ...


@wp.func
def corner_of(wall: Bvh, leaf: int, lane: int, corner: int):
    """Return a corner of a triangle, m."""
    corners = wall.leaves[leaf]
    return wp.vec3(corners[3 * corner, lane], corners[3 * corner + 1, lane], corners[3 * corner + 2, lane])


@wp.func_native(f"{HIGHEST_BIT}return HIGHEST_BIT(mask);")
def highest_bit(mask: int) -> int:
    """Return the number of the highest bit of a mask that is not zero."""
    ...
