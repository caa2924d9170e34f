"""Lines of survey data: which reading stands where, lines shared between legs, and what they add to the field book."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from aquanav_tools.survey.fieldbook import FieldBook, Measurement
from aquanav_tools.survey.leg_vectors import (
    Estimate,
    cartesian_leg,
    depth_leg,
    plumb_leg,
    sloping_leg,
    unsloped_leg,
)
from aquanav_tools.survey.model import LegFlag
from aquanav_tools.survey.settings import ALIASES, Settings, quadrant_bearing
from aquanav_tools.types import Array

_LEG_FIELDS = {"from", "to", "station", "direction", "newline", "ignore", "ignoreall"}
_TAPES = {"tape", "backtape", "fromcount", "tocount", "count"}
_COMPASSES = {"compass", "backcompass"}
_CLINOS = {"clino", "backclino"}
_DEPTHS = {"fromdepth", "todepth", "depth", "depthchange"}
STYLES = {
    "normal": _LEG_FIELDS | _TAPES | _COMPASSES | _CLINOS,
    "diving": _LEG_FIELDS | _TAPES | _COMPASSES | _CLINOS | _DEPTHS,
    "cylpolar": _LEG_FIELDS | _TAPES | _COMPASSES | _DEPTHS,
    "cartesian": _LEG_FIELDS | {"dx", "dy", "dz"},
    "nosurvey": _LEG_FIELDS,
    "passage": {"station", "left", "right", "up", "down", "ignore", "ignoreall"},
}
"""The readings that each style of data may have."""
STYLE_ALIASES = {"default": "normal", "topofil": "normal", "dimensions": "passage"}
DEFAULT_ORDER = ("from", "to", "tape", "compass", "clino")
FIELD_ALIASES = {**ALIASES, "fromcounter": "fromcount", "tocounter": "tocount"}

PLUMBS = {"up": 1.0, "u": 1.0, "+v": 1.0, "down": -1.0, "d": -1.0, "-v": -1.0}
LEVELS = {"level", "h"}
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)$")
_OMITTED = {"-"}
MAX_READING = 1e9
"""Larger than any coordinate on Earth in millimetres would be; keeps squares and sums finite."""

Resolver = Callable[[str], int]
"""Turns a station's name, as a data line has it, into its index in the field book."""


@dataclass(frozen=True)
class Layout:
    """A style of data and the readings on its lines."""

    style: str = "normal"
    lines: tuple[tuple[str, ...], ...] = (DEFAULT_ORDER,)
    """Fields of each line of a record; two lines where data is interleaved."""

    @property
    def is_interleaved(self) -> bool:
        """Whether lines of stations alternate with lines of readings."""
        return len(self.lines) == 2 and ("station" in self.lines[0]) != ("station" in self.lines[1])

    @property
    def is_chain(self) -> bool:
        """Whether each line is a station, tied to the one before."""
        return len(self.lines) == 1 and "station" in self.lines[0]


def parse_layout(words: list[str]) -> Layout:
    """Return the layout that a data command's words ask for.

    Raises:
        KeyError: a word is unknown in this style; it is the argument.
        ValueError: fields are missing.
    """
    style = STYLE_ALIASES.get(words[0].lower(), words[0].lower())
    if words[0].lower() == "default":
        return Layout()
    if style not in STYLES:
        raise KeyError(words[0])
    fields = [FIELD_ALIASES.get(word.lower(), word.lower()) for word in words[1:]]
    for name, word in zip(fields, words[1:], strict=True):
        if name not in STYLES[style]:
            raise KeyError(word)
    lines: list[list[str]] = [[]]
    for name in fields:
        if name == "newline":
            lines.append([])
        else:
            lines[-1].append(name)
    if "station" not in fields and not {"from", "to"} <= set(fields):
        raise ValueError("neither 'station' nor 'from' and 'to' are among the fields")
    if style == "cartesian" and not {"dx", "dy", "dz"} <= set(fields):
        raise ValueError("easting, northing and altitude must be among the fields")
    return Layout(style, tuple(tuple(line) for line in lines))


@dataclass(eq=False)
class DataLines:
    """Reads data lines in one layout, one after the other."""

    layout: Layout
    book: FieldBook
    _record: dict[str, str] = field(default_factory=dict)
    _line: int = 0
    _last: dict[str, str] = field(default_factory=dict)
    """The station line before, of interleaved data."""
    _last_index: int | None = None

    def blank(self) -> None:
        """Take note of an empty line: it ends a traverse of interleaved data."""
        if self.layout.is_interleaved:
            self._record, self._last, self._last_index, self._line = {}, {}, None, 0

    def read(self, words: list[str], settings: Settings, resolve: Resolver, where: str) -> None:
        """Take one line.

        Raises:
            ValueError: it does not fit the layout; the message says how.
        """
        fields = self.layout.lines[self._line]
        values = _assign(fields, words)
        if self.layout.style == "passage":
            self._passage(values, settings, resolve)
        elif self.layout.is_chain:
            self._chain(values, settings, resolve, where)
        elif self.layout.is_interleaved:
            self._interleaved(values, settings, resolve, where)
        else:
            self._record.update(values)
            self._line = (self._line + 1) % len(self.layout.lines)
            if self._line == 0:
                record, self._record = self._record, {}
                self._leg(resolve(record["from"]), resolve(record["to"]), record, settings, where)

    def _passage(self, values: dict[str, str], settings: Settings, resolve: Resolver) -> None:
        if self._last_index is None:
            self.book.passages.append([])
        self._last_index = resolve(values["station"])
        sides = [
            math.nan if values.get(side, "-") in _OMITTED else settings.value(side, number(values[side]))
            for side in ("left", "right", "up", "down")
        ]
        self.book.passages[-1].append((self._last_index, np.array(sides)))

    def _chain(self, values: dict[str, str], settings: Settings, resolve: Resolver, where: str) -> None:
        station = resolve(values["station"])
        if self._last_index is not None:
            self._leg(self._last_index, station, values, settings, where)
        self._last_index = station

    def _interleaved(self, values: dict[str, str], settings: Settings, resolve: Resolver, where: str) -> None:
        self._line = 1 - self._line
        if "station" not in values:
            self._record = values
            return
        station = resolve(values["station"])
        if self._last_index is not None and self._record:
            ends = {f"from{name}": value for name, value in self._last.items()}
            ends |= {f"to{name}": value for name, value in values.items()}
            self._leg(self._last_index, station, {**self._record, **ends}, settings, where)
        self._record, self._last, self._last_index = {}, values, station

    def _leg(self, start: int, end: int, values: dict[str, str], settings: Settings, where: str) -> None:
        if values.get("direction", "F").upper() == "B":
            start, end = end, start
            # The counter runs on whichever way the leg was sighted; depths belong to their stations.
            swapped = {"fromdepth": "todepth", "todepth": "fromdepth"}
            values = {swapped.get(key, key): value for key, value in values.items()}
        if start == end:
            self.book.warnings.append(f"{where}: a leg from '{self.book.names[start]}' to itself was left out.")
            return
        flags = settings.flags | (LegFlag.NOSURVEY if self.layout.style == "nosurvey" else LegFlag.NONE)
        if start in self.book.splay_ends or end in self.book.splay_ends:
            flags |= LegFlag.SPLAY
        if self.layout.style == "nosurvey":
            self.book.measure(Measurement(start, end, np.zeros(3), None, flags, None, where))
            return
        vector, covariance, length = _VECTORS[self.layout.style](values, settings)
        if length == 0.0 and settings.infers_equates:
            self.book.equates.append((start, end))
            return
        self.book.measure(Measurement(start, end, vector, covariance, flags, length, where))


def number(text: str) -> float:
    """Return a reading.

    Raises:
        ValueError: it is no plain number.
    """
    if not _NUMBER.match(text):
        raise ValueError(f"'{text}' is no number")
    value = float(text)
    if abs(value) > MAX_READING:
        raise ValueError(f"'{text[:20]}' is larger than anything that is measured in a cave ({MAX_READING:.0e})")
    return value


def _assign(fields: tuple[str, ...], words: list[str]) -> dict[str, str]:
    values: dict[str, str] = {}
    for place, name in enumerate(fields):
        if name == "ignoreall":
            return values
        if place >= len(words):
            raise ValueError(f"the line has {len(words)} fields and lacks '{name}' ({' '.join(fields)})")
        if name != "ignore":
            values[name] = words[place]
    if len(words) > len(fields):
        raise ValueError(f"the line has {len(words)} fields, {len(fields)} are expected ({' '.join(fields)})")
    return values


def _normal(values: dict[str, str], settings: Settings) -> tuple[Array, Array, float]:
    tape = _tape(values, settings)
    direction = _plumb_direction(values, settings)
    if direction is not None:
        return *plumb_leg(tape, direction, settings.sd), tape.value
    bearing = _bearing(values, settings)
    slope = _slope(values, settings)
    if slope is None:
        return *unsloped_leg(tape, bearing, settings.sd), tape.value
    return *sloping_leg(tape, bearing, slope, settings.sd), tape.value


def _diving(values: dict[str, str], settings: Settings) -> tuple[Array, Array, float]:
    tape, rise = _tape(values, settings), _rise(values, settings)
    bearing = _bearing(values, settings) if tape.value > abs(rise.value) else Estimate(0.0, 0.0)
    return *depth_leg(tape, bearing, rise, settings.sd, is_tape_level=False), tape.value


def _cylpolar(values: dict[str, str], settings: Settings) -> tuple[Array, Array, float]:
    tape, rise = _tape(values, settings), _rise(values, settings)
    bearing = _bearing(values, settings) if tape.value else Estimate(0.0, 0.0)
    vector, covariance = depth_leg(tape, bearing, rise, settings.sd, is_tape_level=True)
    return vector, covariance, float(np.linalg.norm(vector))


def _cartesian(values: dict[str, str], settings: Settings) -> tuple[Array, Array, float]:
    vector = np.array([settings.value(axis, number(values[axis])) for axis in ("dx", "dy", "dz")])
    return *cartesian_leg(vector, settings.sd), float(np.linalg.norm(vector))


_VECTORS = {"normal": _normal, "diving": _diving, "cylpolar": _cylpolar, "cartesian": _cartesian}


def _tape(values: dict[str, str], settings: Settings) -> Estimate:
    readings = []
    for name in ("tape", "backtape"):
        if values.get(name, "-") not in _OMITTED:
            readings.append(Estimate(settings.value(name, number(values[name])), settings.sd[name] ** 2))
    if "fromcount" in values and "tocount" in values:
        spread = 2.0 * settings.sd["count"] ** 2
        turned = settings.value("count", number(values["tocount"])) - settings.value(
            "count", number(values["fromcount"])
        )
        readings.append(Estimate(turned, spread))
    if not readings:
        raise ValueError("the leg has no length")
    return readings[0] if len(readings) == 1 else readings[0].merged(readings[1])


def _plumb_direction(values: dict[str, str], settings: Settings) -> float | None:
    """Return 1 for a leg straight up, -1 for straight down, None for any other."""
    for name, sign in (("clino", 1.0), ("backclino", -1.0)):
        text = values.get(name, "-").lower()
        if text in PLUMBS:
            return sign * PLUMBS[text]
        if settings.infers_plumbs and _NUMBER.match(text):
            angle = number(text) * settings.units[name].factor
            if settings.units[name].kind == "plain" and math.isclose(abs(angle), math.pi / 2, abs_tol=1e-9):
                return math.copysign(sign, sign * angle)
    return None


def _bearing(values: dict[str, str], settings: Settings) -> Estimate:
    """Return the bearing from true north, from both ends where both were read."""
    readings = []
    for name, turn in (("compass", 0.0), ("backcompass", math.pi)):
        if values.get(name, "-") not in _OMITTED:
            angle = settings.value(name, _compass_number(values[name], settings, name)) + turn + settings.declination
            readings.append(Estimate(angle, settings.sd[name] ** 2))
    if not readings:
        raise ValueError("the leg has no bearing")
    if len(readings) == 1:
        return readings[0]
    fore, back = readings
    nearest = fore.value + math.remainder(back.value - fore.value, 2.0 * math.pi)
    return fore.merged(Estimate(nearest, back.variance))


def _compass_number(text: str, settings: Settings, name: str) -> float:
    if settings.units[name].kind != "quadrants":
        return number(text)
    bearing = quadrant_bearing(text)
    if bearing is None:
        raise ValueError(f"'{text}' is no bearing in quadrants such as S34E")
    return bearing


def _slope(values: dict[str, str], settings: Settings) -> Estimate | None:
    readings = []
    for name, sign in (("clino", 1.0), ("backclino", -1.0)):
        text = values.get(name, "-").lower()
        if text in LEVELS:
            return Estimate(0.0, settings.sd["level"] ** 2)
        if text not in _OMITTED:
            readings.append(Estimate(sign * settings.value(name, number(text)), settings.sd[name] ** 2))
    if not readings:
        return None
    return readings[0] if len(readings) == 1 else readings[0].merged(readings[1])


def _rise(values: dict[str, str], settings: Settings) -> Estimate:
    spread = 2.0 * settings.sd["depth"] ** 2  # two readings of the gauge, also where only their difference is given
    if "depthchange" in values:
        # A change is a difference already: a zero error of the gauge cancels, its scale does not.
        unit, calibration = settings.units["depth"], settings.calibrations.get("depth")
        scale = 1.0 if calibration is None else calibration.scale
        return Estimate(number(values["depthchange"]) * unit.factor * scale, spread)
    if "fromdepth" not in values or "todepth" not in values:
        raise ValueError("the leg has no depths")
    rise = settings.value("depth", number(values["todepth"])) - settings.value("depth", number(values["fromdepth"]))
    return Estimate(rise, spread)
