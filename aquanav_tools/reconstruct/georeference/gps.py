"""Satellite positions in the photos' EXIF records."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.reconstruct.georeference.camera_positions import MIN_POSITIONS, CameraPositions
from aquanav_tools.reconstruct.georeference.wgs84 import enu_from_geodetic
from aquanav_tools.reconstruct.images import PhotoSet
from aquanav_tools.reconstruct.intake.decode import UnusableError, opened
from aquanav_tools.types import Array

GPS_IFD = 0x8825
LATITUDE_REF, LATITUDE, LONGITUDE_REF, LONGITUDE, ALTITUDE_REF, ALTITUDE = range(1, 7)
"""Tags of the GPS record (CIPA DC-008, Exif 2.32, section 4.6.6)."""
SPREAD = (1.0, 1.0, 2.0)
"""Receivers err about twice as much in height as sideways (chosen; GPS Performance Standard 2020: 1.6)."""
FAR_AWAY = 50_000.0
"""Farther from the middle one than this is another trip, m."""


def read_gps(photos: PhotoSet) -> CameraPositions:
    """Return the satellite positions of photos in metres about their middle; height only where all of them have it.

    Raises:
        InputError: too few photos have a position that can be one.
    """
    found = {name: fix for name in photos.names if (fix := _read_fix(photos.path(name))) is not None}
    usable = {name: fix for name, fix in found.items() if np.abs(fix[:2]).max() > 0.0}
    _check(len(photos.names), found, usable)
    fixes = np.array(list(usable.values()))
    has_height = bool(np.all(np.isfinite(fixes[:, 2])))
    fixes[:, 2] = fixes[:, 2] if has_height else 0.0
    metres = enu_from_geodetic(fixes, np.median(fixes, axis=0))
    near = np.linalg.norm(metres, axis=1) < FAR_AWAY
    positions = {name: place for name, place, is_near in zip(usable, metres, near, strict=True) if is_near}
    return CameraPositions("satellite positions", positions, SPREAD if has_height else (1.0, 1.0, np.inf))


def has_fix(path: Path) -> bool:
    """Return whether an image file has a satellite position that can be one; what cannot be read has none."""
    try:
        fix = _read_fix(path)
    except UnusableError:
        return False
    return fix is not None and bool(np.abs(fix[:2]).max() > 0.0)


def _check(num_photos: int, found: dict[str, Array], usable: dict[str, Array]) -> None:
    if len(usable) < MIN_POSITIONS:
        zeros = f"; {len(found) - len(usable)} more say 0, 0, which a receiver without a fix writes" if found else ""
        raise InputError(
            f"{len(usable)} of {num_photos} photos have a satellite position in their EXIF record{zeros}. There is no "
            "reception under ground or under water. Leave --gps out, and give a measured distance or markers."
        )
    if len({tuple(fix[:2]) for fix in usable.values()}) < MIN_POSITIONS:
        raise InputError(
            f"The {len(usable)} photos with a satellite position have the same few positions: the receiver repeated "
            "its last fix from before the entrance. Leave --gps out, and give a measured distance or markers."
        )


def _read_fix(path: Path) -> Array | None:
    """Return (3,) latitude, longitude in degrees and height in m (NaN without), or None without a readable position."""
    with opened(path) as image:
        record = image.getexif().get_ifd(GPS_IFD)
    if LATITUDE not in record or LONGITUDE not in record:
        return None
    try:
        latitude = _degrees(record[LATITUDE]) * (-1.0 if record.get(LATITUDE_REF) == "S" else 1.0)
        longitude = _degrees(record[LONGITUDE]) * (-1.0 if record.get(LONGITUDE_REF) == "W" else 1.0)
        height = float(record.get(ALTITUDE, np.nan))
    except (TypeError, ValueError, ZeroDivisionError):  # not degrees, minutes and seconds, or 0 / 0
        return None
    below_sea = record.get(ALTITUDE_REF, b"\0") in (b"\1", 1)
    fix = np.array([latitude, longitude, -height if below_sea else height])
    return fix if np.all(np.isfinite(fix[:2])) and abs(latitude) <= 90.0 else None


def _degrees(parts: Any) -> float:
    degrees, minutes, seconds = (float(part) for part in parts)
    return degrees + minutes / 60.0 + seconds / 3600.0
