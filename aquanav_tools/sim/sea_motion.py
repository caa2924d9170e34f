"""The sea at many places of a hull: the sums of `sea_water.sea_rise` and `add_sea`, several waves at a time.

A boat on 48 waves spends nearly all of its time here, most of it on sines and exponentials, one after the other. A
compiler computes four at once where they are bare arithmetic, so that they are written out: five times as fast.

Source of the polynomials: Moshier, Cephes mathematical library, sin.c.
"""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.sim.waves import DEEP

KX, KY, K, AMPLITUDE, EAST, NORTH, UP, BED = range(8)
"""Rows of a sea's table: wave number along x, along y and whole, rad/m; amplitude, m; speeds of the orbit at the
surface, m/s; and the share of the wave that comes back from the bed."""
QUARTER = 2.0 / np.pi
HIGH, MIDDLE, LOW = 2.0 * 7.85398125648498535156e-1, 2.0 * 3.77489470793079817668e-8, 2.0 * 2.69515142907905952645e-15
"""Half of pi in three parts, the first two of few digits, so that multiples of them are exact."""
MOST = 40.0
"""Decay, in powers of e, beyond which nothing is left: 4e-18."""
HALVINGS = 64.0
"""e^-t is the 64th power of e^(-t/64), for which eight terms do: its error is below 1e-13 for any t."""

summed = numba.njit(cache=True, error_model="numpy", fastmath={"contract", "reassoc", "nsz"})
"""Sums may be taken in any order; otherwise several at once are not allowed."""
exact = numba.njit(cache=True, error_model="numpy", fastmath={"contract"})


@summed
def sea_table(waves, table):  # type: ignore[no-untyped-def]
    """Write the (8, N) table of (N, 7) waves of `waves.add_waves`."""
    for n in range(len(waves)):
        kx, ky, k, rate, amplitude = waves[n, 0], waves[n, 1], waves[n, 2], waves[n, 3], waves[n, 4]
        bed = np.exp(-2.0 * k * waves[n, 6]) if k * waves[n, 6] < DEEP else 0.0
        speed = rate * amplitude / (1.0 - bed)
        table[KX, n], table[KY, n], table[K, n], table[AMPLITUDE, n] = kx, ky, k, amplitude
        table[EAST, n], table[NORTH, n], table[UP, n], table[BED, n] = speed * kx / k, speed * ky / k, speed, bed


@exact
def turn_sea(table, phases, x, y, turned, row):  # type: ignore[no-untyped-def]
    """Write the cosine and sine of each wave's angle at a place into a row of (2, R, N) turned."""
    for n in range(len(phases)):
        angle = table[KX, n] * x + table[KY, n] * y - phases[n]
        turns = np.floor(angle * QUARTER + 0.5)
        rest = ((angle - turns * HIGH) - turns * MIDDLE) - turns * LOW
        z = rest * rest
        sine = 1.58962301576546568060e-10 * z - 2.50507477628578072866e-8
        sine = (sine * z + 2.75573136213857245213e-6) * z - 1.98412698295895385996e-4
        sine = rest + rest * z * ((sine * z + 8.33333333332211858878e-3) * z - 1.66666666666666307295e-1)
        cosine = -1.13585365213876817300e-11 * z + 2.08757008419747316778e-9
        cosine = (cosine * z - 2.75573141792967388112e-7) * z + 2.48015872888517045348e-5
        cosine = 1.0 - 0.5 * z + z * z * ((cosine * z - 1.38888888888730564116e-3) * z + 4.16666666666665929218e-2)
        quarter = turns - 4.0 * np.floor(0.25 * turns)  # 0 to 3
        is_odd = turns - 2.0 * np.floor(0.5 * turns) > 0.5
        one, other = (cosine, sine) if is_odd else (sine, cosine)
        turned[1, row, n] = -one if quarter > 1.5 else one
        turned[0, row, n] = -other if 0.5 < quarter < 2.5 else other


@summed
def turn_on(one, i, other, j, found, n):  # type: ignore[no-untyped-def]
    """Write the cosines and sines of the sums of the angles in row i of one table and in row j of another."""
    for w in range(one.shape[2]):
        cosine, sine, more_cosine, more_sine = one[0, i, w], one[1, i, w], other[0, j, w], other[1, j, w]
        found[0, n, w] = cosine * more_cosine - sine * more_sine
        found[1, n, w] = sine * more_cosine + cosine * more_sine


@summed
def turned_rise(table, turned, row):  # type: ignore[no-untyped-def]
    """Return how far the surface stands above still water where `turn_sea` has been, m."""
    rise = 0.0
    for n in range(table.shape[1]):
        rise += table[AMPLITUDE, n] * turned[0, row, n]
    return rise


@summed
def add_turned_sea(table, turned, row, below, velocities):  # type: ignore[no-untyped-def]
    """Add the water's velocity so far below its surface to a row of (R, 3): `add_sea` where `turn_sea` has been, m/s.

    The depth's hyperbolic functions are written as the wave's decay downwards and that of its echo from the bed.
    """
    east, north, up = 0.0, 0.0, 0.0
    if below <= 0.0:
        for n in range(table.shape[1]):
            level = (1.0 + table[BED, n]) * turned[0, row, n]
            east += level * table[EAST, n]
            north += level * table[NORTH, n]
            up += (1.0 - table[BED, n]) * turned[1, row, n] * table[UP, n]
        _add(velocities, row, east, north, up)
        return
    for n in range(table.shape[1]):
        decay = min(table[K, n] * below, MOST) / -HALVINGS
        down = 1.0 / 5040.0 + decay / 40320.0
        down = 1.0 / 120.0 + decay * (1.0 / 720.0 + decay * down)
        down = 1.0 / 6.0 + decay * (1.0 / 24.0 + decay * down)
        down = 1.0 + decay * (1.0 + decay * (0.5 + decay * down))
        down *= down
        down *= down
        down *= down
        down *= down
        down *= down
        down *= down
        echo = min(table[BED, n] / (down * down), 1.0)
        level, upright = down * (1.0 + echo) * turned[0, row, n], down * (1.0 - echo) * turned[1, row, n]
        east += level * table[EAST, n]
        north += level * table[NORTH, n]
        up += upright * table[UP, n]
    _add(velocities, row, east, north, up)


@summed
def _add(velocities, row, east, north, up):  # type: ignore[no-untyped-def]
    velocities[row, 0] += east
    velocities[row, 1] += north
    velocities[row, 2] += up
