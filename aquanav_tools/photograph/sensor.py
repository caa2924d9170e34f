"""From light on the sensor to a photo: motion blur, vignetting, exposure, noise, gamma."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from aquanav_tools.photograph.lens import Lens
from aquanav_tools.photograph.options import CameraOptions
from aquanav_tools.photograph.trajectory import Shot
from aquanav_tools.photograph.water import FloatImage
from aquanav_tools.types import Array

MIDDLE_TONE = 0.2
"""What the meter brings the METERED-th percentile of the photo to, of the sensor's range."""
METERED = 65
REFERENCE_GAIN = 16.0
"""At which noise is stated; most of the demo's photos take 5 to 20."""
READ_NOISE = 1e-5
"""Variance at the reference gain, of the sensor's range squared."""
SHOT_NOISE = 2e-4
"""Variance per light at the reference gain."""
REFERENCE_EXPOSURE = 0.004
"""Exposure at which light counts as it is, s."""
CORNER_LOSS = 0.4
"""Share of the light that the lens loses in the photo's corners."""
_FAR = 50.0
"""Where the water moves that no rock is seen through, m: only turning shifts it."""
_MAX_TAPS = 48


def image_motion(lens: Lens, shot: Shot, points: Array, seconds: float) -> Array:
    """Return the (N, 2) way that each of (N, 3) still points in the camera's frame goes in the photo, px.

    Dp/dt = -(velocity in the camera's frame) - spin x p; the ends of the way lie half of `seconds` before and after.
    """
    half = 0.5 * seconds * (shot.cam_from_world @ shot.velocity + np.cross(shot.spin, points))
    way: Array = lens.project(points - half) - lens.project(points + half)
    return way


def blur_by_motion(light: FloatImage, motion: Array) -> FloatImage:
    """Return an (H, W, 3) photo of which every pixel is the mean of the photo along its (H, W, 2) way, px."""
    import cv2

    longest = float(np.percentile(np.hypot(motion[..., 0], motion[..., 1]), 99))
    if longest < 0.1:
        return light
    taps = min(_MAX_TAPS, math.ceil(longest) + 1)
    height, width = light.shape[:2]
    across, down = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    way = motion.astype(np.float32)
    total = np.zeros_like(light)
    for tap in range(taps):
        share = np.float32((tap + 0.5) / taps - 0.5)
        x, y = across + share * way[..., 0], down + share * way[..., 1]
        total += cv2.remap(light, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return total / np.float32(taps)


def moving_points(rays: Array, distance: Array) -> Array:
    """Return the (N, 3) points that (N, 3) rays meet after (N,) metres; far away where that is NaN."""
    points: Array = rays * np.nan_to_num(distance, nan=_FAR)[:, None]
    return points


def vignette(lens: Lens) -> FloatImage:
    """Return (H, W, 1) how much of the light passes the lens: less towards the corners."""
    x, y = np.meshgrid(np.linspace(-1, 1, lens.width), np.linspace(-1, 1, lens.height))
    return (1.0 - 0.5 * CORNER_LOSS * (x * x + y * y))[..., None].astype(np.float32)


def develop(light: FloatImage, options: CameraOptions, rng: np.random.Generator) -> npt.NDArray[np.uint8]:
    """Return the (H, W, 3) photo: exposed for the middle tones as far as the gain allows, with noise, gamma 2.2.

    Noise is of photons (its variance grows with the light) and of reading them out; the gain lifts both.
    """
    caught = light * np.float32(options.exposure_s / REFERENCE_EXPOSURE)
    mistake = 2.0 ** (options.exposure_spread_ev * rng.standard_normal())
    gain = min(MIDDLE_TONE * mistake / float(np.percentile(caught, METERED)), options.max_gain)
    exposed = gain * caught
    exposed /= 1.0 + 0.4 * exposed  # highlights roll off
    relative = gain / REFERENCE_GAIN
    variance = READ_NOISE * relative * relative + SHOT_NOISE * relative * exposed
    exposed += options.noise * np.sqrt(variance) * rng.standard_normal(exposed.shape, dtype=np.float32)
    developed = np.clip(exposed, 0.0, 1.0) ** (1.0 / 2.2)
    return (255.0 * developed + 0.5).astype(np.uint8)
