"""Rock and a vehicle by the light of lamps, compiled, a block of pixels at a time (see `pixel_blocks`)."""

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
    FINE,
    GRAIN,
    KIND,
    KINDS,
    NORMAL_X,
    NORMAL_Y,
    NORMAL_Z,
    NORTH,
    NUM_INTS,
    OWN_FLOATS,
    UP,
    X,
    Y,
    look,
    wave,
)
from aquanav_tools.envs.pictures.rock_blocks import (
    fetch_corners,
    fetch_squares,
    mix_corners,
    mix_squares,
    texture_places,
)
from aquanav_tools.photograph.rock import AMBIENT

ROCK, OPEN, BODY = 0, 1, 2
"""What a face is of: wall, a portal, through which one sees open water, or a vehicle."""
FARTHEST = 30.0
"""Nothing farther off is lit, m: there, a lamp's light is a ten-thousandth of that at 1 m."""
LAMP_SIZE = 0.45
"""Width of a vehicle's array of lamps, m: it dazzles less on near wall than a point would."""
BEYOND = 0.0006, 0.004, 0.006
"""Light of the water beyond an opening."""
PASSING_PER_M = 50.0
"""Of the table of the light that is left after a way through the water: a step is a hundredth of the light at most."""
BODY_AMBIENT = 0.1
"""Light on a vehicle's unlit side, of the lamp's."""
SIZES = 0.024, 0.0057
"""Side of a sample of the rock's texture, m: two layers, the finer one without relief."""
FAINT = 0.12
"""Share of the finer layer from which on it is left out: a pixel is 1.4 of its samples wide there."""
RELIEF = 0.16
"""Slope of the texture's relief, one standard deviation."""
CORNER_LOSS = 0.3
"""Share of the light that the lens loses in the picture's corners."""
COARSE, FINER, IRON, BANDS = 0, 3, 6, 7
"""Rows of `shade`'s rays: places in both layers of texture, and of two waves of colour in turns."""
(
    IS_ROCK, IS_LIT, RED, GREEN, BLUE, PLACE_X, PLACE_Y, PLACE_Z, LIT, PASSED, TABLE_RED, TABLE_GREEN, TABLE_BLUE,
    SUM_RED, SUM_GREEN, SUM_BLUE, NUM_FLOATS
) = (OWN_FLOATS + BLOCK * row for row in range(17))  # fmt: skip
"""Rows of floats of these kernels."""
_F = np.float32
_ONE, _HALF = _F(1.0), _F(0.5)


@numba.njit(cache=True, error_model="numpy", nogil=True, fastmath=FAST)
def shade(light, first, end, seen, nearness, table, lens, rays, view, lamps, passing, veil, tile, squares):  # type: ignore[no-untyped-def]
    """Put what is seen in each pixel of rows from `first` to before `end` into (H, W, 3) light.

    Args:
        light: Gets the light on the sensor.
        first: Row.
        end: Behind the last row.
        seen: (H, W) row of `table`, -1 for the last.
        nearness: (H, W) one over the depth, 1/m.
        table: Of `triangle_table`.
        lens: Focal length, px, and the light's loss in the corners, for a tangent of 1.
        rays: (8, 4) of COARSE, FINER, IRON and BANDS: values at the camera, and their change per depth to its right,
            down and ahead.
        view: (3, 3) world from camera.
        lamps: (N, 8) place from the camera, m, direction, power, and 1 for a vehicle's own, which does not shine on it.
        passing: (M, 3) light that is left after a way.
        veil: (K, 3) light of the water by distance.
        tile: The rock's texture, a word of four channels for each sample.
        squares: Its first channel, a word of four samples.
    """
    floats, ints = np.zeros(NUM_FLOATS, np.float32), np.zeros(NUM_INTS, np.int32)
    width = seen.shape[1]
    for row in range(first, end):
        for start in range(0, width, BLOCK):
            kinds = look(floats, seen[row], nearness[row], table, lens[0], start, row + 0.5 - 0.5 * len(seen))
            _begin(floats)
            _rock(floats, ints, rays, tile, squares, lens)
            _relief(floats, view)
            if kinds[1] == BODY:
                _body(floats, seen[row], table, start)
            for n in range(len(lamps)):
                _lamp(floats, ints, lamps[n], passing)
            _through_water(floats, ints, lens, lamps[0, 6], veil)
            for n in range(min(BLOCK, width - start)):
                light[row, start + n, 0] = floats[SUM_RED + n]
                light[row, start + n, 1] = floats[SUM_GREEN + n]
                light[row, start + n, 2] = floats[SUM_BLUE + n]


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _begin(floats):  # type: ignore[no-untyped-def]
    """Fill the rows of what is lit, and of the light beyond openings, and give what is not lit its distance."""
    for n in range(BLOCK):
        kind = floats[KINDS + n]
        is_rock, is_lit = kind == _F(ROCK), (kind == _F(ROCK)) | (kind == _F(BODY))
        floats[IS_ROCK + n], floats[IS_LIT + n] = _F(is_rock), _F(is_lit)
        floats[DEPTH + n] = floats[DEPTH + n] if is_lit else _F(FARTHEST)
        is_open = _F(kind == _F(OPEN))
        floats[SUM_RED + n], floats[SUM_GREEN + n] = is_open * _F(BEYOND[0]), is_open * _F(BEYOND[1])
        floats[SUM_BLUE + n] = is_open * _F(BEYOND[2])


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _rock(floats, ints, rays, tile, squares, lens):  # type: ignore[no-untyped-def]
    """Fill RED, GREEN and BLUE with the rock's colour, and EAST, NORTH and UP with its relief's slope."""
    texture_places(floats, ints, rays, COARSE)
    fetch_corners(tile, ints)
    mix_corners(floats, ints)
    nearest = floats[DEPTH]
    for n in range(BLOCK):
        nearest = min(nearest, floats[DEPTH + n])
    if _fine_share(nearest / lens[0]) > _F(0.0):
        texture_places(floats, ints, rays, FINER)
        fetch_squares(squares, ints)
        mix_squares(floats, ints)
    _colour(floats, rays, lens)


@numba.njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def _fine_share(pixel):  # type: ignore[no-untyped-def]
    """Return how much of the finer layer is seen with a pixel's size, m."""
    share = min(_ONE, _F(0.5 * SIZES[1]) / pixel)
    return (share * share - _F(FAINT)) * _F(1.0 / (1.0 - FAINT))


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _colour(floats, rays, lens):  # type: ignore[no-untyped-def]
    iron_at, iron_x, iron_y, iron_z = rays[IRON, 0], rays[IRON, 1], rays[IRON, 2], rays[IRON, 3]
    layer_at, layer_x, layer_y, layer_z = rays[BANDS, 0], rays[BANDS, 1], rays[BANDS, 2], rays[BANDS, 3]
    shrink = _ONE / lens[0]
    for n in range(BLOCK):
        x, y, depth, grain = floats[X + n], floats[Y + n], floats[DEPTH + n], floats[GRAIN + n]
        pixel = shrink * depth
        slope = _F(RELIEF) * min(_ONE, _F(0.5 * SIZES[0]) / pixel)
        floats[EAST + n], floats[NORTH + n] = slope * floats[EAST + n], slope * floats[NORTH + n]
        floats[UP + n] = slope * floats[UP + n]
        share = max(_F(0.0), _fine_share(pixel))
        shown = _F(0.48) + _F(0.15) * grain + _F(0.11) * share * floats[FINE + n]
        turns = iron_at + depth * (iron_x * x + iron_y * y + iron_z) + _F(1.2 / (2.0 * np.pi)) * grain
        iron = _HALF + _HALF * wave(turns)
        turns = layer_at + depth * (layer_x * x + layer_y * y + layer_z)
        turns += _F(3.0 / (2.0 * np.pi)) * iron + _F(0.8 / (2.0 * np.pi)) * grain
        shown = min(_ONE, max(_F(0.05), shown + _F(0.06) * wave(turns)))
        floats[RED + n], floats[GREEN + n] = shown * (_ONE + _F(0.22) * iron), shown * (_F(0.92) + _F(0.02) * iron)
        floats[BLUE + n] = shown * (_F(0.82) - _F(0.18) * iron)


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _relief(floats, view):  # type: ignore[no-untyped-def]
    """Tilt the normals of rock by its relief and fill the rows of places from the camera."""
    a, b, c = view[0, 0], view[0, 1], view[0, 2]
    d, e, f = view[1, 0], view[1, 1], view[1, 2]
    g, h, i = view[2, 0], view[2, 1], view[2, 2]
    for n in range(BLOCK):
        x, y, depth, is_rock = floats[X + n], floats[Y + n], floats[DEPTH + n], floats[IS_ROCK + n]
        floats[PLACE_X + n] = depth * (a * x + b * y + c)
        floats[PLACE_Y + n] = depth * (d * x + e * y + f)
        floats[PLACE_Z + n] = depth * (g * x + h * y + i)
        nx, ny, nz = depth * floats[NORMAL_X + n], depth * floats[NORMAL_Y + n], depth * floats[NORMAL_Z + n]
        sx, sy, sz = is_rock * floats[EAST + n], is_rock * floats[NORTH + n], is_rock * floats[UP + n]
        along = _ONE + sx * nx + sy * ny + sz * nz
        nx, ny, nz = along * nx - sx, along * ny - sy, along * nz - sz
        scale = _ONE / max(np.sqrt(nx * nx + ny * ny + nz * nz), _F(1e-9))
        floats[NORMAL_X + n], floats[NORMAL_Y + n], floats[NORMAL_Z + n] = scale * nx, scale * ny, scale * nz


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _body(floats, seen, table, start):  # type: ignore[no-untyped-def]
    """Give what is seen of a vehicle its own colour."""
    for n in range(min(BLOCK, len(seen) - start)):
        triangle = seen[start + n]
        if triangle >= 0 and table[triangle, KIND] == BODY:
            floats[RED + n], floats[GREEN + n] = table[triangle, COLOUR], table[triangle, COLOUR + 1]
            floats[BLUE + n] = table[triangle, COLOUR + 2]


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _lamp(floats, ints, lamp, passing):  # type: ignore[no-untyped-def]
    """Add the light of a lamp to SUM_RED, SUM_GREEN and SUM_BLUE."""
    px, py, pz, ahead_x, ahead_y, ahead_z = lamp[0], lamp[1], lamp[2], lamp[3], lamp[4], lamp[5]
    power, is_own, last = lamp[6], lamp[7], _F(len(passing) - 1)
    for n in range(BLOCK):
        x, y, is_rock = floats[X + n], floats[Y + n], floats[IS_ROCK + n]
        lx, ly, lz = px - floats[PLACE_X + n], py - floats[PLACE_Y + n], pz - floats[PLACE_Z + n]
        square = lx * lx + ly * ly + lz * lz
        way = np.sqrt(square)
        nearness = _ONE / way
        facing = floats[NORMAL_X + n] * lx + floats[NORMAL_Y + n] * ly + floats[NORMAL_Z + n] * lz
        facing = max(_F(0.0), facing * nearness)
        cosine = max(_F(0.0), -(ahead_x * lx + ahead_y * ly + ahead_z * lz) * nearness)
        ambient = _F(BODY_AMBIENT) + is_rock * _F(AMBIENT - BODY_AMBIENT)
        # A vehicle's own lamps do not shine on itself.
        lit = floats[IS_LIT + n] * (_ONE - is_own * (_ONE - is_rock)) * power
        lit *= (facing * _beam(cosine) + ambient) / (square + _F(LAMP_SIZE * LAMP_SIZE))
        far = floats[DEPTH + n] * np.sqrt(x * x + y * y + _ONE)
        floats[LIT + n] = lit
        ints[AT + n] = np.int32(min((way + far) * _F(PASSING_PER_M), last))
    for n in range(BLOCK):
        left = passing[ints[AT + n]]
        floats[TABLE_RED + n], floats[TABLE_GREEN + n], floats[TABLE_BLUE + n] = left[0], left[1], left[2]
    for n in range(BLOCK):
        lit = floats[LIT + n]
        floats[SUM_RED + n] += lit * floats[RED + n] * floats[TABLE_RED + n]
        floats[SUM_GREEN + n] += lit * floats[GREEN + n] * floats[TABLE_GREEN + n]
        floats[SUM_BLUE + n] += lit * floats[BLUE + n] * floats[TABLE_BLUE + n]


@numba.njit(cache=True, error_model="numpy", fastmath=FAST, inline="always")
def _beam(cosine):  # type: ignore[no-untyped-def]
    """Return `photograph.rock.beam` of a cosine that is not negative."""
    square = cosine * cosine
    return _F(0.08) + _F(0.92) * square * square * square


@numba.njit(cache=True, error_model="numpy", fastmath=FAST)
def _through_water(floats, ints, lens, power, veil):  # type: ignore[no-untyped-def]
    """Add the light that the water sends back, and take off what the lens loses."""
    last, loss = _F(len(veil) - 1), lens[1]
    for n in range(BLOCK):
        x, y = floats[X + n], floats[Y + n]
        length = np.sqrt(x * x + y * y + _ONE)
        floats[LIT + n] = power * _beam(_ONE / length)
        floats[PASSED + n] = _ONE - loss * (x * x + y * y)
        ints[AT + n] = np.int32(min(floats[DEPTH + n] * length * _F(1.0 / FARTHEST), _ONE) * last)
    for n in range(BLOCK):
        back = veil[ints[AT + n]]
        floats[TABLE_RED + n], floats[TABLE_GREEN + n], floats[TABLE_BLUE + n] = back[0], back[1], back[2]
    for n in range(BLOCK):
        passed, strength = floats[PASSED + n], floats[LIT + n]
        floats[SUM_RED + n] = passed * (floats[SUM_RED + n] + strength * floats[TABLE_RED + n])
        floats[SUM_GREEN + n] = passed * (floats[SUM_GREEN + n] + strength * floats[TABLE_GREEN + n])
        floats[SUM_BLUE + n] = passed * (floats[SUM_BLUE + n] + strength * floats[TABLE_BLUE + n])
