"""Sea, sky, rocks and boats by daylight, a pixel at a time, compiled."""

from __future__ import annotations

import functools

import numba
import numpy as np

from aquanav_tools.envs.pictures.rock_tile import look_up
from aquanav_tools.envs.pictures.triangles import corner_shares
from aquanav_tools.sim.sea_water import SeaWater
from aquanav_tools.types import Array

FARTHEST = 600.0
"""The sea ends here, m."""
ROUNDS = 2
"""Of finding where a line of sight meets the waves, each from the height of the last; the waves are never steep."""
CALM_FROM = 20.0
"""Waves farther off are finer than the picture's pixels: they fade over this distance, m."""
NEAR_WAVES, CELL = 60.0, 0.4
"""How far from the camera the waves are summed up, on squares of this side, m: a twentieth of them is left there."""
SUN = np.array([-0.45, 0.35, 0.82]) / np.linalg.norm([-0.45, 0.35, 0.82])
SEEN_DEPTH = 1.2
"""Way through water on which light falls to a third, m: reefs shimmer through."""
REFRACTION = 1.34
HAZE = 350.0
"""Distance on which what is far fades into the sky, m."""
WET = 0.35
"""Rock is dark up to this height over still water, m."""
GRAIN = 0.09
"""Side of a sample of the rock's texture, m."""
ZENITH, HORIZON, DEEP, SHALLOW = (
    (0.25, 0.47, 0.75), (0.78, 0.86, 0.92), (0.02, 0.13, 0.19), (0.10, 0.35, 0.38)
)  # fmt: skip
ROCK_COLOUR = (0.50, 0.44, 0.37)
ROCK, PAINT = 0, 1
"""What a face is of: rock with its texture, or a thing of one colour."""
GAMMA = 1.4
TONES = np.round(255.0 * np.linspace(0.0, 1.0, 4096) ** (1.0 / GAMMA)).astype(np.uint8)
"""Bytes of a picture by light from 0 to 1: the darkest tones apart, no step is left out."""
_FAST = {"contract", "reassoc", "arcp", "afn", "nsz"}
"""Fast arithmetic that still knows infinity: what is not met."""


def wave_grid(centre: Array, water: SeaWater) -> tuple[Array, Array]:
    """Return the (2,) corner of a grid around a camera, m, and its (N, N, 3) heights and slopes by north and east."""
    corner = centre[:2] - NEAR_WAVES
    fading = _fading()
    heights = _heights(*water.waves, corner, len(fading)) * fading
    slopes = np.gradient(heights, CELL)
    return corner, np.stack([heights, slopes[1], slopes[0]], axis=-1, dtype=np.float32, casting="same_kind")


@functools.cache
def _fading() -> Array:
    """Return (N, N) how much of the waves is left on a grid around a camera."""
    along = CELL * np.arange(int(2.0 * NEAR_WAVES / CELL) + 1) - NEAR_WAVES
    left: Array = np.exp(-np.hypot(along[None, :], along[:, None]) / CALM_FROM)
    return left


def _heights(waves: Array, phases: Array, corner: Array, count: int) -> Array:
    """Return the (count, count) sums of all waves, rows by north: cosines of sums of a row's and a column's phase."""
    east, north, amplitude = waves[:, 0], waves[:, 1], waves[:, 4]
    across = np.outer(east, corner[0] + CELL * np.arange(count))
    up = np.outer(corner[1] + CELL * np.arange(count), north) - phases
    factors = np.concatenate([amplitude * np.cos(up), -amplitude * np.sin(up)], axis=1)
    heights: Array = _product(factors, np.concatenate([np.cos(across), np.sin(across)]))
    return heights


@numba.njit(cache=True, error_model="numpy", nogil=True)
def _product(left, right):  # type: ignore[no-untyped-def]
    """Return the product of two matrices: a library's threads would wait for the one that encodes the film."""
    result = np.zeros((len(left), right.shape[1]))
    for row in range(len(left)):
        for n in range(len(right)):
            factor = left[row, n]
            for column in range(right.shape[1]):
                result[row, column] += factor * right[n, column]
    return result


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST)
def _height_at(corner, grid, x, y):  # type: ignore[no-untyped-def]
    """Return the sea's height over still water at a place, m; far away that of the grid's border, where it is calm."""
    last = len(grid) - 1.001
    column = min(max((x - corner[0]) / CELL, 0.0), last)
    row = min(max((y - corner[1]) / CELL, 0.0), last)
    i, j = np.uint32(row), np.uint32(column)
    u, v = column - j, row - i
    before = (1.0 - u) * grid[i, j, 0] + u * grid[i, j + 1, 0]
    return (1.0 - v) * before + v * ((1.0 - u) * grid[i + 1, j, 0] + u * grid[i + 1, j + 1, 0])


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST)
def _wave_at(corner, grid, x, y):  # type: ignore[no-untyped-def]
    """Return the sea's height over still water at a place, m, and its slopes eastwards and northwards."""
    column, row = (x - corner[0]) / CELL, (y - corner[1]) / CELL
    last = len(grid) - 1
    if not (0.0 <= column < last and 0.0 <= row < last):
        return 0.0, 0.0, 0.0
    i, j = int(row), int(column)
    u, v = column - j, row - i
    a, b, c, d = (1.0 - v) * (1.0 - u), (1.0 - v) * u, v * (1.0 - u), v * u
    return (
        a * grid[i, j, 0] + b * grid[i, j + 1, 0] + c * grid[i + 1, j, 0] + d * grid[i + 1, j + 1, 0],
        a * grid[i, j, 1] + b * grid[i, j + 1, 1] + c * grid[i + 1, j, 1] + d * grid[i + 1, j + 1, 1],
        a * grid[i, j, 2] + b * grid[i, j + 1, 2] + c * grid[i + 1, j, 2] + d * grid[i + 1, j + 1, 2],
    )


@numba.njit(cache=True, error_model="numpy", nogil=True, fastmath=_FAST)
def paint(picture, first, end, seen, nearness, sunken, solid, view, sea, tile, tones):  # type: ignore[no-untyped-def]
    """Paint rows of an (H, W, 3) picture.

    Args:
        picture: Is painted on.
        first: Row.
        end: Behind the last row.
        seen: (H, W) face of what stands out of the water, -1 for none.
        nearness: (H, W) one over its depth, 1/m.
        sunken: (H, W) one over the depth of rock as it seems through the water, 1/m.
        solid: Vertices, their normals and colours, faces and the kind of each.
        view: Camera's centre, its rotation and focal length.
        sea: Corner and grid of the waves.
        tile: The rock's texture.
        tones: `TONES`.
    """
    vertices, normals, colours, faces, kinds = solid
    centre, turn, focal = view
    corner, grid = sea
    height, width = seen.shape
    for row in range(first, end):
        for column in range(width):
            x, y = (column + 0.5 - 0.5 * width) / focal, (row + 0.5 - 0.5 * height) / focal
            length = np.sqrt(x * x + y * y + 1.0)
            x, y, ahead = x / length, y / length, 1.0 / length
            rx = x * turn[0, 0] + y * turn[1, 0] + ahead * turn[2, 0]
            ry = x * turn[0, 1] + y * turn[1, 1] + ahead * turn[2, 1]
            rz = x * turn[0, 2] + y * turn[1, 2] + ahead * turn[2, 2]
            face = seen[row, column]
            solid_far = length / nearness[row, column] if face >= 0 else np.inf
            sea_far = _to_sea(centre, rx, ry, rz, corner, grid)
            far = min(solid_far, sea_far)
            if far == np.inf:
                red, green, blue = _sky(rz)
            elif solid_far <= sea_far:
                px, py, pz = centre[0] + far * rx, centre[1] + far * ry, centre[2] + far * rz
                red, green, blue = _solid(vertices, normals, colours, faces[face], kinds[face], tile, px, py, pz, far)
            else:
                through = length / sunken[row, column] - far if sunken[row, column] > 0.0 else np.inf
                px, py = centre[0] + far * rx, centre[1] + far * ry
                red, green, blue = _water(rx, ry, rz, _wave_at(corner, grid, px, py), through)
            if far < np.inf:
                haze = 1.0 - np.exp(-min(far, FARTHEST) / HAZE)
                sky = _sky(rz)
                red, green = red + haze * (sky[0] - red), green + haze * (sky[1] - green)
                blue += haze * (sky[2] - blue)
            picture[row, column, 0] = _tone(tones, red)
            picture[row, column, 1] = _tone(tones, green)
            picture[row, column, 2] = _tone(tones, blue)


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST)
def _tone(tones, value):  # type: ignore[no-untyped-def]
    return tones[int(min(max(value, 0.0), 1.0) * (len(tones) - 1) + 0.5)]


@numba.njit(cache=True, error_model="numpy", fastmath=False)
def _to_sea(centre, rx, ry, rz, corner, grid):  # type: ignore[no-untyped-def]
    """Return how far the sea is along a line of sight, m; infinity where it never meets it."""
    if rz > -1e-4:
        return np.inf
    far = -centre[2] / rz
    for _ in range(ROUNDS):
        rise = _height_at(corner, grid, centre[0] + far * rx, centre[1] + far * ry)
        far = (rise - centre[2]) / rz
    return min(far, FARTHEST - 1.0)


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST)
def _sky(rz):  # type: ignore[no-untyped-def]
    up = np.sqrt(max(rz, 0.0))
    return (
        HORIZON[0] + up * (ZENITH[0] - HORIZON[0]),
        HORIZON[1] + up * (ZENITH[1] - HORIZON[1]),
        HORIZON[2] + up * (ZENITH[2] - HORIZON[2]),
    )


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST)
def _water(rx, ry, rz, wave, through):  # type: ignore[no-untyped-def]
    """Return the colour of the water: the sky's reflection, the sun's, and what lies below, `through` m away."""
    _, east, north = wave
    scale = 1.0 / np.sqrt(east * east + north * north + 1.0)
    nx, ny, nz = -east * scale, -north * scale, scale
    facing = min(max(-(rx * nx + ry * ny + rz * nz), 0.0), 1.0)
    mx, my, mz = rx + 2.0 * facing * nx, ry + 2.0 * facing * ny, abs(rz + 2.0 * facing * nz)
    fresnel = 0.02 + 0.98 * (1.0 - facing) ** 5
    towards = max(mx * SUN[0] + my * SUN[1] + mz * SUN[2], 0.0)
    glitter = 1.5 * _glittering(towards)
    clear = np.exp(-max(through, 0.0) / SEEN_DEPTH) if through < np.inf else 0.0
    light = (1.0 - clear) * (0.75 + 0.5 * facing)
    sky = _sky(mz)
    return (
        (1.0 - fresnel) * (light * DEEP[0] + clear * 1.6 * SHALLOW[0]) + fresnel * sky[0] + glitter,
        (1.0 - fresnel) * (light * DEEP[1] + clear * 1.6 * SHALLOW[1]) + fresnel * sky[1] + glitter,
        (1.0 - fresnel) * (light * DEEP[2] + clear * 1.6 * SHALLOW[2]) + fresnel * sky[2] + glitter,
    )


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST)
def _glittering(towards):  # type: ignore[no-untyped-def]
    """Return the sun's reflection by the cosine of its angle: to the power of 180, by squares."""
    to_4 = towards * towards * towards * towards
    to_16 = to_4 * to_4 * to_4 * to_4
    to_64 = to_16 * to_16 * to_16 * to_16
    return to_64 * to_64 * to_16 * to_16 * to_16 * to_4


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST)
def _solid(vertices, normals, colours, corners, kind, tile, x, y, z, far):  # type: ignore[no-untyped-def]
    """Return the colour of a place on a triangle."""
    i, j, k = corners[0], corners[1], corners[2]
    a, b = corner_shares(vertices[i], vertices[j], vertices[k], x, y, z)
    c = 1.0 - a - b
    nx = a * normals[i, 0] + b * normals[j, 0] + c * normals[k, 0]
    ny = a * normals[i, 1] + b * normals[j, 1] + c * normals[k, 1]
    nz = a * normals[i, 2] + b * normals[j, 2] + c * normals[k, 2]
    red, green, blue = colours[i, 0], colours[i, 1], colours[i, 2]
    if kind == ROCK:
        grey, east, north, up = look_up(tile, x / GRAIN, y / GRAIN, z / GRAIN)
        rough = 0.45 / (1.0 + 0.02 * far)
        nx, ny, nz = nx - rough * east, ny - rough * north, nz - rough * up
        layers = 0.08 * np.sin(5.0 * z + 0.4 * x + 1.5 * grey)
        shade = (1.0 + 0.28 * grey + layers) * (0.55 + 0.45 * min(max(z / WET, 0.0), 1.0))
        red, green, blue = shade * red, shade * green, shade * blue
    scale = 1.0 / max(np.sqrt(nx * nx + ny * ny + nz * nz), 1e-9)
    sun = max(scale * (nx * SUN[0] + ny * SUN[1] + nz * SUN[2]), 0.0)
    light = 0.35 + 0.15 * scale * nz + 0.75 * sun
    return red * light, green * light, blue * light
