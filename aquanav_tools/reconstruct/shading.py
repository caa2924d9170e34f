"""How wet limestone looks by the light of a lamp on the camera."""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.cave.synthetic.noise import fractal, noise

_SAFE_MATH = {"contract", "reassoc", "arcp", "afn"}
"""Fast arithmetic that still knows NaN, which marks rays that hit nothing."""
_BUMP_STEP = 0.004
"""Distance over which the relief's slope is taken, m."""


@numba.njit(cache=True, parallel=True, error_model="numpy", fastmath=_SAFE_MATH)
def shade(points, normals, lamp, ahead, pixel_angle, absorption, veil, seed):  # type: ignore[no-untyped-def]
    """Return the (N, 3) float32 light that reaches the camera from points on the rock.

    The texture ends at the finest detail a pixel can show, so that it does not shimmer from photo to photo.

    Args:
        points: (N, 3) world, m; a row of NaN looks into open water.
        normals: (N, 3) unit, towards the water.
        lamp: (3,) place of lamp and camera, m.
        ahead: (3,) unit vector along the lamp's beam.
        pixel_angle: Angle of one pixel, radians.
        absorption: (3,) of the water for red, green and blue, 1/m.
        veil: Light that endless water scatters back.
        seed: Picks the texture.
    """
    light = np.empty((len(points), 3), np.float32)
    for n in numba.prange(len(points)):
        x, y, z = points[n, 0], points[n, 1], points[n, 2]
        to_lamp = lamp - points[n]
        distance = np.sqrt(to_lamp[0] ** 2 + to_lamp[1] ** 2 + to_lamp[2] ** 2)
        if np.isnan(distance):
            light[n, 0], light[n, 1], light[n, 2] = 0.35 * veil, 0.8 * veil, veil
            continue
        finest = 0.5 / (pixel_angle * distance)
        facing = _facing(x, y, z, normals[n], to_lamp / distance, finest, seed)
        on_axis = -(to_lamp[0] * ahead[0] + to_lamp[1] * ahead[1] + to_lamp[2] * ahead[2]) / distance
        beam = 0.08 + 0.92 * max(0.0, on_axis) ** 6
        lit = (facing * beam + 0.006) / (distance * distance + 0.3)
        red, green, blue = _rock_colour(x, y, z, finest, seed)
        haze = 1.0 - np.exp(-0.25 * distance)
        light[n, 0] = red * lit * np.exp(-2.0 * absorption[0] * distance) + 0.35 * veil * haze
        light[n, 1] = green * lit * np.exp(-2.0 * absorption[1] * distance) + 0.8 * veil * haze
        light[n, 2] = blue * lit * np.exp(-2.0 * absorption[2] * distance) + veil * haze
    return light


@numba.njit(cache=True, error_model="numpy", fastmath=_SAFE_MATH)
def _facing(x, y, z, normal, to_lamp, finest, seed):  # type: ignore[no-untyped-def]
    """Return the cosine between the rock's bumpy normal and the lamp, at least 0."""
    here = _bump(x, y, z, finest, seed)
    strength = 0.0045 / _BUMP_STEP
    nx = normal[0] - strength * (_bump(x + _BUMP_STEP, y, z, finest, seed) - here)
    ny = normal[1] - strength * (_bump(x, y + _BUMP_STEP, z, finest, seed) - here)
    nz = normal[2] - strength * (_bump(x, y, z + _BUMP_STEP, finest, seed) - here)
    length = np.sqrt(nx * nx + ny * ny + nz * nz)
    return max(0.0, (nx * to_lamp[0] + ny * to_lamp[1] + nz * to_lamp[2]) / length)


@numba.njit(cache=True, error_model="numpy", fastmath=_SAFE_MATH)
def _bump(x, y, z, finest, seed):  # type: ignore[no-untyped-def]
    return fractal(x, y, z, 14.0, 3, 0.6, finest, seed + 101)


@numba.njit(cache=True, error_model="numpy", fastmath=_SAFE_MATH)
def _rock_colour(x, y, z, finest, seed):  # type: ignore[no-untyped-def]
    """Return red, green and blue in [0, 1]: limestone in beds, with grain, dark pits, stains of iron and manganese."""
    grain = 0.17 * fractal(x, y, z, 7.0, 6, 0.88, finest, seed + 211)
    warp = 0.3 * fractal(x, y, z, 0.9, 3, 0.5, finest, seed + 231)
    beds = 0.07 * np.sin(17.0 * (z + warp)) + 0.04 * np.sin(53.0 * (z + warp))
    manganese = min(1.0, max(0.0, 2.5 * fractal(x, y, z, 1.4, 4, 0.6, finest, seed + 201) - 0.5))
    pits = _pits(x, y, z, 9.0, finest, seed + 281) + _pits(x, y, z, 21.0, finest, seed + 291)
    iron = min(1.0, max(0.0, 0.4 + 1.2 * noise(0.6 * x, 0.6 * y, 0.6 * z, seed + 261) + 2.0 * beds))
    grey = min(1.0, max(0.04, (0.5 + grain + beds) * (1.0 - 0.6 * manganese) * (1.0 - 0.55 * min(1.0, pits))))
    return grey * (1.0 + 0.18 * iron), grey * (0.9 + 0.02 * iron), grey * (0.78 - 0.16 * iron)


@numba.njit(cache=True, error_model="numpy", fastmath=_SAFE_MATH)
def _pits(x, y, z, frequency, finest, seed):  # type: ignore[no-untyped-def]
    """Return how deep in a pit of the rock a point is, in [0, 1]: sharp spots, a tenth of the wall."""
    if frequency > finest:
        return 0.0
    # Bent coordinates, or the spots would show the noise's cubic lattice.
    bend = 0.35 * noise(1.7 * frequency * x, 1.7 * frequency * y, 1.7 * frequency * z, seed + 1)
    u, v, w = frequency * (x + 0.6 * y) + bend, frequency * (y + 0.6 * z) - bend, frequency * (z - 0.6 * x) + bend
    return min(1.0, max(0.0, 4.0 * (noise(u, v, w, seed) - 0.42)))
