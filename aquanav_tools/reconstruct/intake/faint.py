"""Faint texture brought out of a photo's noise, for the search of features."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

_SMOOTH_PX = 1.5
"""Averages the sensor's noise; detail of mud and veiled rock is coarser (measured: 1.5 gave most true matches)."""
_SURROUNDINGS_PX = 20.0
"""Standard deviation of the window that brightness and contrast are measured in."""
_LEAST_CONTRAST = 0.5
"""Grey values that count as one standard deviation at least: what is flat must not become noise."""
_CONTRAST = 40.0
"""Standard deviation of the result, of 255."""


def brought_out(grey: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """Return an (H, W) grey picture with the same brightness and contrast everywhere, noise averaged first."""
    import cv2

    def around(values: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
        return np.asarray(cv2.GaussianBlur(values, (0, 0), _SURROUNDINGS_PX), np.float32)

    smooth = np.asarray(cv2.GaussianBlur(grey.astype(np.float32), (0, 0), _SMOOTH_PX), np.float32)
    detail = smooth - around(smooth)
    contrast = np.sqrt(around(detail**2)) + _LEAST_CONTRAST
    return np.clip(128.0 + _CONTRAST * detail / contrast, 0.0, 255.0).astype(np.uint8)
