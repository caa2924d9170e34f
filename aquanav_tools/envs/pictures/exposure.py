"""From light to a picture, as a camera that meters itself does: for the wall, and never all at once."""

from __future__ import annotations

import math

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.envs.pictures.bands import in_bands
from aquanav_tools.photograph.water import FloatImage

MIDDLE, MIDDLE_TONE = 60.0, 0.28
"""The meter brings this percentile of the picture to this exposure."""
BRIGHT, BRIGHT_TONE = 97.0, 1.5
"""Unless this percentile would exceed that one: the curve shows 1.5 as 78 % of the sensor's range."""
DARKEST = 1e-5
"""Light below which no gain lifts the picture."""
SETTLING = 0.35
"""The gain follows the meter as a first-order lag, s."""
EVERY = 4
"""The meter looks at each fourth pixel of each fourth row."""
STEPS = 2048
"""Of the curve's table, up to MAX_EXPOSURE."""
MAX_EXPOSURE = 8.0


class AutoExposure:
    """Chooses the gain from picture to picture."""

    def __init__(self) -> None:
        self._log_gain: float | None = None
        tones = (1.0 - np.exp(-np.linspace(0.0, MAX_EXPOSURE, STEPS))) ** (1.0 / 2.2)
        self._curve = np.round(255.0 * tones).astype(np.uint8)

    def reset(self) -> None:
        """Forget the pictures before."""
        self._log_gain = None

    def develop(self, light: FloatImage, seconds: float) -> npt.NDArray[np.uint8]:
        """Return the (H, W, 3) picture of (H, W, 3) light, some seconds after the picture before."""
        wanted = math.log(metered_gain(light))
        if self._log_gain is None:
            self._log_gain = wanted
        self._log_gain += (1.0 - math.exp(-seconds / SETTLING)) * (wanted - self._log_gain)
        picture, gain = np.empty(light.shape, np.uint8), math.exp(self._log_gain)
        in_bands(len(light), lambda first, end: _apply(light, gain, self._curve, picture, first, end))
        return picture


def metered_gain(light: FloatImage) -> float:
    """Return the gain that suits (H, W, 3) light: for its middle tones, and lower where its bright ones would burn."""
    some = _brightest(light)
    middle, bright = np.maximum(np.percentile(some, [MIDDLE, BRIGHT]), DARKEST)
    return float(min(MIDDLE_TONE / middle, BRIGHT_TONE / bright))


@numba.njit(cache=True)
def _brightest(light):  # type: ignore[no-untyped-def]
    """Return the brightest channel of the pixels that the meter looks at."""
    some = np.empty(((len(light) + EVERY - 1) // EVERY, (light.shape[1] + EVERY - 1) // EVERY), np.float32)
    for row in range(some.shape[0]):
        for column in range(some.shape[1]):
            pixel = light[EVERY * row, EVERY * column]
            some[row, column] = max(pixel[0], pixel[1], pixel[2])
    return some


@numba.njit(cache=True, nogil=True)
def _apply(light, gain, curve, picture, first, end):  # type: ignore[no-untyped-def]
    """Put the tones of rows from `first` to before `end` into a picture."""
    scale, last = np.float32(gain * (len(curve) - 1) / MAX_EXPOSURE), np.float32(len(curve) - 1)
    flat, shown = light[first:end].ravel(), picture[first:end].ravel()
    for n in range(len(flat)):
        shown[n] = curve[np.uint32(min(scale * flat[n] + np.float32(0.5), last))]
