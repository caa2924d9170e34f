"""Lines of sight through pixels of registered photos, and the points where they meet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.reconstruct.intake.names import name_of
from aquanav_tools.reconstruct.mapping import SparseModel
from aquanav_tools.types import Array, BoolArray

MIN_ANGLE = np.deg2rad(1.5)
"""Lines that meet under less than this do not tell how far away; COLMAP's own limit for points of its model."""
MAX_PAIRS = 300


@dataclass(frozen=True, eq=False)
class Rays:
    """Lines of sight, in the model's frame."""

    origins: Array
    """(N, 3) camera centres."""
    directions: Array
    """(N, 3) unit vectors."""
    pixel_angles: Array
    """(N,) angle that a pixel fills, rad."""

    def __len__(self) -> int:
        return len(self.origins)

    def misfits(self, point: Array) -> Array:
        """Return (N,) px: how far each line passes by a (3,) point; infinite where the point is behind the camera."""
        towards = point - self.origins
        ahead = np.einsum("nc,nc->n", towards, self.directions)
        beside = np.linalg.norm(towards - ahead[:, None] * self.directions, axis=1)
        return np.where(ahead > 0.0, beside / np.maximum(ahead, 1e-12) / self.pixel_angles, np.inf)

    def only(self, keep: BoolArray) -> Rays:
        """Return some of the lines."""
        return Rays(self.origins[keep], self.directions[keep], self.pixel_angles[keep])


@dataclass(frozen=True, eq=False)
class Intersection:
    """A point that was seen from several places."""

    point: Array
    """(3,)"""
    covariance: Array
    """(3, 3) for pixels with a standard deviation of one."""
    is_seen: BoolArray
    """(N,) which lines meet there."""


def rays_through(sparse: SparseModel, name: str, pixels: Array) -> Rays:
    """Return the lines of sight through (K, 2) pixels of a registered photo.

    Args:
        sparse: The model.
        name: The photo.
        pixels: x, y from the upper left corner of the photo, as COLMAP counts: the first pixel's centre is at 0.5.
    """
    image = next(one for one in sparse.model.images.values() if name_of(one.name) == name)
    camera, pose = image.camera, image.cam_from_world()
    at_depth_one = np.column_stack([camera.cam_from_img(pixels.astype(np.float64)), np.ones(len(pixels))])
    directions = at_depth_one @ pose.rotation.matrix()
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = np.tile(image.projection_center(), (len(pixels), 1))
    return Rays(origins, directions, np.full(len(pixels), 1.0 / camera.mean_focal_length()))


def join(parts: list[Rays]) -> Rays:
    """Return the lines of several photos as one."""
    return Rays(
        np.concatenate([part.origins for part in parts]),
        np.concatenate([part.directions for part in parts]),
        np.concatenate([part.pixel_angles for part in parts]),
    )


def meet(rays: Rays, tolerance_px: float) -> Intersection | None:
    """Return the point that most lines meet at within a tolerance; None where no two meet at an angle that tells.

    Every pair of lines (MAX_PAIRS of them, evenly chosen) proposes a point; the one with most lines is refined.
    """
    first, second = np.triu_indices(len(rays), 1)
    best = None
    for pair in np.unique(np.linspace(0, len(first) - 1, min(len(first), MAX_PAIRS)).astype(int)):
        point = _nearest(rays.only(np.isin(np.arange(len(rays)), [first[pair], second[pair]])))
        is_seen = rays.misfits(point) <= tolerance_px
        if best is None or is_seen.sum() > best.sum():
            best = is_seen
    if best is None or best.sum() < 2:
        return None
    for _ in range(3):
        seen = rays.only(best)
        point = _nearest(seen, np.linalg.norm(_nearest(seen) - seen.origins, axis=1) * seen.pixel_angles)
        best = rays.misfits(point) <= tolerance_px
        if best.sum() < 2:
            return None
    seen = rays.only(best)
    if _widest_angle(seen, point) < MIN_ANGLE:
        return None
    return Intersection(point, np.linalg.inv(_information(seen, point)).astype(np.float64), best)


def _nearest(rays: Rays, widths: Array | None = None) -> Array:
    """Return the (3,) point with the least squared distance from lines, each in units of its (N,) width."""
    across = np.eye(3) - rays.directions[:, :, None] * rays.directions[:, None, :]
    if widths is not None:
        across = across / widths[:, None, None] ** 2
    point: Array = np.linalg.lstsq(across.sum(axis=0), np.einsum("nij,nj->i", across, rays.origins), rcond=None)[0]
    return point


def _information(rays: Rays, point: Array) -> Array:
    """Return the (3, 3) information about a point for errors of one pixel."""
    widths = np.linalg.norm(point - rays.origins, axis=1) * rays.pixel_angles
    across = np.eye(3) - rays.directions[:, :, None] * rays.directions[:, None, :]
    information: Array = (across / widths[:, None, None] ** 2).sum(axis=0)
    return information


def _widest_angle(rays: Rays, point: Array) -> float:
    towards = point - rays.origins
    towards = towards / np.linalg.norm(towards, axis=1, keepdims=True)
    return float(np.arccos(np.clip(towards @ towards.T, -1.0, 1.0)).max())
