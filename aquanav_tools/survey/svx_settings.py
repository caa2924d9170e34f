"""The commands of survey data files that change settings: each takes the settings and its words, and returns new ones.

A word that does not fit raises ValueError; the caller adds file and line.
"""

from __future__ import annotations

import math
from dataclasses import replace

from aquanav_tools.errors import did_you_mean
from aquanav_tools.survey.data_lines import number
from aquanav_tools.survey.settings import (
    ALIASES,
    ANGLE_UNITS,
    ANGLES,
    DEFAULT_UNITS,
    LENGTH_UNITS,
    LENGTHS,
    QUADRANT_UNITS,
    RATIO_UNITS,
    SPREADS,
    Calibration,
    Settings,
    Unit,
    canonical,
    find_unit,
)

_ALL_UNITS = [*LENGTH_UNITS, *ANGLE_UNITS, *RATIO_UNITS, *QUADRANT_UNITS]


def units(settings: Settings, words: list[str]) -> Settings:
    """*units <quantities> [<factor>] <unit>, or *units default."""
    if words[0].lower() == "default":
        return replace(settings, units=dict(DEFAULT_UNITS))
    quantities, rest = _quantities(words)
    factor = 1.0
    if len(rest) == 2:
        factor = number(rest[0])
        if factor == 0.0:
            raise ValueError("the factor must not be zero")
    return settings.with_units(quantities, _unit(quantities, rest[-1:], factor))


def calibrate(settings: Settings, words: list[str]) -> Settings:
    """*calibrate <quantities> <zero error> [<unit>] [<scale>], or *calibrate default."""
    if words[0].lower() == "default":
        return replace(settings, calibrations={})
    quantities, rest = _quantities(words)
    zero = number(rest[0])
    has_unit = len(rest) > 1 and rest[1].lower() in _ALL_UNITS
    scale = number(rest[1 + has_unit]) if len(rest) > 1 + has_unit else 1.0
    if "declination" in quantities and scale != 1.0:
        raise ValueError("a declination has no scale")
    if has_unit:
        offset = zero * _unit(quantities, rest[1:2], 1.0).factor
        is_angle_to_north = quantities == ["declination"]
        calibration = Calibration(offset) if is_angle_to_north else Calibration(0.0, scale, offset)
        return settings.with_calibration(quantities, calibration)
    for quantity in quantities:  # the zero error was read from the instrument, in its own units
        unit = settings.units[quantity]
        value = math.atan(zero * unit.factor) if unit.kind == "ratio" else zero * unit.factor
        settings = settings.with_calibration([quantity], Calibration(value, scale))
    return settings


def sd(settings: Settings, words: list[str]) -> Settings:
    """*sd <quantities> <standard deviation> <unit>."""
    quantities, rest = _quantities(words)
    if len(rest) != 2:
        raise ValueError("a standard deviation and its unit are needed, such as 0.05 metres")
    spread = number(rest[0])
    if spread < 0.0:
        raise ValueError("a standard deviation is not negative")
    return settings.with_sd(quantities, spread * _unit(quantities, rest[1:], 1.0).factor)


def declination(settings: Settings, words: list[str]) -> Settings:
    """*declination <angle> <unit>: what to add to a bearing."""
    if len(words) != 2:
        raise ValueError("an angle and its unit are needed, such as 4.5 degrees")
    angle = number(words[0]) * _unit(["declination"], words[1:], 1.0).factor
    return settings.with_calibration(["declination"], Calibration(-angle))


def case(settings: Settings, words: list[str]) -> Settings:
    """*case preserve|toupper|tolower."""
    known = ("preserve", "toupper", "tolower")
    if words[0].lower() not in known:
        raise ValueError(f"there is no '{words[0]}'.{did_you_mean(words[0].lower(), known)}")
    return replace(settings, case=words[0].lower())


def infer(settings: Settings, words: list[str]) -> Settings:
    """*infer plumbs|equates|exports on|off."""
    kind, state = words[0].lower(), words[1].lower()
    if kind not in ("plumbs", "equates", "exports") or state not in ("on", "off"):
        raise ValueError("plumbs, equates or exports, and on or off, are expected")
    if kind == "plumbs":
        return replace(settings, infers_plumbs=state == "on")
    if kind == "equates":
        return replace(settings, infers_equates=state == "on")
    return settings


def truncate(settings: Settings, words: list[str]) -> Settings:
    """*truncate <length>|off."""
    return replace(settings, significant=None if words[0].lower() == "off" else int(number(words[0])))


def _quantities(words: list[str]) -> tuple[list[str], list[str]]:
    """Return the quantities that a command starts with, and its other words."""
    quantities: list[str] = []
    while len(quantities) < len(words):
        name = canonical(words[len(quantities)])
        if name is None:
            break
        quantities.append(name)
    if not quantities:
        known = [*LENGTHS, *ANGLES, *SPREADS, *ALIASES]
        raise ValueError(f"there is no quantity '{words[0]}'.{did_you_mean(words[0].lower(), known)}")
    return quantities, words[len(quantities) :]


def _unit(quantities: list[str], words: list[str], factor: float) -> Unit:
    if not words:
        raise ValueError("the unit is missing")
    unit = find_unit(quantities, words[0], factor)
    if unit is None:
        raise ValueError(f"'{words[0]}' is no unit of {', '.join(quantities)}.{did_you_mean(words[0], _ALL_UNITS)}")
    return unit
