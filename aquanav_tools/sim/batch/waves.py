"""Small waves on a free surface in Warp, after Airy: the motion of the water under them, for caves and for the sea.

    rise = sum a cos(t),   level velocity = sum a w cosh(k (h - b)) / sinh(k h) cos(t),   t = k x - w time - phase
                           velocity upwards = sum a w sinh(k (h - b)) / sinh(k h) sin(t)

a is a wave's amplitude, k its wave number along its direction, w its angular rate, h the water's depth, and b the depth
below the surface. The hyperbolic functions are written as the wave's decay downwards, e^(-k b), and that of its echo
from the bed. Eight waves go into one vector, and sines and exponentials are written out as polynomials, so that a
processor's vector instructions do several at once.

Sources: Dean and Dalrymple, Water Wave Mechanics for Engineers and Scientists (1991), chapters 3 and 4; the polynomials
of sine and cosine: Moshier, Cephes mathematical library, sin.c.
"""

from __future__ import annotations

import numpy as np
import warp as wp

from aquanav_tools.sim.batch.runtime import OPTIONS
from aquanav_tools.sim.waves import DEEP
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
LANES = 8
"""Waves in one vector."""
vec8 = wp.types.vector(length=LANES, dtype=wp.float64)
KX, KY, K, RATE, AMPLITUDE, EAST, NORTH, UP, BED = (wp.constant(n) for n in range(9))
"""Rows of a table of waves: wave number along x, along y and whole, rad/m; angular rate, rad/s; amplitude, m; speeds of
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


def num_blocks(num_waves: int) -> int:
    """Return how many vectors hold so many waves."""
    return -(-num_waves // LANES)


def pack_waves(waves: Array, blocks: int) -> Array:
    """Return the (9, B, 8) table of (W, 7) waves, as of `waves.wave_parameters`; what is left over has no height."""
    table = np.zeros((NUM_ROWS, blocks * LANES))
    kx, ky, k, rate, amplitude, _, depth = waves.T
    bed = np.where(k * depth < DEEP, np.exp(-2.0 * k * depth), 0.0)
    speed = rate * amplitude / (1.0 - bed)
    table[:, : len(waves)] = kx, ky, k, rate, amplitude, speed * kx / k, speed * ky / k, speed, bed
    return table.reshape(NUM_ROWS, blocks, LANES)


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
def shares_below(table: wp.array2d(dtype=vec8), b: int, below: f64):
    """Return how much of the level and of the upright speeds in a table's block is left so far below the surface, m."""
    one = lanes(f64(1.0))
    down = exponential_decay(table[K, b] * below)
    echo = wp.min(wp.cw_div(table[BED, b], wp.cw_mul(down, down)), one)
    return wp.cw_mul(down, one + echo), wp.cw_mul(down, one - echo)
