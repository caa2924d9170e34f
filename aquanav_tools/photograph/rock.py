"""How wet limestone looks by the light of a lamp on the camera."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.synthetic.noise import fade, fractal, lattice_value, noise
from aquanav_tools.types import Array

_FAST_MATH = {"contract", "reassoc", "arcp", "afn"}
RELIEF = 0.0045
"""Height of the finest relief that shows in the shading alone, m."""
AMBIENT = 0.006
"""Light that comes by way of other walls, of the lamp's."""
MUD = 0.42
"""Reflectance of a wall without texture: about the mean of the rich one."""


def shade(
    points: Array, normals: Array, lamp: Array, ahead: Array, pixel_angle: float, contrast: float, seed: int
) -> npt.NDArray[np.float32]:
    """Return the (N, 3) light that points on the rock send back: 1 for a white wall that faces it at 1 m.

    The texture ends at the finest detail a pixel can show, so that it does not shimmer from photo to photo.

    Args:
        points: (N, 3) world, m; a row of NaN looks into open water, which sends nothing.
        normals: (N, 3) unit, towards the water.
        lamp: (3,) its place, m; the camera is near.
        ahead: (3,) unit vector along the lamp's beam.
        pixel_angle: Angle of one pixel, radians.
        contrast: Of the texture and the relief, 1 for limestone, 0 for a bare wall.
        seed: Picks the texture.
    """
    light = np.zeros((len(points), 3), np.float32)
    # Told apart here: compilers that may reorder arithmetic have been seen to drop a test for NaN.
    is_rock = ~np.isnan(points).any(axis=1)
    light[is_rock] = _shade(points[is_rock], normals[is_rock], lamp, ahead, pixel_angle, contrast, seed)
    return light


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=_FAST_MATH)
def _shade(points, normals, lamp, ahead, pixel_angle, contrast, seed):  # type: ignore[no-untyped-def]
    light = np.empty((len(points), 3), np.float32)
    for n in numba.prange(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        to_lamp = lamp - points[n]
        distance = np.sqrt(to_lamp[0] ** 2 + to_lamp[1] ** 2 + to_lamp[2] ** 2)
        finest = 0.5 / (pixel_angle * distance)
        facing = _facing(x, y, z, normals[n], to_lamp / distance, finest, contrast, seed)
        on_axis = -(to_lamp[0] * ahead[0] + to_lamp[1] * ahead[1] + to_lamp[2] * ahead[2]) / distance
        lit = (facing * beam(on_axis) + AMBIENT) / (distance * distance)
        red, green, blue = _rock_colour(x, y, z, finest, contrast, seed)
        light[n, 0], light[n, 1], light[n, 2] = red * lit, green * lit, blue * lit
    return light


@numba.njit(cache=True, error_model="numpy", fastmath=False)
def beam(on_axis):  # type: ignore[no-untyped-def]
    """Return the lamp's light towards a direction with this cosine to its axis, 1 on it."""
    return 0.08 + 0.92 * np.maximum(0.0, on_axis) ** 6


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST_MATH)
def _facing(x, y, z, normal, to_lamp, finest, contrast, seed):  # type: ignore[no-untyped-def]
    """Return the cosine between the rock's bumpy normal and the lamp, at least 0."""
    sx, sy, sz = _relief_slope(x, y, z, finest, seed + 101)
    height = contrast * RELIEF
    nx, ny, nz = normal[0] - height * sx, normal[1] - height * sy, normal[2] - height * sz
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    return max(0.0, (nx * to_lamp[0] + ny * to_lamp[1] + nz * to_lamp[2]) / length)


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST_MATH)
def _relief_slope(x, y, z, finest, seed):  # type: ignore[no-untyped-def]
    """Return the gradient of fractal(x, y, z, 14.0, 3, 0.6, finest, seed), per m."""
    sx, sy, sz, amplitude, frequency = 0.0, 0.0, 0.0, 1.0, 14.0
    for octave in range(3):
        if frequency >= finest:
            break
        gain = amplitude * frequency * min(1.0, (finest - frequency) / frequency)
        shift = 17.3 * octave
        dx, dy, dz = _noise_slope(
            x * frequency + shift, y * frequency - 0.53 * shift, z * frequency + 0.21 * shift, seed + octave
        )
        sx, sy, sz = sx + gain * dx, sy + gain * dy, sz + gain * dz
        amplitude *= 0.6
        frequency *= 2.0
    return sx, sy, sz


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST_MATH)
def _noise_slope(x, y, z, seed):  # type: ignore[no-untyped-def]
    """Return the gradient of noise(x, y, z, seed): a quarter of the work of four samples of it."""
    fx, fy, fz = math.floor(x), math.floor(y), math.floor(z)
    i, j, k = int(fx), int(fy), int(fz)
    tx, ty, tz = x - fx, y - fy, z - fz
    u, v, w = fade(tx), fade(ty), fade(tz)
    a, b = lattice_value(i, j, k, seed), lattice_value(i + 1, j, k, seed)
    c, d = lattice_value(i, j + 1, k, seed), lattice_value(i + 1, j + 1, k, seed)
    e, f = lattice_value(i, j, k + 1, seed), lattice_value(i + 1, j, k + 1, seed)
    g, h = lattice_value(i, j + 1, k + 1, seed), lattice_value(i + 1, j + 1, k + 1, seed)
    ab, cd, ef, gh = a + u * (b - a), c + u * (d - c), e + u * (f - e), g + u * (h - g)
    along_x = ((b - a) * (1 - v) + (d - c) * v) * (1 - w) + ((f - e) * (1 - v) + (h - g) * v) * w
    along_y = (cd - ab) * (1 - w) + (gh - ef) * w
    along_z = (ef - ab) * (1 - v) + (gh - cd) * v
    return _fade_slope(tx) * along_x, _fade_slope(ty) * along_y, _fade_slope(tz) * along_z


@numba.njit(cache=True, inline="always")
def _fade_slope(t):  # type: ignore[no-untyped-def]
    """Return the derivative of fade(t)."""
    return 30.0 * t * t * (t - 1.0) * (t - 1.0)


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST_MATH)
def _rock_colour(x, y, z, finest, contrast, seed):  # type: ignore[no-untyped-def]
    """Return red, green and blue in [0, 1]: limestone in beds, with grain, dark pits, stains of iron and manganese."""
    grain = 0.17 * fractal(x, y, z, 7.0, 6, 0.88, finest, seed + 211)
    warp = 0.3 * fractal(x, y, z, 0.9, 3, 0.5, finest, seed + 231)
    beds = 0.07 * np.sin(17.0 * (z + warp)) + 0.04 * np.sin(53.0 * (z + warp))
    manganese = min(1.0, max(0.0, 2.5 * fractal(x, y, z, 1.4, 4, 0.6, finest, seed + 201) - 0.5))
    pits = _pits(x, y, z, 9.0, finest, seed + 281) + _pits(x, y, z, 21.0, finest, seed + 291)
    iron = min(1.0, max(0.0, 0.4 + 1.2 * noise(0.6 * x, 0.6 * y, 0.6 * z, seed + 261) + 2.0 * beds))
    rich = (0.5 + grain + beds) * (1.0 - 0.6 * manganese) * (1.0 - 0.55 * min(1.0, pits))
    grey = min(1.0, max(0.04, MUD + contrast * (rich - MUD)))
    return grey * (1.0 + 0.18 * iron), grey * (0.9 + 0.02 * iron), grey * (0.78 - 0.16 * iron)


@numba.njit(cache=True, error_model="numpy", fastmath=_FAST_MATH)
def _pits(x, y, z, frequency, finest, seed):  # type: ignore[no-untyped-def]
    """Return how deep in a pit of the rock a point is, in [0, 1]: sharp spots, a tenth of the wall."""
    if frequency > finest:
        return 0.0
    # Bent coordinates, or the spots would show the noise's cubic lattice.
    bend = 0.35 * noise(1.7 * frequency * x, 1.7 * frequency * y, 1.7 * frequency * z, seed + 1)
    u, v, w = frequency * (x + 0.6 * y) + bend, frequency * (y + 0.6 * z) - bend, frequency * (z - 0.6 * x) + bend
    return min(1.0, max(0.0, 4.0 * (noise(u, v, w, seed) - 0.42)))
