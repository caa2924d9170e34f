"""The rock's texture for blocks of pixels (see `pixel_blocks`)."""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.envs.pictures.pixel_blocks import (
    BLOCK,
    COLUMN,
    CORNER,
    DEPTH,
    EAST,
    FAST,
    FINE,
    GRAIN,
    LAYER,
    NORTH,
    ROW,
    UP,
    U,
    V,
    W,
    X,
    Y,
)
from aquanav_tools.envs.pictures.rock_tile import RANGE, SIDE

_LAST, _PLANE = np.int32(SIDE - 1), np.int32(SIDE * SIDE)
_PLANES, _ROWS = np.int32(_LAST * _PLANE), np.int32(_LAST * SIDE)
_ONE, _SCALE = np.float32(1.0), np.float32(RANGE / 127.0)


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def texture_places(floats, ints, rays, first):  # type: ignore[no-untyped-def]
    """Put the sample before each pixel's place into LAYER, ROW and COLUMN, and how far beyond it is into U, V and W.

    Args:
        floats: Have X, Y and DEPTH.
        ints: Get LAYER, ROW and COLUMN.
        rays: (N, 4) coordinates in samples: at the camera, and their change per depth to its right, down and ahead.
        first: Row of the coordinate along the texture's first side.
    """
    ax, bx, cx, dx = rays[first, 0], rays[first, 1], rays[first, 2], rays[first, 3]
    ay, by, cy, dy = rays[first + 1, 0], rays[first + 1, 1], rays[first + 1, 2], rays[first + 1, 3]
    az, bz, cz, dz = rays[first + 2, 0], rays[first + 2, 1], rays[first + 2, 2], rays[first + 2, 3]
    for n in range(BLOCK):
        x, y, depth = floats[X + n], floats[Y + n], floats[DEPTH + n]
        tx = ax + depth * (bx * x + cx * y + dx)
        ty = ay + depth * (by * x + cy * y + dy)
        tz = az + depth * (bz * x + cz * y + dz)
        fx, fy, fz = np.floor(tx), np.floor(ty), np.floor(tz)
        floats[U + n], floats[V + n], floats[W + n] = tx - fx, ty - fy, tz - fz
        ints[LAYER + n] = np.int32(np.int32(np.int32(fx) & _LAST) * _PLANE)
        ints[ROW + n] = np.int32(np.int32(np.int32(fy) & _LAST) * np.int32(SIDE))
        ints[COLUMN + n] = np.int32(np.int32(fz) & _LAST)


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def fetch_corners(tile, ints):  # type: ignore[no-untyped-def]
    """Put the texture's eight samples around each pixel's place into the rows from CORNER on."""
    for n in range(BLOCK):
        i, j, k = ints[LAYER + n], ints[ROW + n], ints[COLUMN + n]
        a, b, c = (i + _PLANE) & _PLANES, (j + SIDE) & _ROWS, (k + 1) & _LAST
        # Unsigned, since the compiler else asks at each whether it counts from the end.
        ints[CORNER + n], ints[CORNER + BLOCK + n] = tile[np.uintp(i | j | k)], tile[np.uintp(i | j | c)]
        ints[CORNER + 2 * BLOCK + n], ints[CORNER + 3 * BLOCK + n] = (
            tile[np.uintp(i | b | k)],
            tile[np.uintp(i | b | c)],
        )
        ints[CORNER + 4 * BLOCK + n], ints[CORNER + 5 * BLOCK + n] = (
            tile[np.uintp(a | j | k)],
            tile[np.uintp(a | j | c)],
        )
        ints[CORNER + 6 * BLOCK + n], ints[CORNER + 7 * BLOCK + n] = (
            tile[np.uintp(a | b | k)],
            tile[np.uintp(a | b | c)],
        )


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def fetch_squares(squares, ints):  # type: ignore[no-untyped-def]
    """Put the two words that hold the eight samples of grey around each pixel's place into the rows from CORNER on."""
    for n in range(BLOCK):
        i, rest = ints[LAYER + n], ints[ROW + n] | ints[COLUMN + n]
        ints[CORNER + n], ints[CORNER + BLOCK + n] = (
            squares[np.uintp(i | rest)], squares[np.uintp(((i + _PLANE) & _PLANES) | rest)]
        )  # fmt: skip


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def mix_corners(floats, ints):  # type: ignore[no-untyped-def]
    """Put the four channels between the samples of `fetch_corners`, in standard deviations, into GRAIN to UP."""
    for n in range(BLOCK):
        u, v, w = floats[U + n], floats[V + n], floats[W + n]
        near, far = _SCALE * (_ONE - u), _SCALE * u
        p, q, r, s = (_ONE - v) * (_ONE - w), (_ONE - v) * w, v * (_ONE - w), v * w
        a, b, c, d = (
            ints[CORNER + n],
            ints[CORNER + BLOCK + n],
            ints[CORNER + 2 * BLOCK + n],
            ints[CORNER + 3 * BLOCK + n],
        )
        e, f = ints[CORNER + 4 * BLOCK + n], ints[CORNER + 5 * BLOCK + n]
        g, h = ints[CORNER + 6 * BLOCK + n], ints[CORNER + 7 * BLOCK + n]
        floats[GRAIN + n] = _mixed(a, b, c, d, e, f, g, h, p, q, r, s, near, far, 24)
        floats[EAST + n] = _mixed(a, b, c, d, e, f, g, h, p, q, r, s, near, far, 16)
        floats[NORTH + n] = _mixed(a, b, c, d, e, f, g, h, p, q, r, s, near, far, 8)
        floats[UP + n] = _mixed(a, b, c, d, e, f, g, h, p, q, r, s, near, far, 0)


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def mix_squares(floats, ints):  # type: ignore[no-untyped-def]
    """Put the grey between the samples of `fetch_squares`, in standard deviations, into FINE."""
    for n in range(BLOCK):
        u, v, w = floats[U + n], floats[V + n], floats[W + n]
        near, far = _SCALE * (_ONE - u), _SCALE * u
        p, q, r, s = (_ONE - v) * (_ONE - w), (_ONE - v) * w, v * (_ONE - w), v * w
        a, b = ints[CORNER + n], ints[CORNER + BLOCK + n]
        first = p * _byte(a, 24) + q * _byte(a, 16) + r * _byte(a, 8) + s * _byte(a, 0)
        second = p * _byte(b, 24) + q * _byte(b, 16) + r * _byte(b, 8) + s * _byte(b, 0)
        floats[FINE + n] = near * first + far * second


@numba.njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def _mixed(a, b, c, d, e, f, g, h, p, q, r, s, near, far, up):  # type: ignore[no-untyped-def]
    """Return a byte of eight words, each shifted up by so many bits, between the samples."""
    first = p * _byte(a, up) + q * _byte(b, up) + r * _byte(c, up) + s * _byte(d, up)
    second = p * _byte(e, up) + q * _byte(f, up) + r * _byte(g, up) + s * _byte(h, up)
    return near * first + far * second


@numba.njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def _byte(word, up):  # type: ignore[no-untyped-def]
    """Return a signed byte of a word of four as a float: shifted to its top and down again."""
    return np.float32(np.int32(np.int32(word << up) >> np.int32(24)))
