"""Random numbers that depend on what they are for, not on what was drawn before: seed, purpose, step.

The seed is the episode's own. So an episode is the same in any batch, alone or beside others, on processors and on
cards, in any order.

Source: Jarzynski and Olano, Hash Functions for GPU Rendering, JCGT 9 (2020), pcg4d.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import warp as wp

from aquanav_tools.sim.batch.runtime import OPTIONS

wp.set_module_options(OPTIONS)

u32 = wp.uint32
START, SHARE, SWELL, NEXT, EDDIES, RAYS, DYNAMICS = 0, 1, 2, 3, 16, 1 << 16, 1 << 20
"""Purposes: where an episode begins; its share of the current; its waves' phase; the seed of the episode after it; from
here on its eddies; from here on the errors of its rays; from here on its vehicle's dynamics."""


@wp.func
def words(seed: int, purpose: int, step: int):
    """Return four times 32 random bits."""
    a, c = u32(1664525), u32(1013904223)
    x, y = u32(seed) * a + c, u32(purpose) * a + c
    z, w = u32(step) * a + c, c
    for n in range(2):
        x += y * w
        y += z * x
        z += x * y
        w += y * z
        if n == 0:
            x, y, z, w = x ^ (x >> u32(16)), y ^ (y >> u32(16)), z ^ (z >> u32(16)), w ^ (w >> u32(16))
    return wp.vec4ui(x, y, z, w)


@wp.func
def share_of_one(bits: wp.uint32):
    """Return a number evenly drawn from the open interval between 0 and 1."""
    return (float(bits >> u32(8)) + 0.5) * 5.9604645e-8  # 2^-24


@wp.func
def normal_pair(first: wp.uint32, second: wp.uint32):
    """Return two independent standard normal numbers (Box and Muller)."""
    radius = wp.sqrt(-2.0 * wp.log(share_of_one(first)))
    angle = 6.2831853 * share_of_one(second)
    return wp.vec2(radius * wp.cos(angle), radius * wp.sin(angle))


@wp.func
def choice(bits: wp.uint32, count: int):
    """Return a number from 0 to count - 1."""
    return int(bits % u32(count))


def draw_many(
    seeds: npt.NDArray[np.integer], purpose: int, step: int | npt.NDArray[np.integer] = 0
) -> npt.NDArray[np.uint32]:
    """Return the first of `words` for (N,) seeds and a step for all, or (N,) steps, computed by NumPy."""
    parts = np.zeros((4, len(seeds)), dtype=np.uint32)
    parts[0], parts[1], parts[2] = seeds.astype(np.uint32), purpose, np.asarray(step).astype(np.uint32)
    x, y, z, w = parts * np.uint32(1664525) + np.uint32(1013904223)
    for n in range(2):
        x += y * w
        y += z * x
        z += x * y
        w += y * z
        if n == 0:
            x, y, z, w = (part ^ (part >> np.uint32(16)) for part in (x, y, z, w))
    return x
