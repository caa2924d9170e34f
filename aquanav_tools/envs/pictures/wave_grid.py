"""The waves around a camera: heights and slopes on a grid that moves along with it."""

from __future__ import annotations

import functools

import numba
import numpy as np

from aquanav_tools.envs.pictures.bands import in_bands
from aquanav_tools.envs.pictures.pixel_blocks import FAST
from aquanav_tools.photograph.water import FloatImage
from aquanav_tools.sim.sea_water import SeaWater
from aquanav_tools.types import Array

CALM_FROM = 20.0
"""Waves farther off are finer than the picture's pixels: they fade over this distance, m."""
NEAR_WAVES, CELL = 60.0, 0.4
"""How far from the camera the waves are summed up, on squares of this side, m: a twentieth of them is left there."""
TERMS = 8
"""Of the sums that are added at once: so many numbers of a row are read for one that is written."""


def wave_grid(centre: Array, water: SeaWater) -> tuple[FloatImage, FloatImage]:
    """Return heights and slopes of the sea on a grid around a camera, that begins NEAR_WAVES south-west of it.

    Returns:
        (N, N) heights over still water, m, rows by north; and (N, N, 2) slopes eastwards and northwards.
    """
    fading = _fading()
    left, right = _factors(*water.waves, centre[:2] - NEAR_WAVES, len(fading))
    heights, slopes = np.empty_like(fading), np.empty((*fading.shape, 2), np.float32)
    in_bands(len(heights), lambda first, end: _sum_waves(left, right, fading, heights, first, end))
    in_bands(len(heights), lambda first, end: _take_slopes(heights, slopes, first, end))
    return heights, slopes


@functools.cache
def _fading() -> FloatImage:
    """Return (N, N) how much of the waves is left on a grid around a camera."""
    along = CELL * np.arange(int(2.0 * NEAR_WAVES / CELL) + 1) - NEAR_WAVES
    return np.exp(-np.hypot(along[None, :], along[:, None]) / CALM_FROM).astype(np.float32)


def _factors(waves: Array, phases: Array, corner: Array, count: int) -> tuple[FloatImage, FloatImage]:
    """Return (count, K) and (K, count) factors of the sums of all waves, rows by north, K a multiple of TERMS.

    A wave is the cosine of a row's phase plus a column's: the product of their cosines less that of their sines.
    """
    east, north, amplitude = waves[:, 0], waves[:, 1], waves[:, 4]
    across = np.outer(east, corner[0] + CELL * np.arange(count))
    up = np.outer(corner[1] + CELL * np.arange(count), north) - phases
    left = np.concatenate([amplitude * np.cos(up), -amplitude * np.sin(up)], axis=1)
    right = np.concatenate([np.cos(across), np.sin(across)])
    missing = -len(right) % TERMS
    left, right = np.pad(left, ((0, 0), (0, missing))), np.pad(right, ((0, missing), (0, 0)))
    return left.astype(np.float32), right.astype(np.float32)


@numba.njit(cache=True, error_model="numpy", nogil=True, fastmath=FAST)
def _sum_waves(left, right, fading, heights, first, end):  # type: ignore[no-untyped-def]
    """Fill rows of the heights with the faded product of two matrices: a library's threads would wait for others."""
    for row in range(first, end):
        here = heights[row]
        here[:] = np.float32(0.0)
        for n in range(0, len(right), TERMS):
            a, b, c, d = left[row, n], left[row, n + 1], left[row, n + 2], left[row, n + 3]
            e, f, g, h = left[row, n + 4], left[row, n + 5], left[row, n + 6], left[row, n + 7]
            for column in range(len(here)):
                some = a * right[n, column] + b * right[n + 1, column] + c * right[n + 2, column]
                more = d * right[n + 3, column] + e * right[n + 4, column] + f * right[n + 5, column]
                here[column] += some + more + g * right[n + 6, column] + h * right[n + 7, column]
        for column in range(len(here)):
            here[column] *= fading[row, column]


@numba.njit(cache=True, error_model="numpy", nogil=True, fastmath=FAST)
def _take_slopes(heights, slopes, first, end):  # type: ignore[no-untyped-def]
    """Fill rows of the slopes eastwards and northwards: between both neighbours, or with one at a border."""
    last = len(heights) - 1
    for row in range(first, end):
        south, north = max(row - 1, 0), min(row + 1, last)
        for column in range(last + 1):
            west, east = max(column - 1, 0), min(column + 1, last)
            across, up = heights[row, east] - heights[row, west], heights[north, column] - heights[south, column]
            slopes[row, column, 0] = across / np.float32(CELL * (east - west))
            slopes[row, column, 1] = up / np.float32(CELL * (north - south))
