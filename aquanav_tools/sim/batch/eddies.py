"""Eddies: turbulence as the curl of a random potential that fades towards the walls.

The curl of anything has no divergence, and where the potential is zero on a surface, nothing flows through it. So a sum
of waves times a ramp of the clearance gives eddies that lose no water and vanish at walls and lids, exactly, wherever
they are sampled: no grid stores them. The waves have Kolmogorov's share of speed for their length.

Source: Bridson, Houriham and Nordenstam, Curl-Noise for Procedural Fluid Flow, ACM Transactions on Graphics 26 (2007).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp

from aquanav_tools.geometry.volume.field import DistanceField
from aquanav_tools.sim.batch.blocks import cell_of, corner
from aquanav_tools.sim.batch.field import Grid
from aquanav_tools.sim.batch.runtime import OPTIONS, launch_kernel
from aquanav_tools.types import Array

wp.set_module_options(OPTIONS)

f64 = wp.float64
NUM_WAVES = 16
LONGEST = 4.0
"""Wavelength of the largest eddies over the clearance that is usual: they fill the passage, half a wave across."""
OCTAVES = 2.0
"""Between the largest and the smallest eddies; smaller ones hardly move a vehicle."""
KOLMOGOROV = 1.0 / 3.0
"""Speed grows with this power of the eddies' size (Kolmogorov 1941)."""
MAX_PLACES = 20_000
"""Samples of the water over which the mean speed is taken."""


def draw_waves(
    field: DistanceField, grid: Grid, usual_clearance: float, rng: np.random.Generator, device: Any
) -> Array:
    """Return waves whose eddies have a root mean square speed of 1 m/s over the water.

    Args:
        field: The water's clearance.
        grid: The same on the device.
        usual_clearance: Of the passages, m: the eddies' potential fades over it.
        rng: Picks their directions.
        device: Warp's.

    Returns:
        (NUM_WAVES, 8): wave vector (3,), rad/m; the potential's direction (3,), square to it, times its size, m^2/s;
        wavelength, m; and the distance over which the potential fades, m.
    """
    lengths = LONGEST * usual_clearance * 2.0 ** (-OCTAVES * np.linspace(0.0, 1.0, NUM_WAVES))
    vectors = _unit(rng.normal(size=(NUM_WAVES, 3))) * (2.0 * np.pi / lengths)[:, None]
    across = _unit(np.cross(vectors, rng.normal(size=(NUM_WAVES, 3))))
    sizes = (lengths / lengths[0]) ** KOLMOGOROV * lengths / (2.0 * np.pi)
    waves = np.column_stack([vectors, across * sizes[:, None], lengths, np.full(NUM_WAVES, usual_clearance)])
    waves[:, 3:6] /= _mean_speed(waves, field, grid, device)
    return waves


def _mean_speed(waves: Array, field: DistanceField, grid: Grid, device: Any) -> float:
    """Return the root mean square speed of waves with unit variance over the water, m/s."""
    indices, _ = field.water()
    points = field.positions(indices[:: max(1, len(indices) // MAX_PLACES)])
    squares = wp.zeros(len(points), dtype=f64, device=device)
    places = wp.array(points, dtype=wp.vec3d, device=device)
    on_device = wp.array(waves, dtype=f64, ndim=2, device=device)
    launch_kernel(
        _expected_squares, dim=len(points), inputs=[grid, on_device, places], outputs=[squares], device=device
    )
    return float(np.sqrt(squares.numpy().mean()))


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return unit


@wp.struct
class Fading:
    """What the waves' potential is multiplied by near walls, and how that grows."""

    ramp: f64
    """0 at the wall and 1 in open water."""
    slope: wp.vec3d
    """Its gradient, 1/m; zero at the wall."""


@wp.func
def sloping_room(grid: Grid, position: wp.vec3d):
    """Return the clearance at a place, m, as it is interpolated, and its own exact gradient."""
    place = (position - grid.origin) / grid.spacing
    x = wp.clamp(place[0], f64(0.0), f64(grid.last[0]))
    y = wp.clamp(place[1], f64(0.0), f64(grid.last[1]))
    z = wp.clamp(place[2], f64(0.0), f64(grid.last[2]))
    i, j, k = int(x), int(y), int(z)
    fx, fy, fz = x - f64(i), y - f64(j), z - f64(k)
    one = f64(1.0)
    number = cell_of(grid.bricks, grid.samples, grid.num_y, grid.num_z, i, j, k)
    a, b = f64(corner(grid.samples, number, 0, 0, 0)), f64(corner(grid.samples, number, 0, 0, 1))
    c, d = f64(corner(grid.samples, number, 0, 1, 0)), f64(corner(grid.samples, number, 0, 1, 1))
    e, f = f64(corner(grid.samples, number, 1, 0, 0)), f64(corner(grid.samples, number, 1, 0, 1))
    g, h = f64(corner(grid.samples, number, 1, 1, 0)), f64(corner(grid.samples, number, 1, 1, 1))
    ab, cd, ef, gh = a + (b - a) * fz, c + (d - c) * fz, e + (f - e) * fz, g + (h - g) * fz
    low, high = ab + (cd - ab) * fy, ef + (gh - ef) * fy
    along_y = (cd - ab) * (one - fx) + (gh - ef) * fx
    along_z = ((b - a) * (one - fy) + (d - c) * fy) * (one - fx) + ((f - e) * (one - fy) + (h - g) * fy) * fx
    return (low + (high - low) * fx) * grid.spacing, wp.vec3d(high - low, along_y, along_z)


@wp.func
def fading_at(grid: Grid, position: wp.vec3d, width: f64):
    """Return the ramp at a place: it rises within `width` of the wall, m."""
    fading = Fading()
    room, away = sloping_room(grid, position)
    part = room / width
    if part >= f64(1.0):
        fading.ramp = f64(1.0)
    elif part > f64(0.0):
        fading.ramp = part * part * (f64(3.0) - f64(2.0) * part)
        fading.slope = f64(6.0) * part * (f64(1.0) - part) / width * away
    return fading


@wp.func
def eddies_at(
    waves: wp.array2d(dtype=f64), grid: Grid, coefficients: wp.array2d(dtype=f64), vehicle: int, position: wp.vec3d
):
    """Return the eddies' velocity at a place, m/s, before it is scaled.

    Args:
        waves: From `draw_waves`.
        grid: Clearance.
        coefficients: (N, 1 + 2 NUM_WAVES) the gust's, then the size of each wave's cosine, then of each wave's sine; of
            unit variance.
        vehicle: Which row of the coefficients.
        position: World, m.
    """
    fading = fading_at(grid, position, waves[0, 7])
    if fading.ramp == f64(0.0):
        return wp.vec3d()
    count = waves.shape[0]
    potential, velocity = wp.vec3d(), wp.vec3d()
    for n in range(count):
        vector = wp.vec3d(waves[n, 0], waves[n, 1], waves[n, 2])
        across = wp.vec3d(waves[n, 3], waves[n, 4], waves[n, 5])
        angle = wp.dot(vector, position)
        cosine, sine = wp.cos(angle), wp.sin(angle)
        even, odd = coefficients[vehicle, 1 + n], coefficients[vehicle, 1 + count + n]
        potential += (even * cosine + odd * sine) * across
        velocity += (odd * cosine - even * sine) * wp.cross(vector, across)
    return fading.ramp * velocity + wp.cross(fading.slope, potential)


@wp.kernel
def _expected_squares(
    grid: Grid, waves: wp.array2d(dtype=f64), places: wp.array(dtype=wp.vec3d), squares: wp.array(dtype=f64)
):
    """Write the mean square speed at each place over all coefficients of unit variance, (m/s)^2."""
    i = wp.tid()
    fading, total = fading_at(grid, places[i], waves[0, 7]), f64(0.0)
    for n in range(waves.shape[0]):
        across = wp.vec3d(waves[n, 3], waves[n, 4], waves[n, 5])
        swirl = fading.ramp * wp.cross(wp.vec3d(waves[n, 0], waves[n, 1], waves[n, 2]), across)
        total += wp.length_sq(swirl) + wp.length_sq(wp.cross(fading.slope, across))
    squares[i] = total
