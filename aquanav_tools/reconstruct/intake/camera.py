"""The camera that mapping starts from: a model that can bend as the lens and its housing do, and a focal length."""

from __future__ import annotations

from dataclasses import dataclass

from aquanav_tools.reconstruct.images import Photo
from aquanav_tools.reconstruct.intake.options import IntakeOptions
from aquanav_tools.reconstruct.intake.refraction import WATER

_UNKNOWN_FOCAL = 1.2
"""Focal length over the larger image side where nothing is known (COLMAP's default)."""
_UNKNOWN_FISHEYE_FOCAL = 0.5
"""The same for a fisheye: 115 degrees across, as action cameras have in their wide setting."""


@dataclass(frozen=True)
class CameraGuess:
    """Where the adjustment of a camera starts."""

    model: str
    """COLMAP's name of it."""
    focal_px: float
    is_known: bool
    """The focal length is good enough to judge pairs of photos by it."""


def first_guess(photo: Photo, intake: IntakeOptions, focal_px: float | None) -> CameraGuess:
    """Return the camera that took a photo.

    Args:
        photo: One of those that share it.
        intake: Lens and housing. A flat port bends more towards the edge than one radial term follows.
        focal_px: In water, where the user knows it; it wins over EXIF, which tells that in air.
    """
    side = max(photo.width, photo.height)
    growth = WATER if intake.housing == "flat-port" else 1.0
    if intake.lens == "fisheye":
        # Counts as known even where it is guessed: COLMAP compares photos of an unknown focal length by straight
        # epipolar lines, and a fisheye has none. A fifth too long or too short still verifies all pairs (measured).
        return CameraGuess("OPENCV_FISHEYE", focal_px or photo.focal_px or _UNKNOWN_FISHEYE_FOCAL * side, True)
    model = "RADIAL" if intake.housing == "flat-port" else "SIMPLE_RADIAL"
    if focal_px is not None:
        return CameraGuess(model, focal_px, True)
    in_air = photo.focal_px or _UNKNOWN_FOCAL * side
    return CameraGuess(model, growth * in_air, photo.focal_px is not None)
