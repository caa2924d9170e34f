"""A forward imaging sonar as data."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from aquanav_tools.sim.batch.sensors.data_sheets import check_range
from aquanav_tools.types import Array

REACH = 1.0
"""How far sub-rays go beside a beam's axis, in half-power widths: there its pattern is at -12 dB, both ways at -24."""


@dataclass(frozen=True)
class SonarSheet:
    """A forward imaging sonar: a fan of beams, narrow in azimuth and wide in elevation."""

    num_beams: int = 256
    num_bins: int = 256
    """Of the range."""
    horizontal_aperture_deg: float = 130.0
    """Between the first beam, on the right, and the last."""
    vertical_aperture_deg: float = 20.0
    """Half-power width of the beams in elevation, one way."""
    min_range: float = 0.2
    """m."""
    max_range: float = 20.0
    """m."""
    tilt_deg: float = 0.0
    """By which the fan points down."""
    num_sub_rays: int = 32
    """In each beam, over its elevation."""
    absorption_db_per_m: float = 0.2
    """One way; 750 kHz, in the sea. Fresh water takes about half."""
    tvg: bool = True
    """Time-varied gain: makes up for what range and water take."""
    speckle: bool = True
    """Whether echoes of a rough wall interfere: each bin's intensity is then multiplied by an exponential variate."""
    noise_db: float = -60.0
    """Mean of the noise in each bin before the gain, dB below the echo of the reference; -inf for none."""
    dynamic_range_db: float = 60.0
    """Bins are 0 at this much below the reference, and 1 at it; 0 for intensities as they are, which have no bound."""
    product: str = ""
    source: str = ""

    def __post_init__(self) -> None:
        for name, low, high in (("num_beams", 1, 4096), ("num_bins", 1, 4096), ("num_sub_rays", 1, 1024)):
            check_range("sonar", name, getattr(self, name), low, high)
        check_range("sonar", "horizontal_aperture_deg", self.horizontal_aperture_deg, 0.0, 360.0)
        check_range("sonar", "vertical_aperture_deg", self.vertical_aperture_deg, 0.1, 80.0)
        check_range("sonar", "max_range", self.max_range, 0.1, 1000.0)
        if not 0.0 <= self.min_range < self.max_range:
            raise ValueError(f"The sonar has min_range = {self.min_range}, which must be from 0 to below max_range.")
        check_range("sonar", "tilt_deg", self.tilt_deg, -90.0, 90.0)
        check_range("sonar", "absorption_db_per_m", self.absorption_db_per_m, 0.0, 10.0)
        check_range("sonar", "noise_db", self.noise_db, -np.inf, 0.0)
        check_range("sonar", "dynamic_range_db", self.dynamic_range_db, 0.0, 200.0)

    @property
    def bin_size(self) -> float:
        """M."""
        return (self.max_range - self.min_range) / self.num_bins

    @property
    def azimuths(self) -> Array:
        """(beams,) from ahead towards left, rad."""
        half = 0.5 * np.radians(self.horizontal_aperture_deg)
        return np.linspace(-half, half, self.num_beams) if self.num_beams > 1 else np.zeros(1)

    @property
    def elevations(self) -> Array:
        """(sub-rays,) from a beam's axis upwards, the middles of equal parts, rad."""
        reach = REACH * np.radians(self.vertical_aperture_deg)
        return reach * ((np.arange(self.num_sub_rays) + 0.5) / self.num_sub_rays * 2.0 - 1.0)

    @property
    def weights(self) -> Array:
        """(sub-rays,) share of a beam's power, both ways: a Gaussian pattern, adds up to 1."""
        away = self.elevations / (0.5 * np.radians(self.vertical_aperture_deg))
        both_ways = 0.25 ** (away**2)
        return both_ways / both_ways.sum()

    def directions(self) -> tuple[Array, Array]:
        """Return (beams, sub-rays, 3) unit vectors, body frame, and how they change with the elevation, per radian."""
        azimuth, elevation = self.azimuths[:, None], self.elevations[None, :]
        cos_a, sin_a, cos_e, sin_e = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
        level = np.zeros_like(cos_a)
        directions = np.stack([cos_e * cos_a, cos_e * sin_a, sin_e + level], axis=-1)
        changes = np.stack([-sin_e * cos_a, -sin_e * sin_a, cos_e + level], axis=-1)
        tilt = np.radians(self.tilt_deg)
        body_from_sonar = np.array([[np.cos(tilt), 0, np.sin(tilt)], [0, 1, 0], [-np.sin(tilt), 0, np.cos(tilt)]])
        return directions @ body_from_sonar.T, changes @ body_from_sonar.T
