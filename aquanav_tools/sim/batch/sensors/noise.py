"""What sensors draw: numbers that depend on the episode's seed, the sensor's stream and the decision alone."""

from __future__ import annotations

import zlib

import warp as wp

from aquanav_tools.sim.batch.random import normal_pair, words
from aquanav_tools.sim.batch.runtime import OPTIONS

wp.set_module_options(OPTIONS)

ONCE = wp.constant(-1)
"""In place of a decision: what is drawn once for an episode."""


def stream_of(name: str) -> int:
    """Return the purpose from which a sensor of this name counts what it draws, as a whole number of 32 bits.

    It depends on the name alone, so that a sensor reads the same beside whatever other sensors. The highest bit is set:
    all that the vehicles themselves draw lies below.
    """
    return (zlib.crc32(name.encode()) | 1 << 31) - (1 << 32)


@wp.func
def normals(seed: int, purpose: int, step: int):
    """Return four independent standard normal numbers."""
    drawn = words(seed, purpose, step)
    first, second = normal_pair(drawn[0], drawn[1]), normal_pair(drawn[2], drawn[3])
    return wp.vec4(first[0], first[1], second[0], second[1])


@wp.func
def normal_vector(seed: int, purpose: int, step: int):
    """Return a vector of three independent standard normal numbers."""
    drawn = normals(seed, purpose, step)
    return wp.vec3(drawn[0], drawn[1], drawn[2])


@wp.kernel
def draw_normals(
    seeds: wp.array(dtype=wp.int32),
    steps: wp.array(dtype=wp.int32),
    purpose: int,
    out: wp.array2d(dtype=wp.float32),
):
    """Write (N, C) standard normal numbers, for sensors that compute in NumPy."""
    i, block = wp.tid()
    drawn = normals(seeds[i], purpose + block, steps[i])
    for place in range(4):
        n = 4 * block + place
        if n < out.shape[1]:
            out[i, n] = drawn[place]
