"""How sharp a picture is, whatever its brightness, contrast and lamp."""

from __future__ import annotations

from aquanav_tools.reconstruct.intake.decode import GreyImage

_COARSE_PX = 4.0
"""Standard deviation of the blur that parts coarse structure, which lamps and haze shape, from fine."""


def sharpness(grey: GreyImage) -> float:
    """Return the variance of the Laplacian over that of all structure finer than a few pixels.

    The plain variance of the Laplacian grows with the square of the contrast, which turbid water takes away; the ratio
    does not. It falls when only the finest structure is lost, as it is to motion and bad focus.
    """
    import cv2
    import numpy as np

    values = grey.astype(np.float32)
    fine = values - cv2.GaussianBlur(values, (0, 0), _COARSE_PX)
    return float(cv2.Laplacian(values, cv2.CV_32F).var() / max(fine.var(), 1.0))
