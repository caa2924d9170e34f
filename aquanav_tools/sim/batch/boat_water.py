"""The sea in Warp: the height of its surface and the motion of the water under it, a sum of small waves after Airy.

    rise = sum a cos(t),   level velocity = sum a w cosh(k (h - b)) / sinh(k h) cos(t),   t = k x - w time - phase
                           velocity upwards = sum a w sinh(k (h - b)) / sinh(k h) sin(t)

a is a wave's amplitude, k its wave number along its direction, w its angular rate, h the water's depth, and b the depth
below the moving surface (Wheeler), so that crests are no faster than the theory's surface. The hyperbolic functions are
written as the wave's decay downwards, e^(-k b), and that of its echo from the bed.

A boat on 48 waves spends most of its time here. Eight waves go into one vector, and sines and exponentials are written
out as polynomials, so that a processor's vector instructions do several at once.

Sources: Dean and Dalrymple, Water Wave Mechanics for Engineers and Scientists (1991), chapters 3 and 4; the polynomials
of sine and cosine: Moshier, Cephes mathematical library, sin.c.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from aquanav_tools.sim.batch.runtime import BOAT_OPTIONS, find_device, launch_kernel
from aquanav_tools.sim.waves import DEEP
from aquanav_tools.types import Array

wp.set_module_options(BOAT_OPTIONS)

f64 = wp.float64
LANES = 8
"""Waves in one vector."""
vec8 = wp.types.vector(length=LANES, dtype=wp.float64)
KX, KY, K, RATE, AMPLITUDE, EAST, NORTH, UP, BED = (wp.constant(n) for n in range(9))
"""Rows of a sea's table: wave number along x, along y and whole, rad/m; angular rate, rad/s; amplitude, m; speeds of
the orbit at the surface, m/s; and the fraction of the wave that comes back from the bed."""
NUM_ROWS = 9
QUARTER = wp.constant(wp.float64(2.0 / np.pi))
ROUND = wp.constant(wp.float64(1.5 * 2.0**52))
"""Added and taken away again it leaves the nearest whole number."""
HIGH = wp.constant(wp.float64(2.0 * 7.85398125648498535156e-1))
MIDDLE = wp.constant(wp.float64(2.0 * 3.77489470793079817668e-8))
LOW = wp.constant(wp.float64(2.0 * 2.69515142907905952645e-15))
"""Half of pi in three parts, the first two of few digits, so that multiples of them are exact."""
SEVEN_SIXTHS, SIXTH = wp.constant(wp.float64(7.0 / 6.0)), wp.constant(wp.float64(1.0 / 6.0))
FOUR_THIRDS, THIRD = wp.constant(wp.float64(4.0 / 3.0)), wp.constant(wp.float64(1.0 / 3.0))
E3, E4, E5, E6, E7, E8 = (wp.constant(wp.float64(1.0 / n)) for n in (6, 24, 120, 720, 5040, 40320))
"""Of the exponential's series. Warp would divide such numbers in float32."""
MOST = wp.constant(wp.float64(40.0))
"""Decay, in powers of e, beyond which nothing is left: 4e-18."""


@wp.struct
class Sea:
    """The waves around each boat, eight to a vector; those that fill up the last vector have no height."""

    table: wp.array3d(dtype=vec8)
    """(N, 9, B), rows KX to BED."""
    phases: wp.array2d(dtype=vec8)
    """(N, B) now, rad."""


def num_blocks(num_waves: int) -> int:
    """Return how many vectors hold so many waves."""
    return -(-num_waves // LANES)


def pack_sea(waves: Array, phases: Array, blocks: int) -> tuple[Array, Array]:
    """Return the (9, B, 8) table of (W, 7) waves, as of `waves.wave_parameters`, and their (B, 8) phases, rad."""
    table, turned = np.zeros((NUM_ROWS, blocks * LANES)), np.zeros(blocks * LANES)
    kx, ky, k, rate, amplitude, _, depth = waves.T
    bed = np.where(k * depth < DEEP, np.exp(-2.0 * k * depth), 0.0)
    speed = rate * amplitude / (1.0 - bed)
    table[:, : len(waves)] = kx, ky, k, rate, amplitude, speed * kx / k, speed * ky / k, speed, bed
    turned[: len(waves)] = phases
    return table.reshape(NUM_ROWS, blocks, LANES), turned.reshape(blocks, LANES)


@wp.func
def lanes(value: f64):
    """Return a vector of one value."""
    return vec8(value, value, value, value, value, value, value, value)


@wp.func
def total(values: vec8):
    """Return the sum of a vector's values."""
    return ((values[0] + values[4]) + (values[1] + values[5])) + ((values[2] + values[6]) + (values[3] + values[7]))


@wp.func
def times_plus(factor: vec8, other: vec8, added: f64):
    """Return factor * other + added."""
    return wp.cw_mul(factor, other) + lanes(added)


@wp.func
def cosine_and_sine(angle: vec8):
    """Return cosines and sines; the angle less the nearest multiple of half pi goes into the polynomials."""
    turns = (angle * QUARTER + lanes(ROUND)) - lanes(ROUND)
    rest = ((angle - turns * HIGH) - turns * MIDDLE) - turns * LOW
    z = wp.cw_mul(rest, rest)
    sine = z * f64(1.58962301576546568060e-10) - lanes(f64(2.50507477628578072866e-8))
    sine = times_plus(sine, z, f64(2.75573136213857245213e-6))
    sine = times_plus(sine, z, f64(-1.98412698295895385996e-4))
    sine = times_plus(sine, z, f64(8.33333333332211858878e-3))
    sine = times_plus(sine, z, f64(-1.66666666666666307295e-1))
    sine = rest + wp.cw_mul(wp.cw_mul(rest, z), sine)
    cosine = z * f64(-1.13585365213876817300e-11) + lanes(f64(2.08757008419747316778e-9))
    cosine = times_plus(cosine, z, f64(-2.75573141792967388112e-7))
    cosine = times_plus(cosine, z, f64(2.48015872888517045348e-5))
    cosine = times_plus(cosine, z, f64(-1.38888888888730564116e-3))
    cosine = times_plus(cosine, z, f64(4.16666666666665929218e-2))
    cosine = lanes(f64(1.0)) - z * f64(0.5) + wp.cw_mul(wp.cw_mul(z, z), cosine)
    # The multiple of half pi is -2 to 2 but for whole turns; its own cosine and sine are -1, 0 or 1.
    quarter = turns - ((turns * f64(0.25) + lanes(ROUND)) - lanes(ROUND)) * f64(4.0)
    square = wp.cw_mul(quarter, quarter)
    across = (times_plus(square, square * SIXTH - lanes(SEVEN_SIXTHS), f64(1.0)) + lanes(ROUND)) - lanes(ROUND)
    along = (wp.cw_mul(quarter, lanes(FOUR_THIRDS) - square * THIRD) + lanes(ROUND)) - lanes(ROUND)
    return (
        wp.cw_mul(across, cosine) - wp.cw_mul(along, sine),
        wp.cw_mul(along, cosine) + wp.cw_mul(across, sine),
    )


@wp.func
def exponential_decay(powers: vec8):
    """Return e^-powers for powers that are not negative: the 64th power of e^(-powers / 64), to 1e-13."""
    x = wp.min(powers, lanes(MOST)) * f64(-0.015625)
    found = x * E8 + lanes(E7)
    found = times_plus(found, x, E6)
    found = times_plus(found, x, E5)
    found = times_plus(found, x, E4)
    found = times_plus(found, x, E3)
    found = times_plus(found, x, f64(0.5))
    found = times_plus(found, x, f64(1.0))
    found = times_plus(found, x, f64(1.0))
    found = wp.cw_mul(found, found)
    found = wp.cw_mul(found, found)
    found = wp.cw_mul(found, found)
    found = wp.cw_mul(found, found)
    found = wp.cw_mul(found, found)
    return wp.cw_mul(found, found)


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
            down = exponential_decay(table[K, b] * below)
            echo = wp.min(wp.cw_div(table[BED, b], wp.cw_mul(down, down)), one)
            level, upright = wp.cw_mul(down, one + echo), wp.cw_mul(down, one - echo)
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
