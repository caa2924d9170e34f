"""What water does to lamp light between rock and lens: it dims, blurs and veils.

Jaffe's and McGlamery's model (Jaffe, Computer modeling and the design of optimal underwater imaging systems, 1990):
light that comes straight, light scattered a little off its way, and light scattered back before it met any rock. As
Akkaynak and Treibitz (A revised underwater image formation model, 2018) insist, direct light and veil fade with
different effective coefficients: here because the veil is summed up along the ray.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from aquanav_tools.photograph.options import Water
from aquanav_tools.types import Array

FloatImage = npt.NDArray[np.float32]

BACK_SHARE = 0.00315
"""Of the scattered light, the share per steradian that comes straight back: Petzold's average particle phase function
at 180 degrees (Mobley, Light and Water, 1994, table 3.10), 1/sr."""
BLUR_ANGLE = np.radians(1.5)
"""Spread of the light scattered ahead, radians. Chosen: about half of it turns by less than 5 degrees, and most of
that share by far less."""
_OPEN_WATER = 1e3
"""Distance that stands for no rock at all, m."""
_NODES = 32
_SAMPLES = 400


def transmission(path: Array | FloatImage, water: Water) -> FloatImage:
    """Return (..., 3) how much red, green and blue is left after (...) metres of water (Beer and Lambert)."""
    loss = np.asarray(water.diffuse, np.float32)
    return np.exp(-np.asarray(path, np.float32)[..., None] * loss)


def veil(distance: Array, water: Water, separation: float) -> Array:
    """Return the (N, 3) light that comes back from the water in front of rock at (N,) metres.

    The sum over s from 0 to the distance of pi * scattering * BACK_SHARE * exp(-2 diffuse s) / (s^2 + separation^2),
    in units of a white wall's light that faces the lamp at 1 m: lamp and lens are taken to be equally far away.

    Args:
        distance: (N,) m; infinity gives the veiling light of open water.
        water: dims on both ways and scatters.
        separation: of lamp and lens, m.
    """
    nodes, weights = np.polynomial.legendre.leggauss(_NODES)
    # s = separation * tan(angle) takes the inverse square out of the integral.
    half = 0.5 * np.arctan2(distance, separation)
    along = separation * np.tan(half[:, None] * (nodes + 1.0))
    dimmed = np.exp(-2.0 * along[..., None] * np.asarray(water.diffuse))
    total = np.einsum("nkc,k->nc", dimmed, weights) * (half / separation)[:, None]
    light: Array = np.pi * water.scattering * BACK_SHARE * total
    return light


def veil_image(distance: Array, water: Water, separation: float) -> FloatImage:
    """Return `veil` for a whole photo, (..., 3), interpolated; NaN distances look into open water."""
    angles = np.linspace(0.0, np.arctan2(_OPEN_WATER, separation), _SAMPLES)
    table = veil(separation * np.tan(angles), water, separation)
    at = np.arctan2(np.nan_to_num(distance, nan=_OPEN_WATER), separation)
    channels = [np.interp(at, angles, table[:, channel]) for channel in range(3)]
    return np.stack(channels, axis=-1).astype(np.float32)


def blur_ahead(light: FloatImage, distance: Array, water: Water, focal_px: float) -> FloatImage:
    """Return an (H, W, 3) photo of which each pixel's share that was scattered ahead is spread over its neighbours.

    Args:
        light: (H, W, 3) as it would arrive sharply; nothing from open water.
        distance: (H, W) m, NaN in open water.
        water: scatters.
        focal_px: Focal length.
    """
    import cv2

    height, width = light.shape[:2]
    sharp = np.exp(-water.scattering * np.nan_to_num(distance, nan=_OPEN_WATER)).astype(np.float32)[..., None]
    # What is spread is smooth: a quarter of the size is plenty.
    strayed = cv2.resize((1.0 - sharp) * light, (max(1, width // 4), max(1, height // 4)), interpolation=cv2.INTER_AREA)
    strayed = cv2.GaussianBlur(strayed, (0, 0), focal_px * BLUR_ANGLE / 4)
    blurred: FloatImage = sharp * light + cv2.resize(strayed, (width, height), interpolation=cv2.INTER_LINEAR)
    return blurred
