"""What is in force while survey data is read: units, calibrations, standard deviations, flags and names.

Settings are values: a block (*begin to *end) keeps the old ones and puts them back.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

from aquanav_tools.survey.model import LegFlag

LENGTHS = ("tape", "backtape", "count", "depth", "dx", "dy", "dz", "left", "right", "up", "down")
ANGLES = ("compass", "backcompass", "clino", "backclino", "declination")
SPREADS = ("plumb", "level", "position")
"""Quantities that have a standard deviation but no reading."""
CLINOS = ("clino", "backclino")

ALIASES = {
    "length": "tape",
    "backlength": "backtape",
    "bearing": "compass",
    "backbearing": "backcompass",
    "gradient": "clino",
    "backgradient": "backclino",
    "counter": "count",
    "easting": "dx",
    "northing": "dy",
    "altitude": "dz",
    "ceiling": "up",
    "floor": "down",
}

LENGTH_UNITS = {"yards": 0.9144, "feet": 0.3048, "metric": 1.0, "metres": 1.0, "meters": 1.0}
_DEGREE = math.pi / 180.0
ANGLE_UNITS = {
    "degs": _DEGREE,
    "degrees": _DEGREE,
    "grads": math.pi / 200.0,
    "mils": math.pi / 200.0,  # Survex's meaning of a mil, deprecated by itself
    "minutes": _DEGREE / 60.0,
}
RATIO_UNITS = ("percent", "percentage")
QUADRANT_UNITS = ("quads", "quadrants")

DEFAULT_SD = {
    **dict.fromkeys(LENGTHS, 0.05),
    **dict.fromkeys(ANGLES, 0.5 * _DEGREE),
    "position": 0.05,
    "plumb": 0.25 * _DEGREE,
    "level": 0.25 * _DEGREE,
}
"""Survex's defaults, which are those of a survey of BCRA grade 5: 5 cm, half a degree; found by experiment to be what
`cavern` 1.4.4 uses."""


@dataclass(frozen=True)
class Calibration:
    """Turns a reading into a value: (reading - zero) * scale - offset."""

    zero: float = 0.0
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Unit:
    """What one unit of a reading is in metres or radians."""

    factor: float
    kind: str = "plain"
    """"plain", "ratio" (the tangent in percent) or "quadrants" (N34E)."""


DEFAULT_UNITS = {**dict.fromkeys(LENGTHS, Unit(1.0)), **dict.fromkeys(ANGLES, Unit(_DEGREE))}


@dataclass(frozen=True)
class Settings:
    """All that a data line's meaning depends on."""

    survey: tuple[str, ...] = ()
    """Names of the surveys that the current one is in, and its own."""
    units: Mapping[str, Unit] = field(default_factory=lambda: dict(DEFAULT_UNITS))
    calibrations: Mapping[str, Calibration] = field(default_factory=dict)
    sd: Mapping[str, float] = field(default_factory=lambda: dict(DEFAULT_SD))
    """Standard deviations, m or rad."""
    flags: LegFlag = LegFlag.NONE
    case: str = "tolower"
    significant: int | None = None
    """Length to which station names are cut; None for all of it."""
    is_dash_splay: bool = False
    """Whether the station name - stands for an anonymous point of the wall."""
    infers_plumbs: bool = False
    infers_equates: bool = False
    coordinate_system: str | None = None
    """The system that fixes are given in."""

    def with_units(self, quantities: list[str], unit: Unit) -> Settings:
        """Return these settings with the readings of some quantities in another unit."""
        return replace(self, units={**self.units, **dict.fromkeys(quantities, unit)})

    def with_calibration(self, quantities: list[str], calibration: Calibration) -> Settings:
        """Return these settings with another calibration of some quantities."""
        return replace(self, calibrations={**self.calibrations, **dict.fromkeys(quantities, calibration)})

    def with_sd(self, quantities: list[str], sd: float) -> Settings:
        """Return these settings with another standard deviation of some quantities, m or rad."""
        return replace(self, sd={**self.sd, **dict.fromkeys(quantities, sd)})

    @property
    def declination(self) -> float:
        """Angle to add to a bearing to refer it to true north, rad."""
        return -self.calibrations.get("declination", Calibration()).zero

    def value(self, quantity: str, reading: float) -> float:
        """Return a calibrated value, m or rad, of a reading in its current unit."""
        unit = self.units[quantity]
        raw = math.atan(reading * unit.factor) if unit.kind == "ratio" else reading * unit.factor
        calibration = self.calibrations.get(quantity, Calibration())
        return (raw - calibration.zero) * calibration.scale - calibration.offset


def canonical(name: str) -> str | None:
    """Return the one name of a quantity that data files call by several; None when there is no such quantity."""
    name = ALIASES.get(name.lower(), name.lower())
    return name if name in LENGTHS or name in ANGLES or name in SPREADS else None


def find_unit(quantities: list[str], name: str, factor: float = 1.0) -> Unit | None:
    """Return `factor` times the named unit; None when the quantities are not measured in it."""
    name = name.lower()
    if all(q in LENGTHS or q == "position" for q in quantities) and name in LENGTH_UNITS:
        return Unit(factor * LENGTH_UNITS[name])
    if not all(q in ANGLES or q in ("plumb", "level") for q in quantities):
        return None
    if name in ANGLE_UNITS:
        return Unit(factor * ANGLE_UNITS[name])
    if name in RATIO_UNITS and all(q in CLINOS for q in quantities):
        return Unit(factor / 100.0, "ratio")
    if name in QUADRANT_UNITS and not any(q in CLINOS for q in quantities):
        return Unit(_DEGREE, "quadrants")
    return None


_QUADRANT = re.compile(r"([NS])(?:([0-9.]+)([EW]))?$|([EW])$", re.IGNORECASE)


def quadrant_bearing(text: str) -> float | None:
    """Return the bearing in degrees of a quadrant such as S34E, N or E; None when it is none."""
    match = _QUADRANT.match(text)
    if match is None:
        return None
    if match[4]:
        return 90.0 if match[4].upper() == "E" else 270.0
    angle = float(match[2] or 0.0)
    if angle > 90.0:
        return None
    if match[1].upper() == "S":
        angle = 180.0 - angle
    return angle if (match[3] or "E").upper() == "E" else -angle % 360.0
