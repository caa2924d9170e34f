"""The rock's texture for films: noise in a cube that repeats without a seam, looked up instead of summed up.

Photos sum their noise up for every pixel (`photograph.rock`), which takes half of a photo's time. A look-up takes a
tenth of that; two of them, of different size and turned against each other, hide that the cube repeats.
"""

from __future__ import annotations

import functools

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.types import Array

SIDE = 128
"""Samples along each side of the cube: a power of two."""
COARSEST, FINEST = 2.0, 40.0
"""Waves along a side, between which the noise lies."""
ROUGHNESS = 1.75
"""The noise's amplitude falls with this power of its frequency."""
PITS, PIT_SHARPNESS = 1.55, 1.6
"""Standard deviations from which a second noise darkens, and how fast: a twentieth of the rock."""
RANGE = 3.0
"""Standard deviations that a byte holds."""

Tile = npt.NDArray[np.int8]


@functools.cache
def rock_tile() -> Tile:
    """Return the (SIDE, SIDE, SIDE, 4) texture: grey, and the relief's slope along x, y and z, 127 / RANGE a sigma."""
    rng = np.random.default_rng(0)
    grain, spots = _noise(rng, ROUGHNESS, COARSEST), _noise(rng, 1.0, 6.0)
    grey = grain - PIT_SHARPNESS * np.maximum(spots - PITS, 0.0)
    slopes = [0.5 * (np.roll(grain, -1, axis) - np.roll(grain, 1, axis)) for axis in range(3)]
    channels = [grey, *(slope / slope.std() for slope in slopes)]
    return np.stack([_as_bytes(channel) for channel in channels], axis=-1)


def _noise(rng: np.random.Generator, roughness: float, coarsest: float) -> Array:
    """Return periodic noise with mean 0 and deviation 1."""
    ways = np.fft.fftfreq(SIDE) * SIDE
    frequency = np.sqrt(ways[:, None, None] ** 2 + ways[None, :, None] ** 2 + ways[None, None, : SIDE // 2 + 1] ** 2)
    is_kept = (frequency >= coarsest) & (frequency <= FINEST)
    amplitude = np.where(is_kept, np.maximum(frequency, 1.0) ** -roughness, 0.0)
    spectrum = amplitude * np.exp(2j * np.pi * rng.random(amplitude.shape))
    noise = np.fft.irfftn(spectrum, s=(SIDE, SIDE, SIDE), axes=(0, 1, 2))
    found: Array = noise / noise.std()
    return found


def _as_bytes(channel: Array) -> Tile:
    return np.round(np.clip(channel / RANGE, -1.0, 1.0) * 127.0).astype(np.int8)


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def look_up(tile, x, y, z):  # type: ignore[no-untyped-def]
    """Return the four channels at a place in samples, in standard deviations, between the eight samples around it."""
    fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
    u, v, w = x - fx, y - fy, z - fz
    last = SIDE - 1
    i, j, k = int(fx) & last, int(fy) & last, int(fz) & last
    a, b, c = (i + 1) & last, (j + 1) & last, (k + 1) & last
    grey, east, north, up = _between(tile, i, j, b, k, c, v, w)
    grey_2, east_2, north_2, up_2 = _between(tile, a, j, b, k, c, v, w)
    near, far = (1.0 - u) * RANGE / 127.0, u * RANGE / 127.0
    return near * grey + far * grey_2, near * east + far * east_2, near * north + far * north_2, near * up + far * up_2


@numba.njit(cache=True, error_model="numpy", fastmath=True)
def look_up_grey(tile, x, y, z):  # type: ignore[no-untyped-def]
    """Return the first of the four channels; see `look_up`."""
    fx, fy, fz = np.floor(x), np.floor(y), np.floor(z)
    u, v, w = x - fx, y - fy, z - fz
    last = SIDE - 1
    i, j, k = int(fx) & last, int(fy) & last, int(fz) & last
    a, b, c = (i + 1) & last, (j + 1) & last, (k + 1) & last
    p, q, r, s = (1.0 - v) * (1.0 - w), (1.0 - v) * w, v * (1.0 - w), v * w
    near = p * tile[i, j, k, 0] + q * tile[i, j, c, 0] + r * tile[i, b, k, 0] + s * tile[i, b, c, 0]
    far = p * tile[a, j, k, 0] + q * tile[a, j, c, 0] + r * tile[a, b, k, 0] + s * tile[a, b, c, 0]
    return ((1.0 - u) * near + u * far) * RANGE / 127.0


@numba.njit(cache=True, error_model="numpy", fastmath=True, inline="always")
def _between(tile, i, j, b, k, c, v, w):  # type: ignore[no-untyped-def]
    """Return the four channels between four samples of a layer, as bytes hold them."""
    p, q, r, s = (1.0 - v) * (1.0 - w), (1.0 - v) * w, v * (1.0 - w), v * w
    return (
        p * tile[i, j, k, 0] + q * tile[i, j, c, 0] + r * tile[i, b, k, 0] + s * tile[i, b, c, 0],
        p * tile[i, j, k, 1] + q * tile[i, j, c, 1] + r * tile[i, b, k, 1] + s * tile[i, b, c, 1],
        p * tile[i, j, k, 2] + q * tile[i, j, c, 2] + r * tile[i, b, k, 2] + s * tile[i, b, c, 2],
        p * tile[i, j, k, 3] + q * tile[i, j, c, 3] + r * tile[i, b, k, 3] + s * tile[i, b, c, 3],
    )
