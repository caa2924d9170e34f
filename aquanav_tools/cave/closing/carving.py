"""Carving: where the sampled water is corrected by what is known about it beside the surface.

All of it changes the field before its surface is drawn, so that water that is added meets the wall in one smooth piece.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from aquanav_tools.cave.closing.columns import Column
from aquanav_tools.cave.scan.sight import Sight
from aquanav_tools.types import Array, BoolArray

BAND_VOXELS = 2.0
"""Distances from the wall are cut off beyond: the smoothing looks no farther."""
MIN_CAMERAS = 3
"""Space that at least so many cameras looked through is water, whatever the surface says: one may be wrong ..."""
SIGHT_VOXELS = 2.0
"""... if the wall they saw lies this far behind it, voxels: the surface itself is as thick as its noise; and if fewer
cameras show wall there: far ones err by more than this. Measured on photos taken forwards only: without the latter
0.28 m3 of rock more than 5 cm deep were taken for water, with it 0.00; of the water found, 2.5 m3 of 2.7 stay."""
SIGHT_SMOOTHING = 1.5
"""Standard deviation of the filter that takes slivers and pits from such water, voxels ..."""
MIN_CARVED = 0.1
"""... and changes nothing where less than this share of the surroundings was carved."""


@dataclass(frozen=True, eq=False)
class Carving:
    """Corrections of the sampled water."""

    legs: Array
    """(M, 2, 3) lines that are water up to `leg_radius` around them, m."""
    leg_radius: float
    """m."""
    faults: Array
    """(K, 5) balls (centre, radius) in which wall is smoothed until no window or pillar is left in it, and how near to
    the scan it stays as it is, m."""
    fault_radius: float
    """Windows and pillars that are thinner than twice this disappear there, m."""
    columns: tuple[Column, ...] = ()
    """Water out to the cuts of open ends."""

    def near(self, low: Array, high: Array) -> Carving:
        """Return only the legs, faults and columns that reach into the box from (3,) low to (3,) high, m."""
        around = 2.0 * self.leg_radius
        is_leg = (self.legs.min(axis=1) - around <= high).all(axis=1)
        is_leg &= (self.legs.max(axis=1) + around >= low).all(axis=1)
        centres, radii = self.faults[:, :3], self.faults[:, 3:4]
        is_fault = ((centres - radii <= high) & (centres + radii >= low)).all(axis=1)
        columns = tuple(c for c in self.columns if (c.box[0] <= high).all() and (c.box[1] >= low).all())
        return replace(self, legs=self.legs[is_leg], faults=self.faults[is_fault], columns=columns)

    def is_as(self, other: Carving) -> bool:
        """Return whether two carvings of one surface do the same."""
        return (
            np.array_equal(self.legs, other.legs)
            and np.array_equal(self.faults, other.faults)
            and (not len(self.faults) or self.fault_radius == other.fault_radius)
            and len(self.columns) == len(other.columns)
            and all(one is another for one, another in zip(self.columns, other.columns, strict=True))
        )


NO_CARVING = Carving(np.zeros((0, 2, 3)), 0.0, np.zeros((0, 5)), 0.0)


def carve(field: Array, distance: Array, origin: Array, voxel: float, carving: Carving) -> Array:
    """Return the field of a box of samples with all corrections that reach into it.

    Args:
        field: (X, Y, Z) negative in water, in voxels from the wall near it.
        distance: (X, Y, Z) from the surface, voxels.
        origin: (3,) of the first sample, m.
        voxel: spacing of the samples, m.
        carving: corrections.
    """
    for column in carving.columns:
        points = origin + voxel * np.stack(np.meshgrid(*[np.arange(n) for n in field.shape], indexing="ij"), axis=-1)
        depth = column.depth(points.reshape(-1, 3)).reshape(field.shape)
        field = np.minimum(field, np.clip(-depth / voxel, -BAND_VOXELS, BAND_VOXELS))
    field = _without_faults(field, distance, origin, voxel, carving)
    return _with_legs(field, origin, voxel, carving)


def is_seen_through(sight: Sight, points: Array, voxel: float) -> BoolArray:
    """Return the (N,) flags of (N, 3) points that enough cameras looked through, and fewer show wall at."""
    num_through, num_wall = sight.votes(points, SIGHT_VOXELS * voxel).T
    seen: BoolArray = (num_through >= MIN_CAMERAS) & (num_through > num_wall)
    return seen


def with_seen_through(field: Array, seen: BoolArray) -> Array:
    """Return an (X, Y, Z) field with water where (X, Y, Z) flags are set, its border as smooth as noise allows."""
    from scipy.ndimage import gaussian_filter

    if not seen.any():
        return field
    carved = seen.astype(np.float32)
    wet = np.where(field < 0.0, np.float32(1.0), carved)
    wet, beside = (gaussian_filter(mask, SIGHT_SMOOTHING, truncate=3.0) for mask in (wet, carved))
    # Across a flat border the smooth mask falls by 1 / (sigma * sqrt(2 pi)) per voxel.
    level = np.clip((0.5 - wet) * SIGHT_SMOOTHING * np.sqrt(2.0 * np.pi), -BAND_VOXELS, BAND_VOXELS)
    return np.where(beside > MIN_CARVED, np.minimum(field, level), field)


def _without_faults(field: Array, distance: Array, origin: Array, voxel: float, carving: Carving) -> Array:
    """Return the field with the wall closed and opened by a ball inside the faulty places."""
    from scipy.ndimage import distance_transform_edt

    if not len(carving.faults):
        return field
    points = origin + voxel * np.stack(np.meshgrid(*[np.arange(n) for n in field.shape], indexing="ij"), axis=-1)
    is_faulty = np.zeros(field.shape, dtype=bool)
    for x, y, z, radius, untouched in carving.faults:
        is_faulty |= (((points - (x, y, z)) ** 2).sum(axis=-1) < radius**2) & (distance * voxel >= untouched)
    radius = carving.fault_radius / voxel
    water = distance_transform_edt(field >= 0) <= radius  # grown: pillars drown
    water = distance_transform_edt(water) > radius  # shrunk back
    water = distance_transform_edt(water) > radius  # shrunk: windows close
    water = distance_transform_edt(~water) <= radius  # grown back
    smooth = np.where(water, -1.0, 1.0)
    return np.where(is_faulty, smooth, field)


def _with_legs(field: Array, origin: Array, voxel: float, carving: Carving) -> Array:
    """Return the field with water around the legs."""
    for start, end in carving.legs:
        points = origin + voxel * np.stack(np.meshgrid(*[np.arange(n) for n in field.shape], indexing="ij"), axis=-1)
        along = end - start
        share = np.clip((points - start) @ along / max(along @ along, 1e-12), 0.0, 1.0)
        distance = np.linalg.norm(points - start - share[..., None] * along, axis=-1)
        field = np.minimum(field, (distance - carving.leg_radius) / voxel)
    return field
