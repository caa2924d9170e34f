"""What a photographed dive is made of: water, lamp, rock, camera and the way it is carried. Plain values, no NumPy."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

LensName = Literal["pinhole", "fisheye"]
PathName = Literal["stations", "forward", "sweep", "loop", "passes"]

FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
"""Diagonal of 35 mm film: equivalent focal lengths refer to it (CIPA DCG-001)."""
DISTORTION: dict[LensName, tuple[float, ...]] = {"pinhole": (), "fisheye": (0.04, 0.01, -0.006, 0.001)}
"""Coefficients of OPENCV_FISHEYE: radius over focal length = t + k1 t^3 + k2 t^5 + k3 t^7 + k4 t^9 at the angle t off
the axis. Chosen: an action camera departs that little from equidistant, and the radius grows up to 90 degrees."""
DEFAULT_FOCAL_35MM: dict[LensName, int] = {"pinhole": 16, "fisheye": 15}
"""95 degrees across in a 4:3 photo, and 125 (action cameras claim about 123)."""
SHOTS = ((55.0, 0.0), (-55.0, 0.0), (0.0, 50.0), (125.0, 0.0), (-125.0, 0.0))
"""Yaw (positive to the left of the passage) and pitch (positive up) of a station's shots, degrees. With a wide lens and
a station per metre two stations or more see 88 % of the demo cave's wall; looking ahead only leaves 40 % in the shadow
of its bulges (measured by casting rays)."""


@dataclass(frozen=True)
class Water:
    """How water dims, blurs and veils."""

    name: str
    diffuse: tuple[float, float, float]
    """Share of light lost per metre for red, green and blue (600, 525 and 450 nm), 1/m."""
    scattering: float
    """Share of light thrown off its way per metre, nearly all of it ahead, 1/m."""

    def __post_init__(self) -> None:
        if min(*self.diffuse, self.scattering) < 0:
            raise ValueError(f"Water takes light and never gives any: {self} has a negative coefficient.")


JERLOV = {
    water.name: water
    for water in (
        Water("I", (0.235, 0.043, 0.019), 0.01),
        Water("IB", (0.245, 0.054, 0.036), 0.04),
        Water("III", (0.295, 0.116, 0.135), 0.22),
        Water("1C", (0.300, 0.130, 0.250), 0.30),
        Water("3C", (0.330, 0.200, 0.390), 0.55),
        Water("5C", (0.400, 0.310, 0.560), 1.00),
    )
}
"""Named waters. Diffuse attenuation: Jerlov, Marine Optics (1976), table XXVII. Scattering: between Petzold's clear
ocean (0.037), coast (0.219) and harbour (1.824 1/m; Mobley, Light and Water, 1994, table 3.10), placed by the diffuse
attenuation of green; types 1C to 5C lie between coast and harbour. Type I scatters as little as a spring in which
one sees 90 m: 4.8 over the beam attenuation of green, here the sum of both coefficients (Zaneveld and Pegau, 2003)."""


@dataclass(frozen=True)
class Lamp:
    """A lamp that is carried with the camera."""

    right: float = 0.12
    """Place right of the lens, m."""
    up: float = 0.12
    """Place above the lens, m."""
    power: float = 1.0
    """Relative to the demo's lamp."""

    def __post_init__(self) -> None:
        if self.power <= 0 or self.separation < 0.01:
            raise ValueError(f"A lamp needs power and a place beside the lens, 0.01 m or more: {self}.")

    @property
    def separation(self) -> float:
        """Distance from the lens, m."""
        return math.hypot(self.right, self.up)


@dataclass(frozen=True)
class CameraOptions:
    """Lens, sensor and files."""

    lens: LensName = "pinhole"
    width: int = 960
    """px."""
    height: int = 720
    """px."""
    focal_35mm: int = 0
    """Focal length, as on 35 mm film, mm; 0 takes the lens' own (DEFAULT_FOCAL_35MM)."""
    exposure_s: float = 0.004
    """How long the shutter is open, s: more light, and more motion blur."""
    exposure_spread_ev: float = 0.0
    """Standard deviation of the meter's mistakes, stops."""
    noise: float = 1.0
    """Sensor noise, relative to a small camera's."""
    max_gain: float = 40.0
    """Largest gain of the sensor; what it cannot lift stays dark. Most of the demo's photos take 5 to 20."""
    quality: int = 92
    """Of the JPEG files, 1 to 95."""
    first_number: int | None = None
    """Number of the first photo, IMG_9990.JPG for 9990; the counter starts again at 1 after 9999. None: dive_1.jpg."""

    def __post_init__(self) -> None:
        if min(self.width, self.height) < 64 or self.focal_35mm < 0:
            raise ValueError(f"CameraOptions needs a size of 64 px or more and no negative focal length: {self}.")
        if min(self.exposure_s, self.max_gain) <= 0 or min(self.exposure_spread_ev, self.noise) < 0:
            raise ValueError(f"CameraOptions needs an exposure, a gain and no negative spread or noise: {self}.")
        if not 1 <= self.quality <= 95:
            raise ValueError(f"quality = {self.quality} is not from 1 to 95.")
        if self.first_number is not None and not 1 <= self.first_number <= 9999:
            raise ValueError(f"first_number = {self.first_number} is not from 1 to 9999.")

    @property
    def equivalent_mm(self) -> int:
        """Focal length, as on 35 mm film, mm."""
        return self.focal_35mm or DEFAULT_FOCAL_35MM[self.lens]

    @property
    def focal_px(self) -> float:
        """Focal length in pixels."""
        return self.equivalent_mm * math.hypot(self.width, self.height) / FILM_DIAGONAL_MM


@dataclass(frozen=True)
class CaptureOptions:
    """How the camera goes through the cave.

    stations: stops along the passage, `shots` at each. forward: swims and looks ahead. sweep: swims and pans. loop:
    out along one wall, back along the other, to the first view. passes: three dives, looking left, right and up.
    """

    path: PathName = "stations"
    photos: int = 65
    seed: int = 0
    """Picks the unsteadiness of the diver's hands."""
    shots: tuple[tuple[float, float], ...] = SHOTS
    """Yaw and pitch of the photos at each station, from the passage's direction, degrees."""
    start_margin: float = 0.4
    """Distance of the path's start from the opening the diver comes in by, m."""
    end_margin: float = 0.4
    """Distance of its end from the other opening, m."""
    unsteady_m: float = 0.06
    """Standard deviation of the camera's place about the path, m."""
    unsteady_deg: float = 3.0
    """Standard deviation of the camera's direction, degrees."""
    speed: float = 0.2
    """Of swimming, m/s."""
    turn_rate_deg: float = 20.0
    """Of panning, degrees/s."""

    def __post_init__(self) -> None:
        sizes = (self.start_margin, self.end_margin, self.unsteady_m, self.unsteady_deg)
        if not 3 <= self.photos <= 9999:
            raise ValueError(f"photos = {self.photos} is not from 3 to 9999.")
        if min(sizes) < 0 or not self.shots:
            raise ValueError(f"CaptureOptions needs shots and nothing negative, got {self}.")
        if min(self.speed, self.turn_rate_deg) <= 0:
            raise ValueError(f"CaptureOptions needs a speed and a turn rate above 0, got {self}.")


@dataclass(frozen=True)
class DiveOptions:
    """A whole photographed dive."""

    camera: CameraOptions = field(default_factory=CameraOptions)
    lamp: Lamp = field(default_factory=Lamp)
    water: Water = JERLOV["I"]
    texture: float = 1.0
    """Contrast of the rock: 1 is bedded, pitted limestone, 0 a bare wall under mud."""
    capture: CaptureOptions = field(default_factory=CaptureOptions)
    seed: int = 0
    """Picks texture and noise."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.texture <= 1.0:
            raise ValueError(f"texture = {self.texture} is not from 0 to 1.")
