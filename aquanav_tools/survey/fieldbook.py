"""What was measured, before any position is known; readers fill it, `network.adjust` turns it into positions."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.survey.model import LegFlag, StationFlag
from aquanav_tools.types import Array

MAX_STATIONS = 2_000_000
"""A data set with more is none of caves: the longest on Earth, 700 km, has a tenth of it."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """One leg."""

    start: int
    end: int
    vector: Array
    """(3,) east, north, up from start to end, m."""
    covariance: Array | None
    """(3, 3) m^2; None where nothing was measured."""
    flags: LegFlag
    length: float | None
    """As read from the tape, m."""
    where: str
    """File and line."""


@dataclass(frozen=True, eq=False)
class Fix:
    """A station whose position is known."""

    position: Array
    """(3,) m."""
    covariance: Array | None
    """(3, 3) m^2; None where it holds exactly."""
    where: str


@dataclass(eq=False)
class FieldBook:
    """Collects a survey while it is read."""

    names: list[str] = field(default_factory=list)
    flags: list[StationFlag] = field(default_factory=list)
    measurements: list[Measurement] = field(default_factory=list)
    fixes: dict[int, Fix] = field(default_factory=dict)
    equates: list[tuple[int, int]] = field(default_factory=list)
    passages: list[list[tuple[int, Array]]] = field(default_factory=list)
    splay_ends: set[int] = field(default_factory=set)
    """Anonymous points whose kind says that a leg to them is a splay."""
    title: str | None = None
    coordinate_system: str | None = None
    """What positions come out in."""
    warnings: list[str] = field(default_factory=list)
    _index: dict[str, int] = field(default_factory=dict)
    _num_repeats: int = 0
    """How many readings the last leg is the mean of."""

    def station(self, name: str) -> int:
        """Return the index of the station of that full name, a new one if it was not met before."""
        if name not in self._index:
            self._index[name] = self._add(name, StationFlag.NONE)
        return self._index[name]

    def anonymous(self, flags: StationFlag, *, is_splay: bool) -> int:
        """Return the index of a new point without a name."""
        index = self._add("", flags | StationFlag.ANONYMOUS)
        if is_splay:
            self.splay_ends.add(index)
        return index

    def mark(self, station: int, flags: StationFlag) -> None:
        """Add flags to a station."""
        self.flags[station] |= flags

    def measure(self, measurement: Measurement) -> None:
        """Add a leg. Readings of one leg right after each other are averaged into one leg, as in Survex."""
        last = self.measurements[-1] if self.measurements else None
        if last is not None and (last.start, last.end, last.flags) == (
            measurement.start,
            measurement.end,
            measurement.flags,
        ):
            self._num_repeats += 1
            self.measurements[-1] = _running_mean(last, measurement, self._num_repeats)
        else:
            self._num_repeats = 1
            self.measurements.append(measurement)
        ground = StationFlag.SURFACE if measurement.flags & LegFlag.SURFACE else StationFlag.UNDERGROUND
        self.mark(measurement.start, ground)
        self.mark(measurement.end, ground)

    def fix(self, station: int, fix: Fix) -> str | None:
        """Fix a station; return what is wrong with that, if anything."""
        known = self.fixes.get(station)
        if known is not None and not np.array_equal(known.position, fix.position):
            return f"the station '{self.names[station]}' is fixed at another place by {known.where}"
        self.fixes[station] = fix
        self.mark(station, StationFlag.FIXED)
        return None

    def _add(self, name: str, flags: StationFlag) -> int:
        if len(self.names) >= MAX_STATIONS:
            raise InputError(
                f"The survey has more than {MAX_STATIONS:,} stations, which no cave has. Check that the file is one."
            )
        self.names.append(name)
        self.flags.append(flags)
        return len(self.names) - 1


def _running_mean(mean: Measurement, reading: Measurement, count: int) -> Measurement:
    """Return the mean of `count` readings from that of all but the last one.

    The covariance stays that of one reading: what repeats share, such as a bad calibration, does not average out.
    """
    if mean.covariance is None or reading.covariance is None or mean.length is None or reading.length is None:
        return mean
    return replace(
        mean,
        vector=mean.vector + (reading.vector - mean.vector) / count,
        covariance=mean.covariance + (reading.covariance - mean.covariance) / count,
        length=mean.length + (reading.length - mean.length) / count,
    )
