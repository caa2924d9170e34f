"""What a camera wrote into its files: which camera, when, and with which focal length."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime
from typing import Any

from PIL import Image

FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
"""Diagonal of 35 mm film: equivalent focal lengths refer to it (CIPA DCG-001)."""
EXIF_IFD = 0x8769
MAKE_TAG = 0x010F
MODEL_TAG = 0x0110
ORIENTATION_TAG = 0x0112
TAKEN_TAG = 0x9003
SUBSECOND_TAG = 0x9291
FOCAL_LENGTH_TAG = 0x920A
PIXEL_WIDTH_TAG = 0xA002
FOCAL_PLANE_RESOLUTION_TAG = 0xA20E
FOCAL_PLANE_UNIT_TAG = 0xA210
FOCAL_LENGTH_35MM_TAG = 0xA405
_UNIT_MM = {2: 25.4, 3: 10.0, 4: 1.0}
"""Focal plane resolution is in pixels per inch, cm or mm (EXIF 2.32, tag 0xA210; 4 is in use beside it)."""
ACTION_CAMERAS = ("gopro", "insta360", "osmo action", "akaso", "yi action")
"""Makes and models whose usual, wide setting is a fisheye; EXIF does not tell whether it was on."""


@dataclass(frozen=True)
class Shot:
    """What the EXIF record of one photo says."""

    camera: str
    """Make and model; empty when unknown."""
    taken: datetime | None
    focal_px: float | None
    """Of the stored picture."""
    is_turned: bool
    """The stored picture lies on its side, on its head, or is mirrored."""


def read_shot(image: Image.Image) -> Shot:
    """Return what an image's EXIF record says; unreadable entries count as absent."""
    exif = image.getexif()
    details = exif.get_ifd(EXIF_IFD)
    names = [str(exif.get(tag, "")).strip("\0 ") for tag in (MAKE_TAG, MODEL_TAG)]
    camera = " ".join(name for name in names if name)
    return Shot(camera, _taken(details), _focal_px(image, details), exif.get(ORIENTATION_TAG, 1) not in (0, 1))


def is_action_camera(camera: str) -> bool:
    """Return whether a camera's usual setting is a fisheye."""
    return any(name in camera.lower() for name in ACTION_CAMERAS)


def _taken(details: dict[int, Any]) -> datetime | None:
    fraction = "".join(filter(str.isdigit, str(details.get(SUBSECOND_TAG, ""))))[:6]
    try:
        return datetime.strptime(f"{details.get(TAKEN_TAG)}.{fraction or 0}", "%Y:%m:%d %H:%M:%S.%f")
    except ValueError:  # absent, or a camera whose clock was never set
        return None


def _focal_px(image: Image.Image, details: dict[int, Any]) -> float | None:
    """Return the focal length from its equivalent on 35 mm film, else from that in mm and the pixels' size."""
    equivalent_mm = _positive(details.get(FOCAL_LENGTH_35MM_TAG))
    if equivalent_mm:
        return equivalent_mm * math.hypot(*image.size) / FILM_DIAGONAL_MM
    focal_mm, per_unit = _positive(details.get(FOCAL_LENGTH_TAG)), _positive(details.get(FOCAL_PLANE_RESOLUTION_TAG))
    unit_mm = _UNIT_MM.get(details.get(FOCAL_PLANE_UNIT_TAG, 2))
    if not focal_mm or not per_unit or not unit_mm:
        return None
    # The resolution is that of the sensor; a photo that was made smaller later has fewer pixels.
    shrink = image.size[0] / (_positive(details.get(PIXEL_WIDTH_TAG)) or image.size[0])
    return focal_mm * per_unit / unit_mm * min(shrink, 1.0)


def _positive(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if math.isfinite(number) and number > 0.0 else None
