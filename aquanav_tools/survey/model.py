"""A cave survey after its network was adjusted: stations, legs, splays and passage dimensions.

Axes: x east, y north, z up, metres.
"""

from __future__ import annotations

import enum
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from aquanav_tools.types import Array, IntArray


class StationFlag(enum.Flag):
    """What is known of a station; the values are those of Survex's image format 8."""

    NONE = 0
    SURFACE = 0x01
    UNDERGROUND = 0x02
    ENTRANCE = 0x04
    EXPORTED = 0x08
    FIXED = 0x10
    ANONYMOUS = 0x20
    WALL = 0x40


class LegFlag(enum.Flag):
    """What is known of a leg; the first three values are those of Survex's image format."""

    NONE = 0
    SURFACE = 0x01
    DUPLICATE = 0x02
    SPLAY = 0x04
    NOSURVEY = 0x08
    """Nothing was measured: the two stations see each other, no more."""


NOT_PASSAGE = LegFlag.SURFACE | LegFlag.SPLAY
"""A leg with one of these says nothing about where the passage runs."""
NOT_LENGTH = LegFlag.SURFACE | LegFlag.DUPLICATE | LegFlag.SPLAY | LegFlag.NOSURVEY
"""A leg with one of these does not count towards the cave's length (as in Survex)."""


@dataclass(frozen=True, eq=False)
class Station:
    """A point of the survey."""

    name: str
    """Full name with the surveys it is in, such as "mietusia.rura.3"; empty where anonymous."""
    position: Array
    """(3,) east, north, up, m."""
    flags: StationFlag = StationFlag.NONE


@dataclass(frozen=True)
class Leg:
    """A measured line between two stations. A splay is a leg whose end is a point of the wall."""

    start: int
    """Index of the station it was measured from."""
    end: int
    """Index of the station, or of the anonymous point, it was measured to."""
    flags: LegFlag = LegFlag.NONE
    measured: float | None = None
    """Length before adjustment, m; None where the format does not say."""


@dataclass(frozen=True, eq=False)
class Passage:
    """Dimensions of one unbranched passage at the stations along it."""

    stations: IntArray
    """(K,) indices of stations, in order."""
    lrud: Array
    """(K, 4) left, right, up, down from the station to the wall, m; NaN where not given."""


@dataclass(frozen=True, eq=False)
class Survey:
    """A whole survey. Stations that were equated share one position, bit by bit."""

    title: str
    stations: tuple[Station, ...]
    legs: tuple[Leg, ...]
    """Every leg, splays among them."""
    passages: tuple[Passage, ...] = ()
    coordinate_system: str | None = None
    """Name or code of the system the positions are in, None where nothing says."""
    separator: str = "."
    """Stands between the levels of a station's name."""
    warnings: tuple[str, ...] = ()
    """What was read but left aside, or looks wrong, a sentence each."""

    @property
    def positions(self) -> Array:
        """(S, 3) positions of all stations, m."""
        return np.array([station.position for station in self.stations]).reshape(-1, 3)

    @property
    def length(self) -> float:
        """Adjusted length of the cave, m: without surface legs, duplicates, splays and unsurveyed legs."""
        ends = self._ends([leg for leg in self.legs if not leg.flags & NOT_LENGTH])
        return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())

    @property
    def centreline(self) -> tuple[Leg, ...]:
        """The legs along passages, duplicates too: neither splays nor above ground."""
        return tuple(leg for leg in self.legs if not leg.flags & NOT_PASSAGE)

    @property
    def splays(self) -> tuple[Leg, ...]:
        """The shots from a station to the wall."""
        return tuple(leg for leg in self.legs if leg.flags & LegFlag.SPLAY and not leg.flags & LegFlag.SURFACE)

    @property
    def entrances(self) -> tuple[Station, ...]:
        """The stations marked as entrances."""
        return tuple(station for station in self.stations if station.flags & StationFlag.ENTRANCE)

    def segments(self, legs: tuple[Leg, ...]) -> Array:
        """(M, 2, 3) both ends of some of its legs, m."""
        return self._ends(list(legs))

    def find(self, name: str) -> Station:
        """Return the station of that full name.

        Raises:
            KeyError: there is none.
        """
        for station in self.stations:
            if station.name == name:
                return station
        raise KeyError(name)

    def _ends(self, legs: list[Leg]) -> Array:
        indices = np.array([(leg.start, leg.end) for leg in legs], dtype=np.int64).reshape(-1, 2)
        ends: Array = self.positions[indices]
        return ends


def shared_levels(names: Iterable[str], separator: str) -> list[str]:
    """Return the surveys, outermost first, that all stations of some full names are in."""
    shared: list[str] | None = None
    for name in names:
        levels = name.split(separator)[:-1]
        known = levels if shared is None else shared
        same = [ours == theirs for ours, theirs in zip(levels, known, strict=False)]
        shared = known[: same.index(False) if False in same else len(same)]
    return shared or []
