"""The rock's texture for films: noise in a cube that repeats without a seam, looked up instead of summed up.

Photos sum their noise up for every pixel (`photograph.rock`), which takes half of a photo's time. A look-up takes a
tenth of that; two of them, of different size and turned against each other, hide that the cube repeats.
"""

from __future__ import annotations

import functools

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


@functools.cache
def packed_tile() -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return the texture in (SIDE**3,) words of 32 bits, lowest byte first.

    Returns:
        The four channels of each sample; and the grey of each, of the next along z, along y, and along both.
    """
    tile = rock_tile()
    grey = tile[..., 0]
    square = [grey, np.roll(grey, -1, 2), np.roll(grey, -1, 1), np.roll(grey, (-1, -1), (1, 2))]
    return _words(tile), _words(np.stack(square, axis=-1))


def _words(tile: Tile) -> npt.NDArray[np.int32]:
    return np.ascontiguousarray(tile).view("<i4").astype(np.int32).ravel()


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
