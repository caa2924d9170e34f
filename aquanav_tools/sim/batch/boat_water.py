"""The sea around boats in Warp: the height of its surface and the motion of the water under it, a sum of waves.

Each wave is one of `waves`. Depth counts from the moving surface (Wheeler), so that crests are no faster than the
theory's surface. A boat on 48 waves spends most of its time here.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from aquanav_tools.sim.batch.runtime import BOAT_OPTIONS, find_device, launch_kernel
from aquanav_tools.sim.batch.waves import (
    AMPLITUDE,
    BED,
    EAST,
    KX,
    KY,
    LANES,
    NORTH,
    RATE,
    UP,
    cosine_and_sine,
    f64,
    lanes,
    num_blocks,
    pack_waves,
    shares_below,
    total,
    vec8,
)  # fmt: skip
from aquanav_tools.types import Array

wp.set_module_options(BOAT_OPTIONS)


@wp.struct
class Sea:
    """The waves around each boat, eight to a vector; those that fill up the last vector have no height."""

    table: wp.array3d(dtype=vec8)
    """(N, 9, B), rows KX to BED."""
    phases: wp.array2d(dtype=vec8)
    """(N, B) now, rad."""


def pack_sea(waves: Array, phases: Array, blocks: int) -> tuple[Array, Array]:
    """Return the table of `pack_waves` and the (B, 8) phases, rad, of (W, 7) waves with (W,) phases."""
    turned = np.zeros(blocks * LANES)
    turned[: len(waves)] = phases
    return pack_waves(waves, blocks), turned.reshape(blocks, LANES)


@wp.func
def turn_waves(
    table: wp.array2d(dtype=vec8), phases: wp.array(dtype=vec8), elapsed: f64, x: f64, y: f64,
    turns: wp.array2d(dtype=vec8),
):  # fmt: skip
    """Write the (2, B) cosines and sines of each wave's angle at a place, `elapsed` seconds from now."""
    for b in range(phases.shape[0]):
        angle = table[KX, b] * x + table[KY, b] * y - phases[b] - table[RATE, b] * elapsed
        cosine, sine = cosine_and_sine(angle)
        turns[0, b] = cosine
        turns[1, b] = sine


@wp.func
def turn_by_shift(table: wp.array2d(dtype=vec8), x: f64, y: f64, turns: wp.array2d(dtype=vec8)):
    """Write the (2, B) cosines and sines of the angles by which a shift of place turns each wave."""
    for b in range(table.shape[1]):
        cosine, sine = cosine_and_sine(table[KX, b] * x + table[KY, b] * y)
        turns[0, b] = cosine
        turns[1, b] = sine


@wp.func
def add_turns(one: wp.array2d(dtype=vec8), other: wp.array2d(dtype=vec8), turns: wp.array2d(dtype=vec8)):
    """Write the cosines and sines of the sums of two tables' angles."""
    for b in range(turns.shape[1]):
        cosine, sine, more_cosine, more_sine = one[0, b], one[1, b], other[0, b], other[1, b]
        turns[0, b] = wp.cw_mul(cosine, more_cosine) - wp.cw_mul(sine, more_sine)
        turns[1, b] = wp.cw_mul(sine, more_cosine) + wp.cw_mul(cosine, more_sine)


@wp.func
def add_turns_and_rise(
    table: wp.array2d(dtype=vec8), one: wp.array2d(dtype=vec8), other: wp.array2d(dtype=vec8),
    turns: wp.array2d(dtype=vec8), sums: wp.array(dtype=vec8)
):  # fmt: skip
    """Do what `add_turns` does, and return `surface_rise` there."""
    sums[0] = vec8()
    for b in range(turns.shape[1]):
        cosine, sine, more_cosine, more_sine = one[0, b], one[1, b], other[0, b], other[1, b]
        found = wp.cw_mul(cosine, more_cosine) - wp.cw_mul(sine, more_sine)
        turns[0, b] = found
        turns[1, b] = wp.cw_mul(sine, more_cosine) + wp.cw_mul(cosine, more_sine)
        sums[0] = sums[0] + wp.cw_mul(table[AMPLITUDE, b], found)
    return total(sums[0])


@wp.func
def surface_rise(table: wp.array2d(dtype=vec8), turns: wp.array2d(dtype=vec8)):
    """Return how far the surface stands above still water where `turn_waves` has been, m."""
    rise = vec8()
    for b in range(turns.shape[1]):
        rise += wp.cw_mul(table[AMPLITUDE, b], turns[0, b])
    return total(rise)


@wp.func
def add_orbit(table: wp.array2d(dtype=vec8), b: int, level: vec8, upright: vec8, sums: wp.array(dtype=vec8)):
    """Add velocities of so many times those at the surface to three sums, which a loop in registers would not keep."""
    sums[0] = sums[0] + wp.cw_mul(level, table[EAST, b])
    sums[1] = sums[1] + wp.cw_mul(level, table[NORTH, b])
    sums[2] = sums[2] + wp.cw_mul(upright, table[UP, b])


@wp.func
def orbital_velocity(
    table: wp.array2d(dtype=vec8), turns: wp.array2d(dtype=vec8), below: f64, sums: wp.array(dtype=vec8)
):
    """Return the water's velocity so far below the surface where `turn_waves` has been, m/s; in the air, that at it.

    `sums` is room for three vectors.
    """
    one = lanes(f64(1.0))
    for n in range(3):
        sums[n] = vec8()
    if below <= f64(0.0):
        for b in range(turns.shape[1]):
            echo = table[BED, b]
            add_orbit(table, b, wp.cw_mul(one + echo, turns[0, b]), wp.cw_mul(one - echo, turns[1, b]), sums)
    else:
        for b in range(turns.shape[1]):
            level, upright = shares_below(table, b, below)
            add_orbit(table, b, wp.cw_mul(level, turns[0, b]), wp.cw_mul(upright, turns[1, b]), sums)
    return wp.vec3d(total(sums[0]), total(sums[1]), total(sums[2]))


@wp.kernel
def probe_sea(
    sea: Sea, places: wp.array(dtype=wp.vec3d), turns: wp.array2d(dtype=vec8), sums: wp.array(dtype=vec8),
    rises: wp.array(dtype=f64), velocities: wp.array(dtype=wp.vec3d),
):  # fmt: skip
    """Write the surface's rise and the waves' velocity at places, one after the other."""
    table, phases = sea.table[0], sea.phases[0]
    for n in range(places.shape[0]):
        place = places[n]
        turn_waves(table, phases, f64(0.0), place[0], place[1], turns)
        rise = surface_rise(table, turns)
        rises[n] = rise
        velocities[n] = orbital_velocity(table, turns, rise - place[2], sums)


def probe(waves: Array, phases: Array, places: Array) -> tuple[Array, Array]:
    """Return the (P,) rise of the surface, m, and the (P, 3) velocity of the waves, m/s, at (P, 3) places, m.

    Args:
        waves: (W, 7) parameters of `waves.wave_parameters`.
        phases: (W,) now, rad.
        places: (P, 3) world, z from still water; in the air the velocity is that of the surface below.
    """
    device, count, blocks = find_device("cpu"), len(places), num_blocks(len(waves))
    sea = Sea()
    table, turned = pack_sea(waves, phases, blocks)
    sea.table = wp.array(table[None], dtype=vec8, ndim=3, device=device)
    sea.phases = wp.array(turned[None], dtype=vec8, ndim=2, device=device)
    rises = wp.zeros(count, dtype=wp.float64, device=device)
    velocities = wp.zeros(count, dtype=wp.vec3d, device=device)
    at = wp.array(np.ascontiguousarray(places, dtype=np.float64), dtype=wp.vec3d, device=device)
    turns, sums = (wp.zeros(shape, dtype=vec8, device=device) for shape in ((2, blocks), 3))
    launch_kernel(probe_sea, dim=1, inputs=[sea, at, turns, sums, rises, velocities], device=device)
    return rises.numpy(), velocities.numpy()
