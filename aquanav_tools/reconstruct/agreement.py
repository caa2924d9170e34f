"""How depth maps agree, pixel by pixel: the inner loops of fusion, in numba.

Every loop reads one pair of maps and writes to each pixel of one of them alone, so that the result is the same for any
number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.types import Array

UNSURE, SURE, USED = np.uint8(0), np.uint8(1), np.uint8(2)
"""State of a cell of pixels: no other photo agrees; one does; it is part of a fused point."""
GRAZING = 0.15
"""Cosine between ray and normal below which a plane gives no depth along the ray: about 81 degrees."""
BEHIND = 0.05
"""Wall that a photo sees this much farther away, relative, contradicts a point before it."""
MIN_BEHIND = 5
"""Of the nine cells around a point's, those that must be sure of that."""
NUM_SUMS = 9
"""Weight, weighted depth, its square, normal, colour."""


class Tolerance(NamedTuple):
    """When two maps agree on a point."""

    reprojection_px: float
    """Largest offset between their pixels."""
    depth: float
    """Largest relative difference of their depths."""
    cosine: float
    """Least cosine between their normals."""


class Pair(NamedTuple):
    """Two cameras and when their maps agree."""

    pinhole: Array
    """(4,) fx, fy, cx, cy of the first, px."""
    other_pinhole: Array
    """(4,) of the other."""
    turn: Array
    """(3, 3) `other_from_first`."""
    shift: Array
    """(3,) m."""
    max_reprojection_px: float
    max_depth_error: float
    min_cosine: float
    """As in `Tolerance`; the compiler takes no tuple inside a tuple."""


class Map(NamedTuple):
    """One photo's depth map."""

    depth: npt.NDArray[np.float32]
    """(H, W) m; 0 where unknown."""
    normals: npt.NDArray[np.float32]
    """(H, W, 3) unit, camera frame, towards the camera."""
    colours: npt.NDArray[np.uint8]
    """(H, W, 3) RGB."""


@numba.njit(cache=True, error_model="numpy")
def _into_other(row, column, depth, pair):  # type: ignore[no-untyped-def]
    """Return where a pixel's point lies in the other camera: pixel (u, v) and depth; depth 0 when behind it."""
    fx, fy, cx, cy = pair.pinhole
    a, b = (column + 0.5 - cx) / fx * depth, (row + 0.5 - cy) / fy * depth
    turn, shift = pair.turn, pair.shift
    z = turn[2, 0] * a + turn[2, 1] * b + turn[2, 2] * depth + shift[2]
    if z <= 1e-9:
        return 0.0, 0.0, 0.0
    x = turn[0, 0] * a + turn[0, 1] * b + turn[0, 2] * depth + shift[0]
    y = turn[1, 0] * a + turn[1, 1] * b + turn[1, 2] * depth + shift[1]
    gx, gy, dx, dy = pair.other_pinhole
    return gx * x / z + dx, gy * y / z + dy, z


@numba.njit(cache=True, error_model="numpy")
def _offset_px(row, column, other_row, other_column, other_depth, pair):  # type: ignore[no-untyped-def]
    """Return the squared distance from a pixel to where the other camera's point is seen, px^2."""
    gx, gy, dx, dy = pair.other_pinhole
    a = (other_column + 0.5 - dx) / gx * other_depth - pair.shift[0]
    b = (other_row + 0.5 - dy) / gy * other_depth - pair.shift[1]
    c = other_depth - pair.shift[2]
    turn = pair.turn
    z = turn[0, 2] * a + turn[1, 2] * b + turn[2, 2] * c
    if z <= 1e-9:
        return np.inf
    x = turn[0, 0] * a + turn[1, 0] * b + turn[2, 0] * c
    y = turn[0, 1] * a + turn[1, 1] * b + turn[2, 1] * c
    fx, fy, cx, cy = pair.pinhole
    across, down = fx * x / z + cx - column - 0.5, fy * y / z + cy - row - 0.5
    return across * across + down * down


@numba.njit(cache=True, error_model="numpy")
def _cosine(normal, other_normal, turn):  # type: ignore[no-untyped-def]
    """Return the cosine between two normals, each in its own camera's frame."""
    total = 0.0
    for i in range(3):
        turned = turn[i, 0] * normal[0] + turn[i, 1] * normal[1] + turn[i, 2] * normal[2]
        total += turned * other_normal[i]
    return total


@numba.njit(cache=True, error_model="numpy")
def _agrees(row, column, first, other, pair):  # type: ignore[no-untyped-def]
    """Return the other map's pixel that agrees with a pixel, (-1, -1) without, and how far the point is there."""
    depth = first.depth[row, column]
    u, v, z = _into_other(row, column, depth, pair)
    if z == 0.0 or not (0.0 <= u < other.depth.shape[1] and 0.0 <= v < other.depth.shape[0]):
        return -1, -1, 0.0  # not in the frame
    other_row, other_column = int(v), int(u)
    seen = other.depth[other_row, other_column]
    if seen <= 0.0 or abs(z - seen) > pair.max_depth_error * seen:
        return -1, -1, z
    if _cosine(first.normals[row, column], other.normals[other_row, other_column], pair.turn) < pair.min_cosine:
        return -1, -1, z
    if _offset_px(row, column, other_row, other_column, seen, pair) > pair.max_reprojection_px**2:
        return -1, -1, z
    return other_row, other_column, z


@numba.njit(cache=True, parallel=True, error_model="numpy")
def confirm(first, other, pair, step, wanted, count):  # type: ignore[no-untyped-def]
    """Add 1 to the (h, w) `count` of the first map's cells with which the other map agrees, up to `wanted`.

    A cell is `step` pixels wide and stands for the pixel in its middle.
    """
    for i in numba.prange(count.shape[0]):
        for j in range(count.shape[1]):
            row, column = step * i + step // 2, step * j + step // 2
            if first.depth[row, column] > 0.0 and count[i, j] < wanted:
                if _agrees(row, column, first, other, pair)[0] >= 0:
                    count[i, j] += 1


@numba.njit(cache=True, parallel=True, error_model="numpy")
def gather(first, other, pair, step, state, other_sure, sums, count, against):  # type: ignore[no-untyped-def]
    """Add what another map says about the SURE cells of the first.

    Args:
        first: whose cells are asked.
        other: the other map.
        pair: their cameras.
        step: width of a cell, px.
        state: (h, w) of the first map's cells.
        other_sure: (h', w') depth at the other map's cells, 0 where it is not sure.
        sums: (h, w, NUM_SUMS) is added to.
        count: (h, w) maps that agree; is added to.
        against: (h, w) maps that see wall behind the point; is added to.
    """
    for i in numba.prange(state.shape[0]):
        for j in range(state.shape[1]):
            if state[i, j] != SURE:
                continue
            row, column = step * i + step // 2, step * j + step // 2
            other_row, other_column, z = _agrees(row, column, first, other, pair)
            if other_row >= 0:
                count[i, j] += 1
                estimate = _depth_on_plane(row, column, other_row, other_column, first, other, pair)
                _add(sums[i, j], estimate, other, other_row, other_column, pair)
            elif z > 0.0 and _sees_behind(row, column, first.depth[row, column], pair, step, other_sure):
                against[i, j] += 1


@numba.njit(cache=True, error_model="numpy")
def _depth_on_plane(row, column, other_row, other_column, first, other, pair):  # type: ignore[no-untyped-def]
    """Return where the plane at the other map's pixel meets the first one's ray, as depth along the first camera."""
    fx, fy, cx, cy = pair.pinhole
    a, b = (column + 0.5 - cx) / fx, (row + 0.5 - cy) / fy
    turn, shift = pair.turn, pair.shift
    x = turn[0, 0] * a + turn[0, 1] * b + turn[0, 2]
    y = turn[1, 0] * a + turn[1, 1] * b + turn[1, 2]
    z = turn[2, 0] * a + turn[2, 1] * b + turn[2, 2]
    gx, gy, dx, dy = pair.other_pinhole
    seen = other.depth[other_row, other_column]
    p = (other_column + 0.5 - dx) / gx * seen - shift[0]
    q = (other_row + 0.5 - dy) / gy * seen - shift[1]
    r = seen - shift[2]
    normal = other.normals[other_row, other_column]
    along = normal[0] * x + normal[1] * y + normal[2] * z
    length = np.sqrt(x * x + y * y + z * z)
    depth = first.depth[row, column]
    if abs(along) > GRAZING * length:
        estimate = (normal[0] * p + normal[1] * q + normal[2] * r) / along
        if abs(estimate - depth) <= 2.0 * pair.max_depth_error * depth:
            return estimate
    return (x * p + y * q + z * r) / (length * length)  # the ray's point nearest to it


@numba.njit(cache=True, error_model="numpy")
def _add(sums, estimate, other, other_row, other_column, pair):  # type: ignore[no-untyped-def]
    """Add one estimate. Stereo errs by the square of the distance, so its weight falls with the fourth power."""
    weight = 1.0 / other.depth[other_row, other_column] ** 4
    sums[0] += weight
    sums[1] += weight * estimate
    sums[2] += weight * estimate * estimate
    normal = other.normals[other_row, other_column]
    for i in range(3):
        turned = pair.turn[0, i] * normal[0] + pair.turn[1, i] * normal[1] + pair.turn[2, i] * normal[2]
        sums[3 + i] += weight * turned
        sums[6 + i] += weight * other.colours[other_row, other_column, i]


@numba.njit(cache=True, error_model="numpy")
def _sees_behind(row, column, depth, pair, step, other_sure):  # type: ignore[no-untyped-def]
    """Return whether the other map sees wall well behind a pixel's point, all around where it would be seen."""
    u, v, z = _into_other(row, column, depth, pair)
    height, width = other_sure.shape
    middle_row, middle_column, num_seen = int(v) // step, int(u) // step, 0
    for r in range(max(middle_row - 1, 0), min(middle_row + 2, height)):
        for c in range(max(middle_column - 1, 0), min(middle_column + 2, width)):
            seen = other_sure[r, c]
            if seen > 0.0:
                if seen < z * (1.0 + BEHIND):
                    return False
                num_seen += 1
    return num_seen >= MIN_BEHIND


@numba.njit(cache=True, parallel=True, error_model="numpy")
def mark(fused, other_sure, pair, step, state):  # type: ignore[no-untyped-def]
    """Write USED to the (h', w') `state` of the other map's cells that show points fused on the first one's rays.

    Args:
        fused: (h, w) depth of the points along the first camera, 0 where there is none.
        other_sure: (h', w') depth at the other map's cells, 0 where it is not sure.
        pair: the cameras.
        step: width of a cell, px.
        state: of the other map's cells. Threads write the same value, so that their order does not matter.
    """
    for i in numba.prange(fused.shape[0]):
        for j in range(fused.shape[1]):
            if fused[i, j] <= 0.0:
                continue
            u, v, z = _into_other(step * i + step // 2, step * j + step // 2, fused[i, j], pair)
            r, c = int(v) // step, int(u) // step
            if z > 0.0 and 0.0 <= u and 0.0 <= v and r < other_sure.shape[0] and c < other_sure.shape[1]:
                seen = other_sure[r, c]
                if seen > 0.0 and abs(z - seen) <= 2.0 * pair.max_depth_error * seen:
                    state[r, c] = USED
