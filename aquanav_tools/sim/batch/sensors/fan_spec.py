"""A fan of range rays as data: where the rays point, how far they reach, how their distances err."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from aquanav_tools.sim.sensors import RayPattern, original_pattern

MAX_RAYS = 4096
"""Chosen; what has more rays is a sonar."""


@dataclass(frozen=True)
class RangeErrors:
    """How a range sensor's distances err. An echo errs alone: a ray that meets nothing reads its length."""

    constant: float = 0.0
    """Standard deviation of a distance, m."""
    proportional: float = 0.0
    """What that grows by with the distance, m/m."""
    dropout: float = 0.0
    """Probability that a ray gets no echo."""
    grazing_dropout: float = 0.0
    """Probability that an echo is lost along the wall; it grows evenly from `grazing_from_deg` to there."""
    grazing_from_deg: float = 60.0
    """Angle between ray and the wall's normal below which no echo is lost for its angle, degrees."""

    def __post_init__(self) -> None:
        for name, high in (("constant", 100.0), ("proportional", 1.0), ("dropout", 1.0), ("grazing_dropout", 1.0)):
            value = getattr(self, name)
            if not 0.0 <= value <= high:
                raise ValueError(f"A fan's noise has {name} = {value}, which must be from 0 to {high:g}.")
        if not 0.0 <= self.grazing_from_deg < 90.0:
            raise ValueError(
                f"A fan's noise has grazing_from_deg = {self.grazing_from_deg}, which must be from 0 to 90."
            )


@dataclass(frozen=True)
class FanSpec:
    """Rays from the vehicle's middle, body frame, given as directions or as angles."""

    lengths: tuple[float, ...]
    """One for each ray, or one for all, m."""
    directions: tuple[tuple[float, float, float], ...] = ()
    """One for each ray, of any length; or else:"""
    azimuths_deg: tuple[float, ...] = ()
    """From ahead towards left, one for each ray."""
    elevations_deg: tuple[float, ...] = (0.0,)
    """Up, one for each ray, or one for all."""
    radii: tuple[float, ...] = (0.0,)
    """Of spheres that are cast through the distance field in place of rays, one for each, or one for all, m; 0 casts
    a ray."""
    noise: RangeErrors = field(default_factory=RangeErrors)
    period: float = 0.0
    """Time between two readings, s, in whole decisions; the last one stands meanwhile. 0 reads at every decision."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.period <= 100.0:
            raise ValueError(f"A fan has the period {self.period} s, which must be from 0 to 100.")
        count = len(self.directions or self.azimuths_deg)
        if bool(self.directions) == bool(self.azimuths_deg):
            raise ValueError("A fan must have either directions or azimuths_deg.")
        if count > MAX_RAYS:
            raise ValueError(f"A fan has {count} rays; at most {MAX_RAYS} are possible.")
        self._check_counts(count)
        if not all(0.0 < length <= 1000.0 for length in self.lengths):
            raise ValueError("A fan's lengths must be above 0 and at most 1000 m.")
        if not all(0.0 <= radius <= 100.0 for radius in self.radii):
            raise ValueError("A fan's radii must be from 0 to 100 m.")
        if not np.isfinite(self.directions or self.azimuths_deg).all() or not np.isfinite(self.elevations_deg).all():
            raise ValueError("A fan's directions must be finite numbers.")
        if self.directions and np.linalg.norm(self.directions, axis=1).min() < 1e-6:
            raise ValueError("A fan's directions must not be zero.")

    def _check_counts(self, count: int) -> None:
        for name in ("lengths", "elevations_deg", "radii"):
            given = len(getattr(self, name))
            if given not in (1, count):
                raise ValueError(f"A fan of {count} rays has {given} {name}; it takes one, or one for each ray.")

    @property
    def pattern(self) -> RayPattern:
        """The rays as arrays."""
        if self.directions:
            directions = np.array(self.directions, dtype=np.float64)
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        else:
            azimuths = np.radians(self.azimuths_deg)
            elevations = np.broadcast_to(np.radians(self.elevations_deg), azimuths.shape)
            level = np.cos(elevations)
            directions = np.stack([level * np.cos(azimuths), level * np.sin(azimuths), np.sin(elevations)], axis=1)
        lengths, radii = (
            np.broadcast_to(np.array(each, dtype=np.float64), (len(directions),)).copy()
            for each in (self.lengths, self.radii)
        )
        return RayPattern(directions, lengths, radii)


def paper_fan(noise: RangeErrors | None = None) -> FanSpec:
    """Return the 28 rays of the presets "paper" and "full", which are the original benchmark's."""
    return replace(original_fan(), radii=(0.0,), noise=noise or RangeErrors())


def original_fan() -> FanSpec:
    """Return the 28 spheres of the preset "original"."""
    pattern = original_pattern()
    directions = tuple((float(x), float(y), float(z)) for x, y, z in pattern.directions)
    return FanSpec(tuple(pattern.lengths.tolist()), directions, radii=tuple(pattern.radii.tolist()))


def echo_sounders() -> FanSpec:
    """Return 16 narrow beams where the paper's 28 rays do not look: level, down, up and behind.

    Straight down is an altimeter, straight up what a vehicle under ice or rock carries. Distances err by the 0.5 % that
    makers of such sounders state (Blue Robotics, Ping2), and by 1 cm.
    """
    directions = [
        (math.cos(tilt) * math.cos(turn), math.cos(tilt) * math.sin(turn), math.sin(tilt))
        for turn, tilt in np.radians(_ECHO_SOUNDERS_DEG).tolist()
    ]
    return FanSpec((4.0,), tuple(directions), noise=RangeErrors(constant=0.01, proportional=0.005))


_ECHO_SOUNDERS_DEG = (
    *((turn, 0.0) for turn in (0.0, 22.5, -22.5, 90.0, -90.0, 135.0, -135.0, 180.0)),
    *(
        (turn, sign * tilt)
        for sign in (1.0, -1.0)
        for turn, tilt in ((0.0, 90.0), (0.0, 70.0), (180.0, 70.0), (180.0, 45.0))
    ),
)
"""Azimuths (left +) and elevations (up +)."""


def sonar_3d() -> FanSpec:
    """Return 117 beams ahead, of two 3D sonars with 90 by 40 degrees each, one tilted up by 20 degrees, one down.

    Of the 256 by 64 distances of such a sonar's image, five a second (Water Linked, Sonar 3D-15), every 7.5 degrees
    across and 10 up. The errors are those of the echo sounders: the maker states none.
    """
    angles = [(7.5 * across, 10.0 * up) for across in range(-6, 7) for up in range(-4, 5)]
    azimuths, elevations = zip(*angles, strict=True)
    errors = RangeErrors(constant=0.01, proportional=0.005)
    return FanSpec((4.0,), azimuths_deg=azimuths, elevations_deg=elevations, noise=errors, period=0.2)


def mapping() -> FanSpec:
    """Return 96 beams evenly all around, twice a second: what is kept of a mechanically scanned sonar's turn.

    Such a sonar reaches 50 m and more (Blue Robotics, Ping360); here it is 6 m. Distances err as the echo sounders'.
    """
    n = np.arange(96) + 0.5
    up, turn = 1.0 - 2.0 * n / 96, np.pi * (1.0 + 5.0**0.5) * n  # a golden spiral
    level = np.sqrt(1.0 - up**2)
    directions = np.stack([level * np.cos(turn), level * np.sin(turn), up], axis=1)
    errors = RangeErrors(constant=0.01, proportional=0.005)
    return FanSpec((6.0,), tuple(map(tuple, directions.tolist())), noise=errors, period=0.5)


PRESET_FANS = {
    "mapping": mapping(),
    "paper": paper_fan(),
    "full": paper_fan(),
    "original": original_fan(),
    "echosounders": echo_sounders(),
    "sonar3d": sonar_3d(),
}
"""What the presets of observations are built from, the echo sounders, and the 3D sonars."""
