"""Texture brought out of a photo's shades and noise, for the search of features."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

_SMOOTH_PX = 0.8
"""Enough for a photo without much noise (measured on a dive with wide steps)."""
_SMOOTH_NOISY_PX = 1.5
"""Averages the sensor's noise; detail of mud and veiled rock is coarser (measured: 1.5 gave most true matches)."""
_NOISY = 1.5
"""Strength of detail below 1 px over that of 1.5 to 3 px from which it is noise. Rock by lamp light, clear or veiled,
shows 0.5 to 1.2, and 1.6 to 3.4 where it is muddy or dark and the sensor noisy (measured, 7 rendered dives)."""
_SURROUNDINGS_PX = 20.0
"""Standard deviation of the window that brightness and contrast are measured in."""
_COARSER = 4
"""Times that pixels are coarser where surroundings are measured: 99 % of the result is the same within 2 grey values,
in a third of the time."""
_LEAST_CONTRAST = 0.5
"""Grey values that count as one standard deviation at least: what is flat must not become noise."""
_CONTRAST = 40.0
"""Standard deviation of the result, of 255."""

Grey = npt.NDArray[np.float32]


def brought_out(photo: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return an (H, W) grey picture with the same brightness and contrast everywhere, noise averaged first.

    A lamp that moves with the camera lights the same rock brightly in one photo and dimly in the next: so that rock
    shown by two photos gives the same keypoints in both, all of it has to count alike. On photos of clear water too
    this doubles the true matches of pairs that overlap little.
    """
    grey = photo.astype(np.float32)
    smooth = _blurred(grey, _SMOOTH_NOISY_PX if is_noisy(grey) else _SMOOTH_PX)
    detail = smooth - _surroundings(smooth)
    contrast = np.sqrt(_surroundings(detail**2)) + _LEAST_CONTRAST
    return np.clip(128.0 + _CONTRAST * detail / contrast, 0.0, 255.0).astype(np.uint8)


def is_noisy(grey: Grey) -> bool:
    """Return whether the finest detail of an (H, W) picture is mostly noise: texture of rock grows with its size."""
    finest = grey - _blurred(grey, 0.8)
    coarser = _blurred(grey, 1.5) - _blurred(grey, 3.0)
    return float(np.std(finest)) > _NOISY * float(np.std(coarser))


def _surroundings(values: Grey) -> Grey:
    """Return the mean around each pixel of an (H, W) picture."""
    import cv2

    height, width = values.shape
    size = (max(1, width // _COARSER), max(1, height // _COARSER))
    coarse = np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), np.float32)
    blurred = _blurred(coarse, _SURROUNDINGS_PX / _COARSER)
    return np.asarray(cv2.resize(blurred, (width, height), interpolation=cv2.INTER_LINEAR), np.float32)


def _blurred(grey: Grey, sigma_px: float) -> Grey:
    import cv2

    return np.asarray(cv2.GaussianBlur(grey, (0, 0), sigma_px), np.float32)
