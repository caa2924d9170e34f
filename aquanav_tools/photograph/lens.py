"""Where a lens puts what lies in front of it: COLMAP's PINHOLE and OPENCV_FISHEYE."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.photograph.options import DISTORTION, CameraOptions
from aquanav_tools.types import Array

_NEWTON_STEPS = 8
"""From the undistorted angle; it converges quadratically, to float precision for the distortion of real lenses."""


@dataclass(frozen=True)
class Lens:
    """A camera's intrinsics; the axis meets the photo in its middle, pixel centres lie at 0.5."""

    width: int
    """px."""
    height: int
    """px."""
    focal_px: float
    distortion: tuple[float, ...] = ()
    """k1 to k4 of OPENCV_FISHEYE; empty for a pinhole."""

    @property
    def model(self) -> str:
        """COLMAP's name."""
        return "OPENCV_FISHEYE" if self.distortion else "PINHOLE"

    @property
    def parameters(self) -> tuple[float, ...]:
        """COLMAP's parameters: fx, fy, cx, cy and the distortion."""
        return (self.focal_px, self.focal_px, self.width / 2, self.height / 2, *self.distortion)

    def rays(self) -> Array:
        """Return (H * W, 3) unit rays in the camera frame through the pixel centres, row by row."""
        x, y = np.meshgrid(
            (np.arange(self.width) + 0.5 - self.width / 2) / self.focal_px,
            (np.arange(self.height) + 0.5 - self.height / 2) / self.focal_px,
        )
        if not self.distortion:
            rays = np.stack([x, y, np.ones_like(x)], axis=-1)
            rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
            return rays.reshape(-1, 3)
        radius = np.hypot(x, y)
        angle = self._angle(radius)
        sideways = np.sin(angle) / np.maximum(radius, 1e-12)
        return np.stack([x * sideways, y * sideways, np.cos(angle)], axis=-1).reshape(-1, 3)

    def project(self, points: Array) -> Array:
        """Return the (N, 2) pixels of (N, 3) points in the camera frame; NaN behind a pinhole.

        A fisheye sees up to 90 degrees off the axis; beyond that its pixels mean nothing and are NaN too.
        """
        x, y, z = points.T
        ahead = np.where(z > 0.0, z, np.nan)
        if not self.distortion:
            scale = self.focal_px / ahead
        else:
            across = np.hypot(x, y)
            scale = self.focal_px * self._radius(np.arctan2(across, ahead)) / np.maximum(across, 1e-12)
        return np.stack([x * scale + self.width / 2, y * scale + self.height / 2], axis=1)

    def _radius(self, angle: Array) -> Array:
        """Return the distance from the photo's middle over the focal length."""
        square = angle * angle
        radius: Array = angle * (1.0 + square * np.polynomial.polynomial.polyval(square, self.distortion))
        return radius

    def _angle(self, radius: Array) -> Array:
        """Return the angle off the axis at a distance from the middle over the focal length: `_radius` inverted."""
        slope = (1.0, *((2 * k + 3) * c for k, c in enumerate(self.distortion)))
        angle = radius.copy()
        for _ in range(_NEWTON_STEPS):
            angle -= (self._radius(angle) - radius) / np.polynomial.polynomial.polyval(angle * angle, slope)
        return angle


def make_lens(options: CameraOptions) -> Lens:
    """Return the camera's lens."""
    return Lens(options.width, options.height, options.focal_px, DISTORTION[options.lens])
