"""Contrast that turbid water took away, given back: equalised by tiles, in luminance alone, so that hues stay."""

from __future__ import annotations

import numpy as np
from PIL import Image

_CLIP_LIMIT = 3.0
"""Contrast may grow by this factor (OpenCV's unit: clip of a tile's histogram over its mean)."""
_TILES = 8
"""Along each side."""


def equalised(picture: Image.Image) -> Image.Image:
    """Return an 8-bit grey or RGB picture with its local contrast equalised (CLAHE; Zuiderveld, Graphics Gems IV)."""
    import cv2

    equaliser = cv2.createCLAHE(_CLIP_LIMIT, (_TILES, _TILES))
    pixels = np.asarray(picture)
    if pixels.ndim == 2:
        return Image.fromarray(equaliser.apply(pixels))
    lab = cv2.cvtColor(pixels, cv2.COLOR_RGB2LAB)
    lab[..., 0] = equaliser.apply(lab[..., 0])
    return Image.fromarray(cv2.cvtColor(lab, cv2.COLOR_LAB2RGB))
