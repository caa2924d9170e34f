"""Field edits: where the sampled water is corrected by what is known about it beside the surface.

All of it changes the field before its surface is drawn, so that water that is added meets the wall in one smooth piece.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.closing.columns import Column
from aquanav_tools.cave.scan.sight import Sight
from aquanav_tools.types import Array, BoolArray

Samples: TypeAlias = npt.NDArray[np.floating]
"""Values or distances of a box of samples, of any precision."""

BAND_VOXELS = 2.0
"""Distances from the wall are cut off beyond: the smoothing looks no farther."""
MIN_CAMERAS = 3
"""Space that at least so many cameras looked through is water, whatever the surface says: one may be wrong ..."""
SIGHT_VOXELS = 2.0
"""... if the wall they saw lies this far behind it, voxels: the surface itself is as thick as its noise; and if fewer
cameras show wall there: far ones err by more than this. Measured on photos taken forwards only: without the latter
0.28 m3 of rock more than 5 cm deep were taken for water, with it 0.00; of the water found, 2.5 m3 of 2.7 stay."""
SMOOTHING_REACH = 4.0
"""Four passes with the ball that smooths spurious handles look no farther than this many of its radii."""
SIGHT_SMOOTHING = 1.5
"""Standard deviation of the filter that takes slivers and pits from such water, voxels ..."""
MIN_CARVED = 0.1
"""... and changes nothing where less than this share of the surroundings was carved."""


@dataclass(frozen=True, eq=False)
class FieldEdits:
    """Corrections of the sampled water."""

    legs: Array
    """(M, 2, 3) lines that are water, m."""
    leg_radii: Array
    """(M,) how far around them, m."""
    spurious: Array
    """(K, 5) balls (centre, radius) in which wall is smoothed until no window or pillar is left in it, and how near to
    the scan it stays as it is, m."""
    smoothing_radius: float
    """Windows and pillars that are thinner than twice this disappear there, m."""
    columns: tuple[Column, ...] = ()
    """Water out to the cuts of open ends."""

    def near(self, low: Array, high: Array) -> FieldEdits:
        """Return only the legs, spurious handles and columns that reach into the box from (3,) low to (3,) high, m."""
        around = 2.0 * self.leg_radii[:, None]
        is_leg = (self.legs.min(axis=1) - around <= high).all(axis=1)
        is_leg &= (self.legs.max(axis=1) + around >= low).all(axis=1)
        centres, radii = self.spurious[:, :3], self.spurious[:, 3:4]
        is_near = ((centres - radii <= high) & (centres + radii >= low)).all(axis=1)
        columns = tuple(c for c in self.columns if (c.box[0] <= high).all() and (c.box[1] >= low).all())
        legs, radii = self.legs[is_leg], self.leg_radii[is_leg]
        return replace(self, legs=legs, leg_radii=radii, spurious=self.spurious[is_near], columns=columns)

    def is_as(self, other: FieldEdits) -> bool:
        """Return whether two sets of edits of one surface do the same."""
        return (
            np.array_equal(self.legs, other.legs)
            and np.array_equal(self.leg_radii, other.leg_radii)
            and np.array_equal(self.spurious, other.spurious)
            and (not len(self.spurious) or self.smoothing_radius == other.smoothing_radius)
            and len(self.columns) == len(other.columns)
            and all(one is another for one, another in zip(self.columns, other.columns, strict=True))
        )


NO_EDITS = FieldEdits(np.zeros((0, 2, 3)), np.zeros(0), np.zeros((0, 5)), 0.0)


def apply_edits(field: Samples, distance: Samples, origin: Array, voxel: float, edits: FieldEdits) -> Samples:
    """Return the field of a box of samples with all corrections that reach into it.

    Args:
        field: (X, Y, Z) negative in water, in voxels from the wall near it.
        distance: (X, Y, Z) from the surface, voxels.
        origin: (3,) of the first sample, m.
        voxel: spacing of the samples, m.
        edits: corrections.
    """
    field = field.copy()
    for column in edits.columns:
        part = _part(field.shape, (column.box - origin) / voxel, BAND_VOXELS)
        depth = column.depth(_points(part, origin, voxel).reshape(-1, 3)).reshape(field[part].shape)
        field[part] = np.minimum(field[part], np.clip(-depth / voxel, -BAND_VOXELS, BAND_VOXELS))
    field = _without_spurious(field, distance, origin, voxel, edits)
    return _with_legs(field, origin, voxel, edits)


def is_seen_through(sight: Sight, points: Array, voxel: float) -> BoolArray:
    """Return the (N,) flags of (N, 3) points that enough cameras looked through, and fewer show wall at."""
    num_through, num_wall = sight.votes(points, SIGHT_VOXELS * voxel).T
    seen: BoolArray = (num_through >= MIN_CAMERAS) & (num_through > num_wall)
    return seen


def with_seen_through(field: Samples, seen: BoolArray) -> Samples:
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


def _without_spurious(field: Samples, distance: Samples, origin: Array, voxel: float, edits: FieldEdits) -> Samples:
    """Change a field, in place: at spurious handles the wall is closed and opened by a ball. Return it."""
    if not len(edits.spurious):
        return field
    is_spurious = np.zeros(field.shape, dtype=bool)
    for *centre, ball, untouched in edits.spurious:
        part = _part(field.shape, (np.array([centre, centre]) - origin) / voxel, ball / voxel)
        squared = ((_points(part, origin, voxel) - centre) ** 2).sum(axis=-1)
        is_spurious[part] |= (squared < ball**2) & (distance[part] * voxel >= untouched)
    if not is_spurious.any():
        return field
    radius = edits.smoothing_radius / voxel
    places = np.argwhere(is_spurious)
    part = _part(field.shape, np.stack([places.min(axis=0), places.max(axis=0)]), SMOOTHING_REACH * radius + 1.0)
    water = _depth(field[part] >= 0) <= radius  # grown: pillars drown
    water = _depth(water) > radius  # shrunk back
    water = _depth(water) > radius  # shrunk: windows close
    water = _depth(~water) <= radius  # grown back
    field[part] = np.where(is_spurious[part], np.where(water, -1.0, 1.0), field[part])
    return field


def _depth(flags: BoolArray) -> Array:
    """Return the distances from the nearest sample that is not set, in samples; inf where every one is set."""
    from scipy.ndimage import distance_transform_edt

    return np.full(flags.shape, np.inf) if flags.all() else np.asarray(distance_transform_edt(flags))


def _with_legs(field: Samples, origin: Array, voxel: float, edits: FieldEdits) -> Samples:
    """Change a field, in place: water around the legs. Return it."""
    for (start, end), radius in zip(edits.legs, edits.leg_radii, strict=True):
        reach = radius / voxel + BAND_VOXELS
        part = _part(field.shape, (np.stack([np.minimum(start, end), np.maximum(start, end)]) - origin) / voxel, reach)
        points = _points(part, origin, voxel)
        along = end - start
        share = np.clip((points - start) @ along / max(along @ along, 1e-12), 0.0, 1.0)
        distance = np.linalg.norm(points - start - share[..., None] * along, axis=-1)
        field[part] = np.minimum(field[part], (distance - radius) / voxel)
    return field


def _part(shape: tuple[int, ...], box: Array, margin: float) -> tuple[slice, ...]:
    """Return the samples of a grid within a margin of a (2, 3) box, all in samples; none where it lies outside."""
    low = np.floor(box[0] - margin).astype(np.int64)
    high = np.ceil(box[1] + margin).astype(np.int64) + 1
    low, high = np.clip(low, 0, shape), np.clip(high, 0, shape)
    return tuple(slice(int(first), int(max(first, end))) for first, end in zip(low, high, strict=True))


def _points(part: tuple[slice, ...], origin: Array, voxel: float) -> Array:
    """Return the (X, Y, Z, 3) places of some samples, m."""
    axes = [np.arange(along.start, along.stop) for along in part]
    return np.asarray(origin + voxel * np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1))
