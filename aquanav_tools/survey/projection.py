"""Geographic coordinates onto the Universal Transverse Mercator grid, WGS84.

Formulas: Karney, Transverse Mercator with an accuracy of a few nanometers, Journal of Geodesy 85 (2011), the Krueger
series to the fourth order of the third flattening: well below a millimetre within a zone.
"""

from __future__ import annotations

import math
import re

import numpy as np

from aquanav_tools.types import Array

_RADIUS = 6_378_137.0
_FLATTENING = 1.0 / 298.257223563
_SCALE = 0.9996
_FALSE_EASTING = 500_000.0
_FALSE_NORTHING_SOUTH = 10_000_000.0
GEOGRAPHIC = {"long-lat", "epsg:4326"}
"""Systems whose coordinates are longitude, latitude in degrees on WGS84, in this order in survey files."""


def utm_zone(system: str) -> tuple[int, bool] | None:
    """Return (zone, is in the south) of a system such as UTM34N or EPSG:32634; None when it is no UTM zone on WGS84."""
    match = re.fullmatch(r"UTM(\d{1,2})([NS]?)", system, re.IGNORECASE)
    if match and 1 <= int(match[1]) <= 60:
        return int(match[1]), match[2].upper() == "S"
    match = re.fullmatch(r"EPSG:32([67])(\d\d)", system, re.IGNORECASE)
    if match and 1 <= int(match[2]) <= 60:
        return int(match[2]), match[1] == "7"
    return None


def to_system(position: Array, source: str, target: str) -> Array | None:
    """Return a (3,) position of one coordinate system in another, m; None when we cannot compute it."""
    zone = utm_zone(target)
    if source.lower() == target.lower() or (zone is not None and utm_zone(source) == zone):
        return position
    if zone is None or source.lower() not in GEOGRAPHIC:
        return None
    return np.array([*_utm(math.radians(position[0]), math.radians(position[1]), *zone), position[2]])


def _utm(longitude: float, latitude: float, zone: int, is_south: bool) -> tuple[float, float]:
    n = _FLATTENING / (2.0 - _FLATTENING)
    rectifying = _RADIUS / (1.0 + n) * (1.0 + n**2 / 4.0 + n**4 / 64.0)
    series = (
        n / 2.0 - 2.0 * n**2 / 3.0 + 5.0 * n**3 / 16.0 + 41.0 * n**4 / 180.0,
        13.0 * n**2 / 48.0 - 3.0 * n**3 / 5.0 + 557.0 * n**4 / 1440.0,
        61.0 * n**3 / 240.0 - 103.0 * n**4 / 140.0,
        49561.0 * n**4 / 161280.0,
    )
    east = longitude - math.radians(6.0 * zone - 183.0)
    eccentricity = math.sqrt(_FLATTENING * (2.0 - _FLATTENING))
    sine = math.sin(latitude)
    conformal = math.sinh(math.atanh(sine) - eccentricity * math.atanh(eccentricity * sine))
    xi0 = math.atan2(conformal, math.cos(east))
    eta0 = math.asinh(math.sin(east) / math.hypot(conformal, math.cos(east)))
    xi, eta = xi0, eta0
    for k, factor in enumerate(series, 1):
        xi += factor * math.sin(2 * k * xi0) * math.cosh(2 * k * eta0)
        eta += factor * math.cos(2 * k * xi0) * math.sinh(2 * k * eta0)
    northing = _SCALE * rectifying * xi + (_FALSE_NORTHING_SOUTH if is_south else 0.0)
    return _FALSE_EASTING + _SCALE * rectifying * eta, northing
