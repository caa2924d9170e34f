"""Reading processed surveys: image files (.3d), versions 3 to 8, as the format documents of Survex describe them."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.survey.model import Leg, LegFlag, Passage, Station, StationFlag, Survey

MAX_BYTES = 100_000_000
"""A survey of 5000 stations takes 0.1 MB."""
_MAGIC = b"Survex 3D Image File\n"
_VERSIONS = {b"v%d" % number: number for number in range(3, 9)}
_EXTENDED = 0x80
_NOSURVEY_STYLE = 4
_CENTIMETRE = 0.01

Place = tuple[int, int, int]
"""East, north, up in centimetres, as the file has them."""


def read_3d(path: Path) -> Survey:
    """Return the survey of an image file. Positions in it are rounded to centimetres.

    The format joins legs by place, not by name: a leg's ends are the first stations found there.

    Raises:
        InputError: the file is missing, too large, of another kind or version, cut short, damaged, or an extended
            elevation, which is a drawing and has no shape in space.
    """
    if not path.is_file():
        raise InputError(f"There is no file {path}. Check the path.")
    if path.stat().st_size > MAX_BYTES:
        raise InputError(f"{path} has {path.stat().st_size:,} bytes; an image file has at most {MAX_BYTES:,}.")
    reader = _Reader(_Bytes(path.read_bytes(), path))
    reader.read()
    return reader.survey(path.stem)


@dataclass(eq=False)
class _Bytes:
    """A file's content and how far it was read."""

    content: bytes
    path: Path
    at: int = 0

    def error(self, text: str) -> InputError:
        return InputError(
            f"{self.path}: {text}, at byte {self.at:,} of {len(self.content):,}. Make it again with cavern."
        )

    @property
    def is_at_end(self) -> bool:
        return self.at >= len(self.content)

    def take(self, count: int) -> bytes:
        if count > len(self.content) - self.at:
            raise self.error("the file is cut short")
        self.at += count
        return self.content[self.at - count : self.at]

    def unpack(self, form: str) -> tuple[int, ...]:
        values: tuple[int, ...] = struct.unpack("<" + form, self.take(struct.calcsize("<" + form)))
        return values

    def byte(self) -> int:
        return self.take(1)[0]

    def line(self) -> bytes:
        end = self.content.find(b"\n", self.at)
        if end < 0:
            raise self.error("the header is cut short")
        text = self.content[self.at : end]
        self.at = end + 1
        return text

    def place(self) -> Place:
        east, north, up = self.unpack("3i")
        return east, north, up


@dataclass(eq=False)
class _Reader:
    """Collects the items of a file."""

    source: _Bytes
    version: int = 8
    title: str = ""
    system: str | None = None
    separator: str = "."
    label: bytes = b""
    style: int | None = None
    """None before the first: the same code later means the end of the file."""
    here: Place | None = None
    stations: list[tuple[str, Place, StationFlag]] = field(default_factory=list)
    index: dict[str, int] = field(default_factory=dict)
    at: dict[Place, int] = field(default_factory=dict)
    lines: list[tuple[Place, Place, LegFlag]] = field(default_factory=list)
    tubes: list[list[tuple[int, list[float]]]] = field(default_factory=list)
    is_tube_open: bool = False

    def read(self) -> None:
        self._header()
        items = self._items_8() if self.version >= 8 else self._items_3()
        for _ in items:
            if self.source.is_at_end:
                raise self.source.error("the file is cut short: its end mark is missing")

    def survey(self, name: str) -> Survey:
        """Return what was read."""
        legs = tuple(Leg(self._station_at(a), self._station_at(b), flags) for a, b, flags in self.lines)
        stations = tuple(Station(name, _CENTIMETRE * np.array(place), flags) for name, place, flags in self.stations)
        passages = tuple(
            Passage(np.array([station for station, _ in rows], dtype=np.int64), np.array([lrud for _, lrud in rows]))
            for rows in self.tubes
        )
        if not stations:
            raise InputError(f"{self.source.path} holds no stations. Check that it is the survey you mean.")
        return Survey(self.title or name, stations, legs, passages, self.system, self.separator)

    def _header(self) -> None:
        source = self.source
        if not source.content.startswith(_MAGIC):
            raise InputError(f"{source.path} is no Survex image file: it does not begin as one. Check the path.")
        source.at = len(_MAGIC)
        version = source.line()
        if version not in _VERSIONS:
            raise InputError(
                f"{source.path} is of version {version[:8].decode('ascii', 'replace')!r}; 'v3' to 'v8' can be read. "
                "Process the survey with a current cavern."
            )
        self.version = _VERSIONS[version]
        fields = source.line().split(b"\0")
        self.title = fields[0].decode("utf-8", "replace")
        if self.version >= 8:
            self.system = (fields[1].decode("utf-8", "replace") or None) if len(fields) > 1 else None
            self.separator = fields[2].decode("utf-8", "replace")[:1] or "." if len(fields) > 2 else "."
        source.line()  # when it was made
        if self.version >= 8 and source.byte() & _EXTENDED:
            raise InputError(
                f"{source.path} is an extended elevation, a drawing unrolled into a plane, and has no shape in space. "
                "Give the .3d file that cavern made."
            )

    def _items_8(self) -> Iterator[None]:
        """Read the items of version 8 up to the end mark, yielding after each."""
        while True:
            code = self.source.byte()
            if code == 0 and self.style == 0:
                return
            if code <= 4:
                self.style = code
            elif code == 0x0F:
                self.here = self.source.place()
            elif 0x10 <= code <= 0x13:
                self.source.take((0, 2, 3, 4)[code - 0x10])
            elif code == 0x1F:
                self.source.take(20)
            elif 0x30 <= code <= 0x33:
                self._change_label_8()
                self._tube(code)
            elif 0x40 <= code <= 0x7F:
                if not code & 0x20:
                    self._change_label_8()
                self._line(code & 0x07)
            elif code >= 0x80:
                self._change_label_8()
                self._station(code & 0x7F)
            else:
                raise self.source.error(f"there is no item of code {code:#04x}")
            yield

    def _items_3(self) -> Iterator[None]:
        """Read the items of versions 3 to 7 up to the end mark, yielding after each."""
        while True:
            code = self.source.byte()
            if code == 0 and not self.label:
                return
            if code == 0:
                self.label = b""
            elif code <= 0x0E:
                self._trim_levels(code)
            elif code == 0x0F:
                self.here = self.source.place()
            elif code <= 0x1F:
                self.label = self._cut(code - 15)
            elif code in (0x20, 0x21, 0x23, 0x24):
                self.source.take(self._date_bytes(code))
            elif code == 0x22:
                self.source.take(20)
            elif 0x30 <= code <= 0x33:
                self._append_label()
                self._tube(code)
            elif 0x40 <= code <= 0x7F:
                self._append_label()
                self._station(code & 0x3F)
            elif 0x80 <= code <= 0xBF:
                self._append_label()
                self._line(code & 0x07)
            else:
                raise self.source.error(f"there is no item of code {code:#04x}")
            yield

    def _date_bytes(self, code: int) -> int:
        if self.version < 7:
            return {0x20: 4, 0x21: 8}.get(code, 0)
        return {0x20: 2, 0x21: 3, 0x23: 4, 0x24: 0}[code]

    def _change_label_8(self) -> None:
        first = self.source.byte()
        if first:
            cut, added = first >> 4, first & 0x0F
        else:
            cut, added = self._count_8(), self._count_8()
        self.label = self._cut(cut) + self.source.take(added)

    def _count_8(self) -> int:
        count = self.source.byte()
        return self.source.unpack("I")[0] if count == 255 else count

    def _append_label(self) -> None:
        count = self.source.byte()
        if count == 0xFE:
            count += self.source.unpack("H")[0]
        elif count == 0xFF:
            count = self.source.unpack("I")[0]
        self.label += self.source.take(count)

    def _cut(self, count: int) -> bytes:
        if count > len(self.label):
            raise self.source.error(f"{count} letters are to be cut from a name of {len(self.label)}")
        return self.label[: len(self.label) - count]

    def _trim_levels(self, levels: int) -> None:
        """Cut 16 letters and then all after the N-th dot from the end."""
        label = self._cut(16)
        for _ in range(levels):
            label = label[: label.rfind(b".")] if b"." in label else b""
        if not label:
            raise self.source.error("a name is cut to nothing")
        self.label = label + b"."

    def _name(self) -> str:
        return self.label.decode("utf-8", "replace")

    def _station(self, bits: int) -> None:
        place, name, flags = self.source.place(), self._name(), StationFlag(bits)
        if not name:
            flags |= StationFlag.ANONYMOUS
        elif name in self.index:
            return
        self._add(name, place, flags)

    def _add(self, name: str, place: Place, flags: StationFlag) -> int:
        self.stations.append((name, place, flags))
        index = len(self.stations) - 1
        if name:
            self.index[name] = index
        known = self.at.get(place)
        if known is None or (name and not self.stations[known][0]):
            self.at[place] = index
        return index

    def _line(self, bits: int) -> None:
        there = self.source.place()
        if self.here is None:
            raise self.source.error("a line comes before any place")
        flags = LegFlag(bits) | (LegFlag.NOSURVEY if self.style == _NOSURVEY_STYLE else LegFlag.NONE)
        self.lines.append((self.here, there, flags))
        self.here = there

    def _tube(self, code: int) -> None:
        is_last, form = bool(code & 1), "4i" if code & 2 else "4h"
        sides = self.source.unpack(form)
        station = self.index.get(self._name())
        if station is None:
            raise self.source.error(f"passage dimensions are given for '{self._name()}', which is no station")
        if not self.is_tube_open:
            self.tubes.append([])
        self.tubes[-1].append((station, [_CENTIMETRE * side if side >= 0 else np.nan for side in sides]))
        self.is_tube_open = not is_last

    def _station_at(self, place: Place) -> int:
        index = self.at.get(place)
        return self._add("", place, StationFlag.ANONYMOUS) if index is None else index
