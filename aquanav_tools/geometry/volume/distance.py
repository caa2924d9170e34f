"""The distance field of a closed mesh, computed in time and memory that grow with walls and volume, not with the box.

Near the walls the triangles are rasterised; deep in the water a tree of boxes finds the nearest. Both are exact, so
the clearance at a sample errs by float32's rounding only (4e-7 m at 10 m). Each brick is computed by itself: the
result is the same for any number of threads.
"""

from __future__ import annotations

import logging

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import ResourceError
from aquanav_tools.geometry.mesh.rasterise import NO_TRIANGLE, spread, squared_distance
from aquanav_tools.geometry.volume.field import (
    BAND,
    BRICK,
    BRICK_BITS,
    ROCK,
    DistanceField,
    field_from_bricks,
    number_bricks,
)
from aquanav_tools.geometry.volume.nearest import STACK, build_tree, distance_to_nearest, gather, keep_nearest
from aquanav_tools.geometry.volume.scanline import Crossings, find_crossings, is_water, mark_water_bricks
from aquanav_tools.types import Array, BoolArray, IntArray, Mesh

logger = logging.getLogger(__name__)

MAX_BRICKS = 60_000
"""Bound on the bricks when a spacing is chosen: 31 million samples, 175 MB in memory, twice that while built."""
MAX_PLACES = 200_000_000
"""Bound on the places for bricks in the box around the cavity: 1 GB while built."""
BLOCK = 4
"""Samples along the edge of the blocks that share a search; 2 and 8 take longer."""
SHIFT = np.array([0.137, 0.271, 0.319])
"""Samples by which the grid is moved off the walls, which in made-up caves lie on round numbers."""


def choose_spacing(mesh: Mesh, vehicle_radius: float) -> float:
    """Return a field's spacing, m: a third of the vehicle's radius, larger where MAX_BRICKS would not suffice."""
    spacing = vehicle_radius / 3.0
    while (num_bricks := _estimate_bricks(mesh, spacing)) > MAX_BRICKS:
        # Bricks are between a surface's and a volume's worth, so this never overshoots.
        spacing *= max(1.02, float(np.cbrt(num_bricks / MAX_BRICKS)))
    return spacing


def _estimate_bricks(mesh: Mesh, spacing: float) -> float:
    """Return about how many bricks a field has: those full of water, and those cut by the wall or beside it."""
    volume, area, edge = mesh.volume, float(mesh.areas.sum()), BRICK * spacing
    # A wall cuts 1.5 bricks per brick's area on average over directions, half of which the volume counts already;
    # the band behind it adds BAND / BRICK.
    return volume / edge**3 + (0.75 + BAND / BRICK) * area / edge**2


def distance_field(mesh: Mesh, spacing: float) -> DistanceField:
    """Return the clearance on a sparse grid around what a closed mesh holds.

    Distances are exact (to float32) at every sample in the water and up to BAND samples behind the walls.

    Raises:
        MeshError: the mesh is not closed.
        ResourceError: the box around it is too large for the spacing.
    """
    low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
    origin = low - (BAND + 1 + SHIFT) * spacing
    counts = np.ceil(((high - origin) / spacing + BAND + 1) / BRICK)
    if np.prod(counts) > MAX_PLACES:
        raise ResourceError(
            f"The cave measures {np.round(high - low, 1)} m, which at {spacing:.3g} m between samples is more than a "
            "distance field can address. The unit is wrong, or stray parts lie far off: check --unit."
        )
    grid_triangles = (mesh.triangles - origin) / spacing
    num_x, num_y, num_z = (int(count) for count in counts)
    crossings = find_crossings(grid_triangles, BRICK * num_x, BRICK * num_y)
    is_kept = np.zeros((num_x, num_y, num_z), dtype=np.bool_)
    mark_water_bricks(crossings.starts, crossings.heights, crossings.signs, BRICK * num_y, BRICK_BITS, is_kept)
    _mark_wall_bricks(grid_triangles, is_kept)
    bricks = number_bricks(is_kept)
    logger.info("Distance field of %d bricks at %.3g m", is_kept.sum(), spacing)
    cores = _fill_cores(grid_triangles, crossings, bricks, is_kept)
    cores *= np.float32(spacing)
    return field_from_bricks(origin, spacing, bricks, cores)


def _fill_cores(
    grid_triangles: Array, crossings: Crossings, bricks: npt.NDArray[np.int32], is_kept: BoolArray
) -> npt.NDArray[np.float32]:
    """Return the (B, BRICK, BRICK, BRICK) clearance of all bricks, in samples; the first is rock."""
    starts, members = _wall_members(grid_triangles, bricks, int(is_kept.sum()))
    tree = build_tree(grid_triangles)
    cores = np.full((len(starts), BRICK, BRICK, BRICK), -BAND, dtype=np.float32)
    places = np.argwhere(is_kept)
    num_y = BRICK * bricks.shape[1]
    lines = (crossings.starts, crossings.heights, crossings.signs)
    _fill(places, starts, members, grid_triangles, tuple(tree), lines, num_y, cores)
    return cores


def _wall_members(grid_triangles: Array, bricks: npt.NDArray[np.int32], num_bricks: int) -> tuple[IntArray, IntArray]:
    """Return the triangles near each brick: those of brick n are members[starts[n - 1]:starts[n]], in order."""
    counts = np.zeros(num_bricks + 1, dtype=np.int64)
    _count_members(grid_triangles, bricks, counts)
    starts = np.cumsum(counts)
    members = np.empty(starts[-1], dtype=np.int64)
    _note_members(grid_triangles, bricks, starts[:-1].copy(), members)
    return starts, members


@numba.njit(cache=True)
def _mark_wall_bricks(triangles, is_kept):  # type: ignore[no-untyped-def]
    for t in range(len(triangles)):
        x0, x1, y0, y1, z0, z1 = _bricks_around(triangles[t], is_kept.shape)
        for x in range(x0, x1):
            for y in range(y0, y1):
                for z in range(z0, z1):
                    if not is_kept[x, y, z] and _is_near(triangles, t, x, y, z):
                        is_kept[x, y, z] = True


@numba.njit(cache=True)
def _count_members(triangles, bricks, counts):  # type: ignore[no-untyped-def]
    for t in range(len(triangles)):
        x0, x1, y0, y1, z0, z1 = _bricks_around(triangles[t], bricks.shape)
        for x in range(x0, x1):
            for y in range(y0, y1):
                for z in range(z0, z1):
                    if bricks[x, y, z] != ROCK and _is_near(triangles, t, x, y, z):
                        counts[bricks[x, y, z]] += 1


@numba.njit(cache=True)
def _note_members(triangles, bricks, ends, members):  # type: ignore[no-untyped-def]
    for t in range(len(triangles)):
        x0, x1, y0, y1, z0, z1 = _bricks_around(triangles[t], bricks.shape)
        for x in range(x0, x1):
            for y in range(y0, y1):
                for z in range(z0, z1):
                    brick = bricks[x, y, z]
                    if brick != ROCK and _is_near(triangles, t, x, y, z):
                        members[ends[brick - 1]] = t
                        ends[brick - 1] += 1


@numba.njit(cache=True)
def _bricks_around(triangle, shape):  # type: ignore[no-untyped-def]
    """Return the first brick and the one after the last, per axis, within BAND of a triangle's box."""
    x0, x1 = (triangle[:, 0].min() - BAND) // BRICK, (triangle[:, 0].max() + BAND) // BRICK + 1
    y0, y1 = (triangle[:, 1].min() - BAND) // BRICK, (triangle[:, 1].max() + BAND) // BRICK + 1
    z0, z1 = (triangle[:, 2].min() - BAND) // BRICK, (triangle[:, 2].max() + BAND) // BRICK + 1
    return (
        max(int(x0), 0),
        min(int(x1), shape[0]),
        max(int(y0), 0),
        min(int(y1), shape[1]),
        max(int(z0), 0),
        min(int(z1), shape[2]),
    )


@numba.njit(cache=True)
def _is_near(triangles, t, x, y, z):  # type: ignore[no-untyped-def]
    """Return whether a triangle comes within BAND of the ball around a brick's samples."""
    half = 0.5 * (BRICK - 1)
    reach = BAND + np.sqrt(3.0) * half
    middle = (BRICK * x + half, BRICK * y + half, BRICK * z + half)
    square = squared_distance(triangles, t, middle[0], middle[1], middle[2])
    return square <= reach * reach * (1.0 + 1e-9)


@numba.njit(cache=True, parallel=True)
def _fill(places, starts, members, triangles, tree, lines, num_y, cores):  # type: ignore[no-untyped-def]
    for n in numba.prange(len(places)):
        _fill_core(places[n] * BRICK, members[starts[n] : starts[n + 1]], triangles, tree, lines, num_y, cores[n + 1])


@numba.njit(cache=True)
def _fill_core(first, members, triangles, tree, lines, num_y, core):  # type: ignore[no-untyped-def]
    """Fill one brick with clearance, in samples. Triangles, boxes and heights are in samples too."""
    core[:] = BAND
    nearest = np.full(core.shape, NO_TRIANGLE, dtype=np.int32)
    for m in members:
        spread(triangles, m, first[0], first[1], first[2], 1.0, BAND, core, nearest)
    is_deep = np.zeros(core.shape, dtype=np.bool_)
    for i in range(BRICK):
        for j in range(BRICK):
            line = (first[0] + i) * num_y + first[1] + j
            for k in range(BRICK):
                if not is_water(lines[0], lines[1], lines[2], line, first[2] + k):
                    core[i, j, k] = -core[i, j, k]
                elif nearest[i, j, k] == NO_TRIANGLE:
                    is_deep[i, j, k] = True
    if is_deep.any():
        _fill_deep(first, is_deep, tree[0], tree[1], tree[2], core)


@numba.njit(cache=True)
def _fill_deep(first, is_deep, triangles, boxes, balls, core):  # type: ignore[no-untyped-def]
    """Fill in the distance at the samples that no triangle is near; BLOCK^3 of them share a search."""
    stack, rows, guess = np.empty(STACK, dtype=np.int64), np.empty(256, dtype=np.int64), 0
    near = np.empty((balls.shape[1], len(rows)))
    half = 0.5 * (BLOCK - 1)
    for i in range(0, BRICK, BLOCK):
        for j in range(0, BRICK, BLOCK):
            for k in range(0, BRICK, BLOCK):
                is_asked = is_deep[i : i + BLOCK, j : j + BLOCK, k : k + BLOCK]
                if not is_asked.any():
                    continue
                x, y, z = first[0] + i, first[1] + j, first[2] + k
                radius = np.sqrt(3.0) * half
                rows, count, guess = gather(
                    triangles, boxes, balls, x + half, y + half, z + half, radius, guess, rows, stack
                )
                if near.shape[1] < count:
                    near = np.empty((balls.shape[1], len(rows)))
                for n in range(count):
                    near[:, n] = balls[rows[n]]
                block = core[i : i + BLOCK, j : j + BLOCK, k : k + BLOCK]
                _fill_block(x, y, z, is_asked, triangles, near, rows, count, block)


@numba.njit(cache=True)
def _fill_block(x, y, z, is_asked, triangles, near, rows, count, block):  # type: ignore[no-untyped-def]
    """Fill in the distance in one block from some triangles; each eight samples look only at those near them."""
    fewer, kept, apart = np.empty((len(near), count)), np.empty(count, dtype=np.int64), np.empty(count)
    radius = 0.5 * np.sqrt(3.0)
    for i in range(0, BLOCK, 2):
        for j in range(0, BLOCK, 2):
            for k in range(0, BLOCK, 2):
                if not is_asked[i : i + 2, j : j + 2, k : k + 2].any():
                    continue
                chosen, guess = keep_nearest(
                    near, rows, count, x + i + 0.5, y + j + 0.5, z + k + 0.5, radius, fewer, kept, apart
                )
                for a in range(i, i + 2):
                    for b in range(j, j + 2):
                        for c in range(k, k + 2):
                            if is_asked[a, b, c]:
                                block[a, b, c] = distance_to_nearest(
                                    triangles, fewer, kept, chosen, x + a, y + b, z + c, guess, apart
                                )
