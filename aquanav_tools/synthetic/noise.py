"""Solid noise: smooth random fields over space that depend on nothing but the point and a seed.

Value noise on the integer lattice with quintic interpolation (Perlin, Improving Noise, 2002), summed over octaves.

`fastmath=False` is not numba's default: without a word on it, a function is compiled with what its first caller allows,
and kept in the cache so for all others. Caves would depend on what ran first.
"""

from __future__ import annotations

import math

import numba


@numba.njit(cache=True, inline="always")
def lattice_value(i, j, k, seed):  # type: ignore[no-untyped-def]
    """Return a hash of a lattice point (integers) and a seed, uniform in [-1, 1]."""
    bits = (i * 374761393 + j * 668265263 + k * 1274126177 + seed * 974634777) & 0xFFFFFFFF
    bits = ((bits ^ (bits >> 13)) * 1274126177) & 0xFFFFFFFF
    bits = ((bits ^ (bits >> 16)) * 2246822519) & 0xFFFFFFFF
    bits = bits ^ (bits >> 15)
    return (bits & 0xFFFFFF) * (2.0 / 0xFFFFFF) - 1.0


@numba.njit(cache=True, inline="always")
def fade(t):  # type: ignore[no-untyped-def]
    """Return the quintic step of t in [0, 1]: flat to second order at both ends."""
    return t * t * t * (t * (t * 6.0 - 15.0) + 10.0)


@numba.njit(cache=True, fastmath=False)
def noise(x, y, z, seed):  # type: ignore[no-untyped-def]
    """Return noise in [-1, 1] with features of about one unit."""
    fx, fy, fz = math.floor(x), math.floor(y), math.floor(z)
    i, j, k = int(fx), int(fy), int(fz)
    u, v, w = fade(x - fx), fade(y - fy), fade(z - fz)
    a = lattice_value(i, j, k, seed) * (1 - u) + lattice_value(i + 1, j, k, seed) * u
    b = lattice_value(i, j + 1, k, seed) * (1 - u) + lattice_value(i + 1, j + 1, k, seed) * u
    c = lattice_value(i, j, k + 1, seed) * (1 - u) + lattice_value(i + 1, j, k + 1, seed) * u
    d = lattice_value(i, j + 1, k + 1, seed) * (1 - u) + lattice_value(i + 1, j + 1, k + 1, seed) * u
    return (a * (1 - v) + b * v) * (1 - w) + (c * (1 - v) + d * v) * w


@numba.njit(cache=True, fastmath=False)
def fractal(x, y, z, frequency, octaves, gain, finest, seed):  # type: ignore[no-untyped-def]
    """Return noise summed over octaves, within +-(1 + gain + gain^2 + ...).

    Args:
        x: Position, m.
        y: Position, m.
        z: Position, m.
        frequency: Of the first octave, cycles per m; doubles with each.
        octaves: How many.
        gain: Amplitude of an octave relative to the one before.
        finest: Cycles per m that the caller can resolve; octaves fade out towards it and end there.
        seed: Picks the field.
    """
    total, amplitude = 0.0, 1.0
    for octave in range(octaves):
        if frequency >= finest:
            break
        resolved = min(1.0, (finest - frequency) / frequency)
        # The shift keeps lattice planes of different octaves from coinciding.
        shift = 17.3 * octave
        sample = noise(x * frequency + shift, y * frequency - 0.53 * shift, z * frequency + 0.21 * shift, seed + octave)
        total += resolved * amplitude * sample
        amplitude *= gain
        frequency *= 2.0
    return total
