"""Eddies: turbulence as the curl of a random potential that fades towards the walls.

The curl of anything has no divergence, and where the potential is zero on a surface, nothing flows through it. So a sum
of waves times a ramp of the clearance gives eddies that lose no water and vanish at walls and lids, exactly, wherever
they are sampled: no grid stores them. The waves have Kolmogorov's share of speed for their length.

Source: Bridson, Houriham and Nordenstam, Curl-Noise for Procedural Fluid Flow, ACM Transactions on Graphics 26 (2007).
"""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.cave.water.field import BRICK, BRICK_BITS, DistanceField
from aquanav_tools.types import Array

NUM_WAVES = 16
LONGEST = 4.0
"""Wavelength of the largest eddies over the clearance that is usual: they fill the passage, half a wave across."""
OCTAVES = 2.0
"""Between the largest and the smallest eddies; smaller ones hardly move a vehicle."""
KOLMOGOROV = 1.0 / 3.0
"""Speed grows with this power of the eddies' size (Kolmogorov 1941)."""
MAX_PLACES = 20_000
"""Samples of the water over which the mean speed is taken."""


def draw_waves(field: DistanceField, usual_clearance: float, rng: np.random.Generator) -> Array:
    """Return waves whose eddies have a root mean square speed of 1 m/s over the water.

    Args:
        field: the water's clearance.
        usual_clearance: of the passages, m: the eddies' potential fades over it.
        rng: picks their directions.

    Returns:
        (NUM_WAVES, 8): wave vector (3,), rad/m; the potential's direction (3,), square to it, times its size, m^2/s;
        wavelength, m; and the distance over which the potential fades, m.
    """
    lengths = LONGEST * usual_clearance * 2.0 ** (-OCTAVES * np.linspace(0.0, 1.0, NUM_WAVES))
    vectors = _unit(rng.normal(size=(NUM_WAVES, 3))) * (2.0 * np.pi / lengths)[:, None]
    across = _unit(np.cross(vectors, rng.normal(size=(NUM_WAVES, 3))))
    sizes = (lengths / lengths[0]) ** KOLMOGOROV * lengths / (2.0 * np.pi)
    waves = np.column_stack([vectors, across * sizes[:, None], lengths, np.full(NUM_WAVES, usual_clearance)])
    waves[:, 3:6] /= _mean_speed(waves, field)
    return waves


def _mean_speed(waves: Array, field: DistanceField) -> float:
    """Return the root mean square speed of waves with unit variance over the water, m/s."""
    indices, _ = field.water()
    points = field.positions(indices[:: max(1, len(indices) // MAX_PLACES)])
    total = 0.0
    for point in points:
        total += _expected_square(field.bricks, field.samples, field.origin, field.spacing, point, waves)
    return float(np.sqrt(total / len(points)))


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


@numba.njit(cache=True)
def _expected_square(bricks, samples, origin, spacing, point, waves):  # type: ignore[no-untyped-def]
    """Return the mean square speed at a point over all phases, (m/s)^2."""
    clearance, nx, ny, nz = slope(bricks, samples, origin, spacing, point[0], point[1], point[2])
    total = 0.0
    for wave in waves:
        ramp, steep = fade(clearance, wave[7])
        vx, vy, vz = _cross(wave[0], wave[1], wave[2], wave[3], wave[4], wave[5])
        gx, gy, gz = _cross(nx, ny, nz, wave[3], wave[4], wave[5])
        total += ramp * ramp * (vx * vx + vy * vy + vz * vz) + steep * steep * (gx * gx + gy * gy + gz * gz)
    return total


@numba.njit(cache=True)
def add_eddies(bricks, samples, origin, spacing, x, y, z, waves, phases, scale, velocity):  # type: ignore[no-untyped-def]
    """Add `scale` times the eddies' velocity at one world point to a (3,) velocity, m/s.

    Args:
        bricks: Of the distance field.
        samples: Of the distance field.
        origin: Of the distance field.
        spacing: Of the distance field.
        x: World, m.
        y: World, m.
        z: World, m.
        waves: From `draw_waves`.
        phases: (2 NUM_WAVES,) size of each wave's cosine, then of each wave's sine; of unit variance.
        scale: Their root mean square speed, m/s.
        velocity: Is added to.
    """
    clearance, nx, ny, nz = slope(bricks, samples, origin, spacing, x, y, z)
    ramp, steep = fade(clearance, waves[0, 7])
    if ramp == 0.0:
        return
    count = len(waves)
    px, py, pz, vx, vy, vz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for n in range(count):
        wave = waves[n]
        angle = wave[0] * x + wave[1] * y + wave[2] * z
        cosine, sine = np.cos(angle), np.sin(angle)
        height = phases[n] * cosine + phases[count + n] * sine
        change = phases[count + n] * cosine - phases[n] * sine
        px, py, pz = px + height * wave[3], py + height * wave[4], pz + height * wave[5]
        cx, cy, cz = _cross(wave[0], wave[1], wave[2], wave[3], wave[4], wave[5])
        vx, vy, vz = vx + change * cx, vy + change * cy, vz + change * cz
    gx, gy, gz = _cross(nx, ny, nz, px, py, pz)
    velocity[0] += scale * (ramp * vx + steep * gx)
    velocity[1] += scale * (ramp * vy + steep * gy)
    velocity[2] += scale * (ramp * vz + steep * gz)


@numba.njit(cache=True)
def fade(clearance, width):  # type: ignore[no-untyped-def]
    """Return the ramp, 0 at the wall and 1 from `width` on, and its slope, 1/m; both are 0 at the wall."""
    share = clearance / width
    if share <= 0.0:
        return 0.0, 0.0
    if share >= 1.0:
        return 1.0, 0.0
    return share * share * (3.0 - 2.0 * share), 6.0 * share * (1.0 - share) / width


@numba.njit(cache=True)
def slope(bricks, samples, origin, spacing, x, y, z):  # type: ignore[no-untyped-def]
    """Return the interpolated clearance at one world point, m, and its own exact gradient (three values)."""
    gx = min(max((x - origin[0]) / spacing, 0.0), BRICK * bricks.shape[0] - 0.000001)
    gy = min(max((y - origin[1]) / spacing, 0.0), BRICK * bricks.shape[1] - 0.000001)
    gz = min(max((z - origin[2]) / spacing, 0.0), BRICK * bricks.shape[2] - 0.000001)
    i, j, k = int(gx), int(gy), int(gz)
    fx, fy, fz = gx - i, gy - j, gz - k
    brick = samples[bricks[i >> BRICK_BITS, j >> BRICK_BITS, k >> BRICK_BITS]]
    i, j, k = i & (BRICK - 1), j & (BRICK - 1), k & (BRICK - 1)
    a, b, c, d = brick[i, j, k], brick[i, j, k + 1], brick[i, j + 1, k], brick[i, j + 1, k + 1]
    e, f, g, h = brick[i + 1, j, k], brick[i + 1, j, k + 1], brick[i + 1, j + 1, k], brick[i + 1, j + 1, k + 1]
    ab, cd, ef, gh = a + (b - a) * fz, c + (d - c) * fz, e + (f - e) * fz, g + (h - g) * fz
    low, high = ab + (cd - ab) * fy, ef + (gh - ef) * fy
    along_y = (cd - ab) * (1 - fx) + (gh - ef) * fx
    along_z = ((b - a) * (1 - fy) + (d - c) * fy) * (1 - fx) + ((f - e) * (1 - fy) + (h - g) * fy) * fx
    return low + (high - low) * fx, (high - low) / spacing, along_y / spacing, along_z / spacing


@numba.njit(cache=True)
def _cross(ax, ay, az, bx, by, bz):  # type: ignore[no-untyped-def]
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
