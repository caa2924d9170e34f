"""Sea, sky, rocks and boats by daylight, compiled, a block of pixels at a time (see `pixel_blocks`)."""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.envs.pictures.pixel_blocks import (
    AT,
    BLOCK,
    COLOUR,
    DEPTH,
    EAST,
    FAST,
    GRAIN,
    KINDS,
    NORMAL_X,
    NORMAL_Y,
    NORMAL_Z,
    NORTH,
    NOTHING,
    NUM_INTS,
    OWN_FLOATS,
    UP,
    U,
    V,
    X,
    Y,
    faded,
    look,
    wave,
)
from aquanav_tools.envs.pictures.rock_blocks import fetch_corners, mix_corners, texture_places
from aquanav_tools.envs.pictures.wave_grid import CELL, NEAR_WAVES

FARTHEST = 600.0
"""The sea ends here, m."""
ROUNDS = 2
"""Of finding where a line of sight meets the waves, each from the height of the last; the waves are never steep."""
SUN = np.array([-0.45, 0.35, 0.82]) / np.linalg.norm([-0.45, 0.35, 0.82])
SEEN_DEPTH = 1.2
"""Way through water on which light falls to a third, m: reefs shimmer through."""
REFRACTION = 1.34
HAZE = 350.0
"""Distance on which what is far fades into the sky, m."""
WET = 0.35
"""Rock is dark up to this height over still water, m."""
SAMPLE = 0.09
"""Side of a sample of the rock's texture, m."""
ZENITH, HORIZON, DEEP, SHALLOW = (
    (0.25, 0.47, 0.75), (0.78, 0.86, 0.92), (0.02, 0.13, 0.19), (0.10, 0.35, 0.38)
)  # fmt: skip
ROCK_COLOUR = (0.50, 0.44, 0.37)
ROCK, PAINT = 0, 1
"""What a face is of: rock with its texture, or a thing of one colour."""
BANDS_IN_ROCK = np.array([0.4, 0.0, 5.0])
"""Of its colour in space, rad/m."""
GAMMA = 1.4
TONES = np.round(255.0 * np.linspace(0.0, 1.0, 4096) ** (1.0 / GAMMA)).astype(np.uint8)
"""Bytes of a picture by light from 0 to 1: the darkest tones apart, no step is left out."""
(
    RAY_X, RAY_Y, RAY_Z, SOLID_FAR, SEA_FAR, THROUGH, RED, GREEN, BLUE, TAKEN, NUM_FLOATS
) = (OWN_FLOATS + BLOCK * row for row in (*range(10), 18))  # fmt: skip
"""Rows of floats of these kernels: lines of sight, how far solids and the sea are, the way through the water to what
lies below, m, colours, and from TAKEN on what is looked up."""
BANDS = 3
"""Row of `paint`'s rays behind those of the texture."""
_F = np.float32
_ONE, _NEVER, _LEVEL = _F(1.0), _F(1e9), _F(-1e-4)
_ACROSS = int(2.0 * NEAR_WAVES / CELL) + 1
_SUN_X, _SUN_Y, _SUN_Z = _F(SUN[0]), _F(SUN[1]), _F(SUN[2])


@numba.njit(cache=True, error_model="numpy", nogil=True, fastmath=FAST)
def paint(picture, first, end, seen, nearness, sunken, table, focal, height, rays, view, heights, slopes, tile, tones):  # type: ignore[no-untyped-def]
    """Paint rows of an (H, W, 3) picture.

    Args:
        picture: Is painted on.
        first: Row.
        end: Behind the last row.
        seen: (H, W) row of `table` that stands out of the water, -1 for none.
        nearness: (H, W) one over its depth, 1/m.
        sunken: (H, W) one over the depth of rock as it seems through the water, 1/m; not positive for none.
        table: Of `triangle_table`.
        focal: px.
        height: Of the camera over still water, m.
        rays: (4, 4) coordinates of texture in samples, and BANDS in turns: at the camera, and their change per depth to
            its right, down and ahead.
        view: (3, 3) world from camera.
        heights: (N * N,) of `wave_grid`.
        slopes: (N * N, 2) of `wave_grid`.
        tile: The rock's texture, a word of four channels for each sample.
        tones: `TONES`.
    """
    floats, ints = np.zeros(NUM_FLOATS, np.float32), np.zeros(NUM_INTS, np.int32)
    width = seen.shape[1]
    for row in range(first, end):
        for start in range(0, width, BLOCK):
            _, highest = look(floats, seen[row], nearness[row], table, focal, start, row + 0.5 - 0.5 * len(seen))
            if _sight(floats, view, height):
                for _ in range(ROUNDS):
                    _meet_sea(floats, ints, heights, height)
                _water(floats, ints, slopes, sunken[row], start)
            if highest > NOTHING:
                _solid(floats, ints, seen[row], table, rays, tile, height, start)
            _haze(floats)
            for n in range(min(BLOCK, width - start)):
                picture[row, start + n, 0] = tones[np.uintp(floats[RED + n])]
                picture[row, start + n, 1] = tones[np.uintp(floats[GREEN + n])]
                picture[row, start + n, 2] = tones[np.uintp(floats[BLUE + n])]


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _sight(floats, view, height):  # type: ignore[no-untyped-def]
    """Fill the rows of lines of sight, and colours with the sky's; return whether one looks down."""
    a, b, c = view[0, 0], view[0, 1], view[0, 2]
    d, e, f = view[1, 0], view[1, 1], view[1, 2]
    g, h, i = view[2, 0], view[2, 1], view[2, 2]
    lowest = _ONE
    for n in range(BLOCK):
        x, y, depth = floats[X + n], floats[Y + n], floats[DEPTH + n]
        length = np.sqrt(x * x + y * y + _ONE)
        scale = _ONE / length
        floats[RAY_X + n], floats[RAY_Y + n] = scale * (a * x + b * y + c), scale * (d * x + e * y + f)
        down = scale * (g * x + h * y + i)
        floats[RAY_Z + n] = down
        lowest = min(lowest, down)
        floats[SOLID_FAR + n] = depth * length if floats[KINDS + n] > _F(NOTHING) else _NEVER
        floats[SEA_FAR + n] = -height / down if down < _LEVEL else _NEVER
        up = np.sqrt(max(down, _F(0.0)))
        floats[RED + n], floats[GREEN + n], floats[BLUE + n] = _sky(up)
    return lowest < _LEVEL


@numba.njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def _sky(up):  # type: ignore[no-untyped-def]
    """Return the sky's colour by the root of a direction's height."""
    return (
        _F(HORIZON[0]) + up * _F(ZENITH[0] - HORIZON[0]),
        _F(HORIZON[1]) + up * _F(ZENITH[1] - HORIZON[1]),
        _F(HORIZON[2]) + up * _F(ZENITH[2] - HORIZON[2]),
    )


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _grid_places(floats, ints):  # type: ignore[no-untyped-def]
    """Put the cell of the grid of waves in which each line of sight ends into AT, and where in it into U and V."""
    last = _F(_ACROSS - 1.001)
    for n in range(BLOCK):
        far = floats[SEA_FAR + n]
        column = (far * floats[RAY_X + n] + _F(NEAR_WAVES)) * _F(1.0 / CELL)
        row = (far * floats[RAY_Y + n] + _F(NEAR_WAVES)) * _F(1.0 / CELL)
        column, row = min(max(column, _F(0.0)), last), min(max(row, _F(0.0)), last)
        i, j = np.int32(row), np.int32(column)
        floats[U + n], floats[V + n] = column - _F(j), row - _F(i)
        ints[AT + n] = np.int32(np.int32(i * np.int32(_ACROSS)) + j)


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _meet_sea(floats, ints, heights, height):  # type: ignore[no-untyped-def]
    """Improve SEA_FAR by the sea's height there; far away by that of the grid's border, where it is calm."""
    _grid_places(floats, ints)
    for n in range(BLOCK):
        at = np.uintp(ints[AT + n])
        floats[TAKEN + n], floats[TAKEN + BLOCK + n] = heights[at], heights[at + np.uintp(1)]
        at += np.uintp(_ACROSS)
        floats[TAKEN + 2 * BLOCK + n], floats[TAKEN + 3 * BLOCK + n] = heights[at], heights[at + np.uintp(1)]
    for n in range(BLOCK):
        u, v, down = floats[U + n], floats[V + n], floats[RAY_Z + n]
        before = (_ONE - u) * floats[TAKEN + n] + u * floats[TAKEN + BLOCK + n]
        behind = (_ONE - u) * floats[TAKEN + 2 * BLOCK + n] + u * floats[TAKEN + 3 * BLOCK + n]
        far = ((_ONE - v) * before + v * behind - height) / down
        floats[SEA_FAR + n] = min(far, _F(FARTHEST - 1.0)) if down < _LEVEL else _NEVER


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _water(floats, ints, slopes, sunken, start):  # type: ignore[no-untyped-def]
    """Give the sea its colour: the sky's reflection, the sun's, and what lies below."""
    _grid_places(floats, ints)
    for n in range(BLOCK):
        at = np.uintp(ints[AT + n])
        for corner in range(4):
            slope = slopes[at + np.uintp(corner % 2 + _ACROSS * (corner // 2))]
            row = TAKEN + 2 * corner * BLOCK + n
            floats[row], floats[row + BLOCK] = slope[0], slope[1]
        floats[THROUGH + n] = sunken[min(start + n, len(sunken) - 1)]
    for n in range(BLOCK):
        x, y, far = floats[X + n], floats[Y + n], floats[SEA_FAR + n]
        rx, ry, rz = floats[RAY_X + n], floats[RAY_Y + n], floats[RAY_Z + n]
        u, v = floats[U + n], floats[V + n]
        a, b, c, d = (_ONE - v) * (_ONE - u), (_ONE - v) * u, v * (_ONE - u), v * u
        at = TAKEN + n
        east = a * floats[at] + b * floats[at + 2 * BLOCK] + c * floats[at + 4 * BLOCK] + d * floats[at + 6 * BLOCK]
        at += BLOCK
        north = a * floats[at] + b * floats[at + 2 * BLOCK] + c * floats[at + 4 * BLOCK] + d * floats[at + 6 * BLOCK]
        is_near = max(abs(far * rx), abs(far * ry)) < _F(NEAR_WAVES)
        east, north = east if is_near else _F(0.0), north if is_near else _F(0.0)
        nearness = floats[THROUGH + n]
        through = max(np.sqrt(x * x + y * y + _ONE) / nearness - far, _F(0.0)) if nearness > _F(0.0) else _NEVER
        is_seen = (far < _NEVER) & (far < floats[SOLID_FAR + n])
        red, green, blue = _water_colour(rx, ry, rz, east, north, faded(through * _F(1.0 / SEEN_DEPTH)))
        floats[RED + n] = red if is_seen else floats[RED + n]
        floats[GREEN + n] = green if is_seen else floats[GREEN + n]
        floats[BLUE + n] = blue if is_seen else floats[BLUE + n]


@numba.njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def _water_colour(rx, ry, rz, east, north, clear):  # type: ignore[no-untyped-def]
    """Return the colour of water with slopes east and north, through which a share of what lies below is seen."""
    scale = _ONE / np.sqrt(east * east + north * north + _ONE)
    nx, ny, nz = -east * scale, -north * scale, scale
    facing = min(max(-(rx * nx + ry * ny + rz * nz), _F(0.0)), _ONE)
    twice = _F(2.0) * facing
    mx, my, mz = rx + twice * nx, ry + twice * ny, abs(rz + twice * nz)
    past = _ONE - facing
    fresnel = _F(0.02) + _F(0.98) * past * past * past * past * past
    glitter = _F(1.5) * _glittering(max(mx * _SUN_X + my * _SUN_Y + mz * _SUN_Z, _F(0.0)))
    light, below = (_ONE - clear) * (_F(0.75) + _F(0.5) * facing), _F(1.6) * clear
    red, green, blue = _sky(np.sqrt(mz))
    return (
        (_ONE - fresnel) * (light * _F(DEEP[0]) + below * _F(SHALLOW[0])) + fresnel * red + glitter,
        (_ONE - fresnel) * (light * _F(DEEP[1]) + below * _F(SHALLOW[1])) + fresnel * green + glitter,
        (_ONE - fresnel) * (light * _F(DEEP[2]) + below * _F(SHALLOW[2])) + fresnel * blue + glitter,
    )


@numba.njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def _glittering(towards):  # type: ignore[no-untyped-def]
    """Return the sun's reflection by the cosine of its angle: to the power of 180, by squares."""
    to_4 = towards * towards * towards * towards
    to_16 = to_4 * to_4 * to_4 * to_4
    to_64 = to_16 * to_16 * to_16 * to_16
    return to_64 * to_64 * to_16 * to_16 * to_16 * to_4


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _solid(floats, ints, seen, table, rays, tile, height, start):  # type: ignore[no-untyped-def]
    """Give solids that stand before the sea their colour."""
    texture_places(floats, ints, rays, 0)
    fetch_corners(tile, ints)
    mix_corners(floats, ints)
    for n in range(BLOCK):
        own = table[seen[min(start + n, len(seen) - 1)]]
        floats[TAKEN + n], floats[TAKEN + BLOCK + n] = own[COLOUR], own[COLOUR + 1]
        floats[TAKEN + 2 * BLOCK + n] = own[COLOUR + 2]
    bands_at, bands_x, bands_y, bands_z = rays[BANDS, 0], rays[BANDS, 1], rays[BANDS, 2], rays[BANDS, 3]
    for n in range(BLOCK):
        x, y, depth, far, grey = (
            floats[X + n], floats[Y + n], floats[DEPTH + n], floats[SOLID_FAR + n], floats[GRAIN + n]
        )  # fmt: skip
        is_rock = _F(floats[KINDS + n] == _F(ROCK))
        rough = is_rock * _F(0.45) / (_ONE + _F(0.02) * far)
        nx = depth * floats[NORMAL_X + n] - rough * floats[EAST + n]
        ny = depth * floats[NORMAL_Y + n] - rough * floats[NORTH + n]
        nz = depth * floats[NORMAL_Z + n] - rough * floats[UP + n]
        turns = bands_at + depth * (bands_x * x + bands_y * y + bands_z) + _F(1.5 / (2.0 * np.pi)) * grey
        dry = min(max((height + far * floats[RAY_Z + n]) * _F(1.0 / WET), _F(0.0)), _ONE)
        shade = (_ONE + _F(0.28) * grey + _F(0.08) * wave(turns)) * (_F(0.55) + _F(0.45) * dry)
        scale = _ONE / max(np.sqrt(nx * nx + ny * ny + nz * nz), _F(1e-9))
        sun = max(scale * (nx * _SUN_X + ny * _SUN_Y + nz * _SUN_Z), _F(0.0))
        light = _F(0.35) + _F(0.15) * scale * nz + _F(0.75) * sun
        light *= _ONE + is_rock * (shade - _ONE)
        is_seen = (far < _NEVER) & (far <= floats[SEA_FAR + n])
        floats[RED + n] = light * floats[TAKEN + n] if is_seen else floats[RED + n]
        floats[GREEN + n] = light * floats[TAKEN + BLOCK + n] if is_seen else floats[GREEN + n]
        floats[BLUE + n] = light * floats[TAKEN + 2 * BLOCK + n] if is_seen else floats[BLUE + n]


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _haze(floats):  # type: ignore[no-untyped-def]
    """Let what is far fade into the sky, and turn colours into places in `TONES`."""
    most = _F(len(TONES) - 1)
    for n in range(BLOCK):
        far = min(floats[SOLID_FAR + n], floats[SEA_FAR + n])
        clear = faded(min(far, _F(FARTHEST)) * _F(1.0 / HAZE))
        clear = clear if far < _NEVER else _ONE
        red, green, blue = _sky(np.sqrt(max(floats[RAY_Z + n], _F(0.0))))
        red, green, blue = (
            red + clear * (floats[RED + n] - red), green + clear * (floats[GREEN + n] - green),
            blue + clear * (floats[BLUE + n] - blue),
        )  # fmt: skip
        floats[RED + n] = min(max(red, _F(0.0)), _ONE) * most + _F(0.5)
        floats[GREEN + n] = min(max(green, _F(0.0)), _ONE) * most + _F(0.5)
        floats[BLUE + n] = min(max(blue, _F(0.0)), _ONE) * most + _F(0.5)
