"""Winding numbers of a damaged surface on a grid of samples: near 1 in the water and near 0 in rock.

The generalised winding number tells the two apart even where a surface has holes, crosses itself or is a mere soup
(Jacobson et al. 2013, Barill et al. 2018). It jumps by one where a wall is crossed, and changes smoothly elsewhere,
over about the distance from the nearest rim. So few samples are computed: others count the walls on the way from there.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.geometry.mesh.piercings import signed_piercings
from aquanav_tools.types import Array, BoolArray, Mesh

Float32Array = npt.NDArray[np.float32]

WATER_LEVEL = 0.5
COARSE_STEP = 4
"""Away from walls and rims only every fourth sample is computed, ..."""
ANCHOR_STEP = 16
"""... and where no rim is near at all, one in sixteen."""
UNSURE = 0.35
"""A number that is counted, not computed, stands where it is at least this far from the level."""
RIM_REACH, FAR_RIM_REACH = 3, 8
"""Coarse steps from a rim within which numbers are not counted from coarse samples; and from anchors. At 8 samples from
a straight rim the number changes by 0.02 per sample."""
NEAR_ACCURACY, HOLE_ACCURACY = 1.3, 2.0
"""Of igl's fast winding number: within 0.04 at the first (measured), enough to tell the sides of a wall apart, and
within 0.005 at the second, where the number itself shapes the fill; the first costs less than half."""
CROSSED_VOXELS = 0.9
"""Every point of a wall is this near to a sample, half a cell's diagonal and a little more."""
ON_WALL = 1e-4
"""On which side of a wall a sample nearer than this lies, voxels, is a matter of rounding: no count goes past it."""
COUNTED, ASKED_NEAR, ASKED_IN_HOLE = 0, 1, 2


@dataclass(frozen=True, eq=False)
class WindingField:
    """The winding number of one surface, ready to be asked."""

    hierarchy: Any
    """Of igl."""
    rims: Array
    """(R, 2, 3) ends of the edges at which the surface ends, m."""


def winding_field(surface: Mesh) -> WindingField:
    """Return the winding number of a surface with normals out of the water."""
    import igl

    hierarchy = igl.FastWindingNumberBVH()
    hierarchy.init(surface.vertices, surface.faces)
    return WindingField(hierarchy, surface.vertices[_rims(surface)])


def _rims(surface: Mesh) -> npt.NDArray[np.int64]:
    """Return the (R, 2) edges that more faces run along one way than the other: there the winding number turns."""
    tails, heads = surface.faces.ravel(), np.roll(surface.faces, -1, axis=1).ravel()
    low, high = np.minimum(tails, heads), np.maximum(tails, heads)
    keys = low * len(surface.vertices) + high
    order = np.argsort(keys)
    keys = keys[order]
    starts = np.flatnonzero(np.diff(keys, prepend=-1))
    sums = np.add.reduceat(np.where(tails < heads, 1, -1)[order], starts) if len(keys) else keys
    rims = keys[starts[sums != 0]]
    return np.stack([rims // len(surface.vertices), rims % len(surface.vertices)], axis=1)


def winding_in_box(
    field: WindingField, triangles: Array, origin: Array, voxel: float, distance: Float32Array
) -> Float32Array:
    """Return the winding number at the samples of a box; away from the level and the walls only its side is exact.

    Args:
        field: of the whole surface.
        triangles: (K, 3, 3) all of it that reach into the box, m.
        origin: (3,) of the first sample, m.
        voxel: spacing of the samples, m.
        distance: (N, N, N) from the surface, voxels, right where it is below 1; N - 1 is a multiple of COARSE_STEP.
    """
    from scipy.ndimage import maximum_filter

    count = len(distance)
    piercings = signed_piercings(triangles, origin, voxel, (count, count, count))
    from_rim = _steps_from_rim(field.rims, origin, voxel, count)
    is_blind = _parts_on_wall(distance, ANCHOR_STEP)
    coarse = _coarse_numbers(field, piercings, from_rim < FAR_RIM_REACH, is_blind, origin, voxel)
    is_near = maximum_filter(distance < CROSSED_VOXELS, size=COARSE_STEP + 1)
    values, kinds = np.empty(distance.shape, dtype=np.float32), np.empty(distance.shape, dtype=np.uint8)
    is_asked = (from_rim < RIM_REACH) | _parts_on_wall(distance, COARSE_STEP)
    _count_numbers(coarse, *piercings, is_asked, is_near, _cells_with(is_near), values, kinds)
    for kind, accuracy in ((ASKED_NEAR, NEAR_ACCURACY), (ASKED_IN_HOLE, HOLE_ACCURACY)):
        asked = np.argwhere(kinds == kind)
        if len(asked):
            values[tuple(asked.T)] = field.hierarchy.winding_number(origin + voxel * asked, accuracy)
    return values


def _steps_from_rim(rims: Array, origin: Array, voxel: float, count: int) -> Float32Array:
    """Return for each coarse sample about how many coarse steps it is from the nearest rim; FAR_RIM_REACH or more."""
    from scipy.ndimage import distance_transform_edt

    num_coarse = (count - 1) // COARSE_STEP + 1
    step, around = voxel * COARSE_STEP, FAR_RIM_REACH
    low, high = origin - around * step, origin + (num_coarse + around) * step
    is_here = ((rims.max(axis=1) >= low) & (rims.min(axis=1) <= high)).all(axis=1)
    if not is_here.any():
        return np.full((num_coarse,) * 3, FAR_RIM_REACH, dtype=np.float32)
    ends = rims[is_here]
    pieces = int(np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).max() / step)) + 1
    shares = np.linspace(0.0, 1.0, pieces + 1)[:, None, None]
    places = ((1.0 - shares) * ends[:, 0] + shares * ends[:, 1]).reshape(-1, 3)
    places = places[((places >= low) & (places <= high)).all(axis=1)]
    cells = np.rint((places - origin) / step).astype(np.int64) + around
    is_free = np.ones((num_coarse + 2 * around,) * 3, dtype=bool)
    cells = np.clip(cells, 0, num_coarse + 2 * around - 1)
    is_free[tuple(cells.T)] = False
    if is_free.all():
        return np.full((num_coarse,) * 3, FAR_RIM_REACH, dtype=np.float32)
    inner = slice(around, -around)
    return np.asarray(distance_transform_edt(is_free)[inner, inner, inner], dtype=np.float32)


def _coarse_numbers(
    field: WindingField,
    piercings: tuple[Any, Any, Any],
    is_near_rim: BoolArray,
    is_blind: BoolArray,
    origin: Array,
    voxel: float,
) -> Array:
    """Return the winding number at every COARSE_STEP-th sample; those around blind anchors are all computed."""
    num_anchors = len(is_blind)
    places = np.indices((num_anchors,) * 3).reshape(3, -1).T * ANCHOR_STEP
    anchors = np.asarray(field.hierarchy.winding_number(origin + voxel * places)).reshape((num_anchors,) * 3)
    coarse = np.empty(is_near_rim.shape)
    is_asked = np.empty(is_near_rim.shape, dtype=bool)
    _count_coarse(anchors, *piercings, is_near_rim, is_blind, coarse, is_asked)
    asked = np.argwhere(is_asked)
    if len(asked):
        coarse[is_asked] = field.hierarchy.winding_number(origin + voxel * COARSE_STEP * asked)
    return coarse


@numba.njit(cache=True)
def _gain(along_x, along_y, along_z, start, end):  # type: ignore[no-untyped-def]
    """Return what walls add to the winding number from one sample to another, along x first, then y, then z."""
    total = 0
    for i in range(start[0], end[0]):
        total += along_x[i, start[1], start[2]]
    for i in range(end[0], start[0]):
        total -= along_x[i, start[1], start[2]]
    for j in range(start[1], end[1]):
        total += along_y[end[0], j, start[2]]
    for j in range(end[1], start[1]):
        total -= along_y[end[0], j, start[2]]
    for k in range(start[2], end[2]):
        total += along_z[end[0], end[1], k]
    for k in range(end[2], start[2]):
        total -= along_z[end[0], end[1], k]
    return total


@numba.njit(cache=True)
def _nearest(sample, step, count):  # type: ignore[no-untyped-def]
    return min((sample + step // 2) // step, count - 1)


@numba.njit(cache=True, parallel=True)
def _count_coarse(anchors, along_x, along_y, along_z, is_near_rim, is_blind, coarse, is_asked):  # type: ignore[no-untyped-def]
    """Fill the coarse numbers from those of anchors, and tell which are to be computed instead."""
    count, num_anchors = len(coarse), len(anchors)
    for a in numba.prange(count):
        for b in range(count):
            for c in range(count):
                end = (COARSE_STEP * a, COARSE_STEP * b, COARSE_STEP * c)
                p = _nearest(end[0], ANCHOR_STEP, num_anchors)
                q = _nearest(end[1], ANCHOR_STEP, num_anchors)
                r = _nearest(end[2], ANCHOR_STEP, num_anchors)
                start = (ANCHOR_STEP * p, ANCHOR_STEP * q, ANCHOR_STEP * r)
                value = anchors[p, q, r] + _gain(along_x, along_y, along_z, start, end)
                coarse[a, b, c] = value
                is_sure = abs(value - WATER_LEVEL) >= UNSURE and not is_blind[p, q, r]
                is_asked[a, b, c] = is_near_rim[a, b, c] or not is_sure


@numba.njit(cache=True, parallel=True)
def _count_numbers(coarse, along_x, along_y, along_z, is_near_rim, is_near, has_wall, values, kinds):  # type: ignore[no-untyped-def]
    """Fill the numbers of all samples from the coarse ones, and the kinds of those that are to be computed instead."""
    count, num_coarse = len(values), len(coarse)
    for i in numba.prange(count):
        for j in range(count):
            for k in range(count):
                a, b, c = (
                    _nearest(i, COARSE_STEP, num_coarse),
                    _nearest(j, COARSE_STEP, num_coarse),
                    _nearest(k, COARSE_STEP, num_coarse),
                )
                value = coarse[a, b, c]
                kind = COUNTED
                if is_near[i, j, k]:
                    start = (COARSE_STEP * a, COARSE_STEP * b, COARSE_STEP * c)
                    value += _gain(along_x, along_y, along_z, start, (i, j, k))
                    if is_near_rim[a, b, c] or abs(value - WATER_LEVEL) < UNSURE:
                        kind = ASKED_NEAR
                elif abs(value - WATER_LEVEL) < UNSURE:
                    # A hole: its middle passes here.
                    last = len(has_wall) - 1
                    x, y, z = min(i // COARSE_STEP, last), min(j // COARSE_STEP, last), min(k // COARSE_STEP, last)
                    if is_near_rim[a, b, c] or has_wall[x, y, z]:
                        kind = ASKED_IN_HOLE
                    else:
                        value = _between(coarse, i, j, k)
                values[i, j, k] = value
                kinds[i, j, k] = kind


@numba.njit(cache=True)
def _parts_on_wall(distance, step):  # type: ignore[no-untyped-def]
    """Return for every step-th sample whether one of those that it is nearest to lies on a wall."""
    count, num_parts = len(distance), (len(distance) - 1) // step + 1
    found = np.zeros((num_parts, num_parts, num_parts), np.bool_)
    for i in range(count):
        for j in range(count):
            for k in range(count):
                if distance[i, j, k] < ON_WALL:
                    found[_nearest(i, step, num_parts), _nearest(j, step, num_parts), _nearest(k, step, num_parts)] = (
                        True
                    )
    return found


@numba.njit(cache=True, parallel=True)
def _cells_with(flags):  # type: ignore[no-untyped-def]
    """Return which coarse cells have a flag at one of their samples, borders included."""
    count = (len(flags) - 1) // COARSE_STEP
    found = np.zeros((count, count, count), np.bool_)
    for a in numba.prange(count):
        for b in range(count):
            for c in range(count):
                x, y, z = COARSE_STEP * a, COARSE_STEP * b, COARSE_STEP * c
                found[a, b, c] = flags[x : x + COARSE_STEP + 1, y : y + COARSE_STEP + 1, z : z + COARSE_STEP + 1].any()
    return found


@numba.njit(cache=True)
def _between(coarse, i, j, k):  # type: ignore[no-untyped-def]
    """Return the trilinear interpolation of the coarse numbers at a sample."""
    last = len(coarse) - 2
    a, b, c = min(i // COARSE_STEP, last), min(j // COARSE_STEP, last), min(k // COARSE_STEP, last)
    x, y, z = i / COARSE_STEP - a, j / COARSE_STEP - b, k / COARSE_STEP - c
    value = 0.0
    for p in range(2):
        for q in range(2):
            for r in range(2):
                weight = (x if p else 1.0 - x) * (y if q else 1.0 - y) * (z if r else 1.0 - z)
                value += weight * coarse[a + p, b + q, c + r]
    return value
