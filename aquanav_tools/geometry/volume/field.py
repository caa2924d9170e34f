"""The distance field: clearance sampled on a sparse grid, exact at the samples, trilinear between them."""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.types import Array, IntArray

BRICK_BITS = 3
BRICK = 1 << BRICK_BITS
"""Samples along a brick's edge."""
APRON = BRICK + 1
"""With the first samples of the next bricks, so that all eight corners of a cell are in one brick."""
BAND = 3
"""Samples of rock behind the walls that have their exact distance; deeper ones have -BAND * spacing."""
ROCK = 0
"""Number of the brick that stands for all bricks deep in the rock."""


@dataclass(frozen=True, eq=False)
class DistanceField:
    """Clearance (m to the nearest wall or portal, positive in water) on a grid that ends in rock on every side.

    Samples are kept in bricks where there is water or a wall within BAND samples; all others share one brick of rock.

    Trilinear interpolation of an exact distance errs by at most sqrt(3) / 2 * spacing: a distance changes no faster
    than the position, and the mean distance to the eight corners, by their weights, is largest in a cell's middle.
    Along a smooth wall of radius of curvature R it errs by at most 3 / 8 * spacing^2 / R. Measured in a rough passage
    of radius 2 to 4 m at 0.1 m (eval/benchmarks/field.py): median 0.004, 95 % below 0.07, at most 0.44 spacings.
    """

    origin: Array
    """(3,) world position of sample [0, 0, 0], m."""
    spacing: float
    """Distance between samples, m."""
    bricks: npt.NDArray[np.int32]
    """(X, Y, Z) number of the brick of BRICK^3 samples in each place."""
    samples: npt.NDArray[np.float32]
    """(B, APRON, APRON, APRON) clearance in each brick, m; brick ROCK is rock throughout."""

    @property
    def shape(self) -> tuple[int, int, int]:
        """Samples per axis, those of rock without a brick among them."""
        x, y, z = self.bricks.shape
        return BRICK * x, BRICK * y, BRICK * z

    @property
    def max_clearance(self) -> float:
        """Clearance of the roomiest sample, m."""
        return float(self.samples.max())

    @property
    def grid(self) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.float32], Array, float]:
        """Bricks, samples, origin and spacing: what `interpolate` reads."""
        return self.bricks, self.samples, self.origin, self.spacing

    def clearance(self, points: Array) -> Array:
        """Return the (N,) clearance at (N, 3) world points, m; outside the grid, that of the nearest border."""
        points = np.ascontiguousarray(np.atleast_2d(points), dtype=np.float64)
        return _interpolate_many(*self.grid, points)

    def clearance_at(self, point: Array) -> float:
        """Return the clearance at one (3,) world point, m."""
        return float(interpolate(*self.grid, point[0], point[1], point[2]))

    def water(self) -> tuple[IntArray, Array]:
        """Return the (N, 3) indices of all samples in the water, brick by brick, and their (N,) clearance, m."""
        places = np.argwhere(self.bricks != ROCK)
        indices, clearance = np.empty((0, 3), dtype=np.int64), np.empty(0)
        count = _list_water(places, self.bricks, self.samples, indices, clearance)
        indices, clearance = np.empty((count, 3), dtype=np.int64), np.empty(count)
        _list_water(places, self.bricks, self.samples, indices, clearance)
        return indices, clearance

    def positions(self, indices: npt.NDArray[np.int64]) -> Array:
        """Return the (N, 3) world positions of (N, 3) sample indices, m."""
        world: Array = self.origin + self.spacing * indices
        return world

    def nearest_index(self, point: Array) -> tuple[int, int, int]:
        """Return the index of the sample nearest to a (3,) world point, clipped to the grid."""
        index = np.rint((np.asarray(point) - self.origin) / self.spacing).astype(int)
        i, j, k = np.clip(index, 0, np.array(self.shape) - 1)
        return int(i), int(j), int(k)


def field_from_bricks(
    origin: Array, spacing: float, bricks: npt.NDArray[np.int32], cores: npt.NDArray[np.float32]
) -> DistanceField:
    """Return the field of (B, BRICK, BRICK, BRICK) samples per brick, the apron taken from the next bricks.

    Args:
        origin: (3,) world position of sample [0, 0, 0], m.
        spacing: distance between samples, m.
        bricks: (X, Y, Z) number of the brick in each place, ROCK where there is none.
        cores: clearance, m; what stands under ROCK is overwritten.
    """
    samples = np.full((len(cores), APRON, APRON, APRON), -BAND * spacing, dtype=np.float32)
    samples[1:, :BRICK, :BRICK, :BRICK] = cores[1:]
    fill_aprons(bricks, samples)
    return DistanceField(np.asarray(origin, dtype=np.float64), float(spacing), bricks, samples)


def field_from_dense(origin: Array, spacing: float, values: npt.NDArray[np.float32]) -> DistanceField:
    """Return the field of (X, Y, Z) samples on a dense grid; bricks without water are left out."""
    counts = [-(-count // BRICK) for count in values.shape]
    padded = np.full([BRICK * count for count in counts], -BAND * spacing, dtype=np.float32)
    padded[tuple(slice(count) for count in values.shape)] = values
    blocks = padded.reshape(counts[0], BRICK, counts[1], BRICK, counts[2], BRICK).transpose(0, 2, 4, 1, 3, 5)
    is_kept = blocks.max(axis=(3, 4, 5)) > -BAND * np.float32(spacing)
    bricks = number_bricks(is_kept)
    rock = np.full((1, BRICK, BRICK, BRICK), -BAND * spacing, dtype=np.float32)
    return field_from_bricks(origin, spacing, bricks, np.concatenate([rock, blocks[is_kept]]))


def number_bricks(is_kept: npt.NDArray[np.bool_]) -> npt.NDArray[np.int32]:
    """Return numbers from 1 for the places that hold a brick, in C order, ROCK for the others."""
    numbers = np.cumsum(is_kept, dtype=np.int32).reshape(is_kept.shape)
    numbers[~is_kept] = ROCK
    return numbers


@numba.njit(cache=True)
def interpolate(bricks, samples, origin, spacing, x, y, z):  # type: ignore[no-untyped-def]
    """Return the clearance at one world point from the arrays of a field, for compiled callers."""
    gx = min(max((x - origin[0]) / spacing, 0.0), BRICK * bricks.shape[0] - 0.000001)
    gy = min(max((y - origin[1]) / spacing, 0.0), BRICK * bricks.shape[1] - 0.000001)
    gz = min(max((z - origin[2]) / spacing, 0.0), BRICK * bricks.shape[2] - 0.000001)
    i, j, k = int(gx), int(gy), int(gz)
    fx, fy, fz = gx - i, gy - j, gz - k
    n = bricks[i >> BRICK_BITS, j >> BRICK_BITS, k >> BRICK_BITS]
    i, j, k = i & (BRICK - 1), j & (BRICK - 1), k & (BRICK - 1)
    low = (samples[n, i, j, k] * (1 - fx) + samples[n, i + 1, j, k] * fx) * (1 - fy) + (
        samples[n, i, j + 1, k] * (1 - fx) + samples[n, i + 1, j + 1, k] * fx
    ) * fy
    high = (samples[n, i, j, k + 1] * (1 - fx) + samples[n, i + 1, j, k + 1] * fx) * (1 - fy) + (
        samples[n, i, j + 1, k + 1] * (1 - fx) + samples[n, i + 1, j + 1, k + 1] * fx
    ) * fy
    return low * (1 - fz) + high * fz


@numba.njit(cache=True)
def _interpolate_many(bricks, samples, origin, spacing, points):  # type: ignore[no-untyped-def]
    result = np.empty(len(points))
    for n in range(len(points)):
        result[n] = interpolate(bricks, samples, origin, spacing, points[n, 0], points[n, 1], points[n, 2])
    return result


@numba.njit(cache=True)
def _list_water(places, bricks, samples, indices, clearance):  # type: ignore[no-untyped-def]
    """Write the indices and the clearance of all samples in the water where there is room; return how many."""
    count = 0
    for x, y, z in places:
        core = samples[bricks[x, y, z]]
        for i in range(BRICK):
            for j in range(BRICK):
                for k in range(BRICK):
                    if core[i, j, k] > 0.0:
                        if len(indices):
                            indices[count, 0], indices[count, 1] = BRICK * x + i, BRICK * y + j
                            indices[count, 2], clearance[count] = BRICK * z + k, core[i, j, k]
                        count += 1
    return count


@numba.njit(cache=True)
def fill_aprons(bricks, samples):  # type: ignore[no-untyped-def]
    """Copy the first samples (numbers or vectors) of the next bricks behind the last ones of each, in place.

    Beyond the grid they stay as they are: rock, or still water.
    """
    for x in range(bricks.shape[0]):
        for y in range(bricks.shape[1]):
            for z in range(bricks.shape[2]):
                if bricks[x, y, z] != ROCK:
                    _fill_apron(bricks, samples, x, y, z)


@numba.njit(cache=True)
def _fill_apron(bricks, samples, x, y, z):  # type: ignore[no-untyped-def]
    own = samples[bricks[x, y, z]]
    for step in range(1, 8):
        dx, dy, dz = step & 1, (step >> 1) & 1, step >> 2
        if x + dx < bricks.shape[0] and y + dy < bricks.shape[1] and z + dz < bricks.shape[2]:
            following = samples[bricks[x + dx, y + dy, z + dz]]
            for i in range(1 if dx else BRICK):
                for j in range(1 if dy else BRICK):
                    for k in range(1 if dz else BRICK):
                        own[i + dx * BRICK, j + dy * BRICK, k + dz * BRICK] = following[i, j, k]
