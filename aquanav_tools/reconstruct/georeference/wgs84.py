"""Latitude, longitude and height to metres east, north and up (WGS 84).

Source: NIMA TR8350.2, third edition (2000), ellipsoid parameters; closed forms as in Hofmann-Wellenhof et al., GNSS
(2008), section 8.2.
"""

from __future__ import annotations

import numpy as np

from aquanav_tools.types import Array

SEMI_MAJOR = 6_378_137.0
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY_2 = FLATTENING * (2.0 - FLATTENING)


def ecef_from_geodetic(geodetic: Array) -> Array:
    """Return (N, 3) earth-centred coordinates, m, of (N, 3) latitude, longitude (degrees) and height (m)."""
    latitude, longitude = np.deg2rad(geodetic[:, :2].T)
    height = geodetic[:, 2]
    normal = SEMI_MAJOR / np.sqrt(1.0 - ECCENTRICITY_2 * np.sin(latitude) ** 2)
    level = (normal + height) * np.cos(latitude)
    z = ((1.0 - ECCENTRICITY_2) * normal + height) * np.sin(latitude)
    return np.stack([level * np.cos(longitude), level * np.sin(longitude), z], axis=1)


def enu_from_geodetic(geodetic: Array, origin: Array) -> Array:
    """Return (N, 3) metres east, north and up of a tangent plane.

    Args:
        geodetic: (N, 3) latitude, longitude (degrees) and height above the ellipsoid (m).
        origin: (3,) likewise, where the plane touches.
    """
    latitude, longitude = np.deg2rad(origin[:2])
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude)
    enu_from_ecef = np.array(
        [
            [-sin_lon, cos_lon, 0.0],
            [-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat],
            [cos_lat * cos_lon, cos_lat * sin_lon, sin_lat],
        ]
    )
    enu: Array = (ecef_from_geodetic(geodetic) - ecef_from_geodetic(origin[None])) @ enu_from_ecef.T
    return enu
