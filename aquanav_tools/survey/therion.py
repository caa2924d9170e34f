"""Reading the centrelines of Therion data files (.th), as the Therion book describes them.

Read: survey, centreline (centerline), input, equate, and in a centreline data, units, calibrate, sd, declination,
flags, fix, cs, equate, station (for entrances), infer, group, break, station-names. Maps, scraps and what else Therion
draws is passed over, and so are people, dates and instruments. With a warning are left aside: import, grade,
grid-angle, and dimensions on the lines of shots (those of "data dimensions" are read). An unknown command is an error.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.survey import svx_settings
from aquanav_tools.survey.data_lines import STYLES, DataLines, Layout, number, parse_layout
from aquanav_tools.survey.fieldbook import FieldBook, Fix
from aquanav_tools.survey.finish import finish
from aquanav_tools.survey.model import LegFlag, StationFlag, Survey
from aquanav_tools.survey.projection import GEOGRAPHIC, to_system
from aquanav_tools.survey.settings import Settings
from aquanav_tools.survey.svx_files import MAX_DEPTH, SurveyFiles

SKIPPED_BLOCKS = {"scrap", "map", "surface", "grade", "layout", "lookup", "comment", "text", "lines", "points"}
PASSED_OVER = {
    *("encoding", "join", "select", "unselect", "revise", "require", "source", "language", "sketch", "date", "team"),
    *("explo-date", "explo-team", "instrument", "mark", "extend", "walls", "vthreshold", "require", "system", "cs-def"),
}
SET_ASIDE = {"import", "grade", "grid-angle"}
UNITS = {"meter": "metres", "metre": "metres", "feet": "feet", "foot": "feet", "yard": "yards", "degree": "degrees"}
UNITS |= {"deg": "degrees", "min": "minutes", "minute": "minutes", "grad": "grads", "mil": "mils", "m": "metres"}
UNITS |= {"percent": "percent", "percentage": "percent", "ft": "feet"}
_DIMENSIONS = ("left", "right", "up", "down", "ceiling", "floor")
_WORDS = re.compile(r'"((?:[^"]|"")*)"|\[([^\]]*)\]|(\S+)')


def read_th(path: Path) -> Survey:
    """Return the adjusted survey of a Therion data file and all it takes in.

    Raises:
        InputError: a line cannot be read (the message names file and line), or stations are not tied together.
    """
    reader = _Reader(SurveyFiles(path, ".th"))
    reader.read_file(path, 0)
    return finish(reader.book, path.stem)


@dataclass(frozen=True)
class _Scope:
    """What the end of a block puts back."""

    kind: str
    settings: Settings
    layout: Layout
    affixes: tuple[str, str]


@dataclass(eq=False)
class _Reader:
    """Walks through files line by line."""

    files: SurveyFiles
    book: FieldBook = field(default_factory=FieldBook)
    settings: Settings = field(default_factory=lambda: Settings(case="preserve", is_dash_splay=True))
    scopes: list[_Scope] = field(default_factory=list)
    affixes: tuple[str, str] = ("", "")
    skipped: str | None = None
    path: Path = Path()
    line: int = 0
    depth: int = 0

    def __post_init__(self) -> None:
        self.data = DataLines(Layout(), self.book)

    @property
    def where(self) -> str:
        return f"{self.path}:{self.line}"

    @property
    def is_in_centreline(self) -> bool:
        return any(scope.kind == "centreline" for scope in self.scopes)

    def warn(self, text: str) -> None:
        self.book.warnings.append(f"{self.where}: {text}.")

    def read_file(self, path: Path, depth: int) -> None:
        if depth > MAX_DEPTH:
            raise InputError(f"{self.where}: files take each other in {MAX_DEPTH} levels deep; one may take itself in.")
        before, num_scopes = (self.path, self.line, self.depth), len(self.scopes)
        text = self.files.text(path)
        self.path, self.depth = path, depth
        pending = ""
        for self.line, line in enumerate(text.splitlines(), 1):
            if line.endswith("\\"):
                pending += line[:-1] + " "
                continue
            self.read_line(pending + line)
            pending = ""
        if len(self.scopes) != num_scopes or self.skipped:
            block = self.skipped or self.scopes[-1].kind
            raise InputError(f"{self.where}: the file ends before end{block}. Correct the file there.")
        self.path, self.line, self.depth = before

    def read_line(self, line: str) -> None:
        words = split(line)
        name = words[0].lower().replace("centerline", "centreline") if words else ""
        if self.skipped:
            self.skipped = None if name == "end" + self.skipped else self.skipped
        elif not words:
            if not line.strip():
                self.data.blank()
        elif name in SKIPPED_BLOCKS and not (name == "grade" and self.is_in_centreline):
            self.skipped = name
        elif name in SET_ASIDE:
            self.warn(f"'{name}' is not read")
        elif name not in PASSED_OVER:
            self.run(name, words)

    def run(self, name: str, words: list[str]) -> None:
        action = COMMANDS.get(name)
        try:
            if action is not None:
                action(self, words[1:])
            elif self.is_in_centreline and len(words) > 1:
                self.data.read(words, self.settings, self.resolve, self.where)
            else:
                raise ValueError(f"there is no command '{name}'.{did_you_mean(name, [*COMMANDS, *PASSED_OVER])}")
        except (ValueError, IndexError) as cause:
            reason = str(cause) if isinstance(cause, ValueError) else "words are missing"
            raise InputError(f"{self.where}: {' '.join(words)}: {reason}. Correct the file there.") from cause

    def full_name(self, name: str) -> str:
        """Return the full name of a station: "1@inner.outer" is outer.inner.1 below the current survey."""
        station, _, surveys = name.partition("@")
        if not station:
            raise ValueError(f"'{name}' is no name")
        levels = surveys.split(".")[::-1] if surveys else []
        if not surveys:
            station = self.affixes[0] + station + self.affixes[1]
        return ".".join([*self.settings.survey, *levels, station])

    def resolve(self, name: str) -> int:
        """Return the index of a station that a line names."""
        if name in (".", "-"):
            flags = StationFlag.WALL if name == "-" else StationFlag.NONE
            return self.book.anonymous(flags, is_splay=True)
        return self.book.station(self.full_name(name))

    def open(self, kind: str) -> None:
        self.scopes.append(_Scope(kind, self.settings, self.data.layout, self.affixes))

    def close(self, kind: str) -> None:
        if not self.scopes or self.scopes[-1].kind != kind:
            raise ValueError(f"no {kind} is open here")
        scope = self.scopes.pop()
        self.settings, self.affixes = scope.settings, scope.affixes
        self.data = DataLines(scope.layout, self.book)


def split(line: str) -> list[str]:
    """Return the words of a line: "text" and [lists] kept together, comments dropped."""
    words = []
    for match in _WORDS.finditer(line):
        if match[3] is not None and match[3].startswith("#"):
            break
        words.append(next(group for group in match.groups() if group is not None))
    return words


def _survey(reader: _Reader, words: list[str]) -> None:
    reader.open("survey")
    if "-title" in words and reader.book.title is None:
        reader.book.title = words[words.index("-title") + 1]
    reader.settings = replace(reader.settings, survey=(*reader.settings.survey, words[0]))
    if "-declination" in words:
        values = words[words.index("-declination") + 1].split()
        if len(values) == 2:
            reader.settings = svx_settings.declination(reader.settings, [values[0], _unit(values[1])])
        else:
            reader.warn("a declination for several dates is not read; give it in each centreline")


def _centreline(reader: _Reader, words: list[str]) -> None:
    reader.open("centreline")
    reader.data = DataLines(Layout(), reader.book)


def _input(reader: _Reader, words: list[str]) -> None:
    path = reader.files.find_included(words[0], reader.path, reader.where)
    if path.suffix.lower() == ".th2":
        return  # a drawing
    reader.read_file(path, reader.depth + 1)


def _equate(reader: _Reader, words: list[str]) -> None:
    if len(words) < 2:
        raise ValueError("two or more stations are needed")
    first, *others = [reader.resolve(word) for word in words]
    reader.book.equates.extend((first, other) for other in others)


def _data(reader: _Reader, words: list[str]) -> None:
    style = words[0].lower()
    if style != "dimensions" and any(word.lower() in _DIMENSIONS for word in words):
        reader.warn("dimensions on the lines of shots are not read; those of 'data dimensions' are")
        words = ["ignore" if word.lower() in _DIMENSIONS else word for word in words]
    try:
        reader.data = DataLines(parse_layout(words), reader.book)
    except KeyError as cause:
        known = STYLES.get(style, {*STYLES, "topofil", "dimensions"})
        word = str(cause.args[0])
        raise ValueError(f"'{word}' is not known here.{did_you_mean(word, known)}") from cause


def _fix(reader: _Reader, words: list[str]) -> None:
    values = [number(word) for word in words[1:]]
    if len(values) not in (0, 3, 6):
        raise ValueError(f"{len(values)} numbers follow the name; 0, 3 or 6 are expected")
    position = np.array(values[:3] or [0.0, 0.0, 0.0])
    system = reader.settings.coordinate_system
    if system is not None:
        if system.lower() == "lat-long":
            system, position = "long-lat", position[[1, 0, 2]]
        reader.book.coordinate_system = reader.book.coordinate_system or _output_system(system, position[0])
        converted = to_system(position, system, reader.book.coordinate_system)
        if converted is None:
            raise ValueError(f"from {system} to {reader.book.coordinate_system} we cannot convert")
        position = converted
    covariance = np.diag(np.square(values[3:])) if len(values) == 6 else None
    problem = reader.book.fix(reader.resolve(words[0]), Fix(position, covariance, reader.where))
    if problem:
        raise ValueError(problem)


def _output_system(system: str, longitude: float) -> str:
    """Return the system to compute in: that of the first fix, or the UTM zone of its longitude, degrees."""
    if system.lower() not in GEOGRAPHIC:
        return system
    return f"UTM{math.floor((longitude + 180.0) / 6.0) % 60 + 1}N"


def _station(reader: _Reader, words: list[str]) -> None:
    flags = [word.lower() for word in words[2:]]
    if "entrance" in flags and flags[flags.index("entrance") - 1] != "not":
        reader.book.mark(reader.resolve(words[0]), StationFlag.ENTRANCE)


def _flags(reader: _Reader, words: list[str]) -> None:
    known = {"duplicate": LegFlag.DUPLICATE, "splay": LegFlag.SPLAY, "surface": LegFlag.SURFACE}
    known |= {"approximate": LegFlag.NONE, "approx": LegFlag.NONE}
    flags, is_on = reader.settings.flags, True
    for word in (word.lower() for word in words):
        if word == "not":
            is_on = False
            continue
        if word not in known:
            raise ValueError(f"there is no flag '{word}'.{did_you_mean(word, known)}")
        flags = flags | known[word] if is_on else flags & ~known[word]
        is_on = True
    reader.settings = replace(reader.settings, flags=flags)


def _cs(reader: _Reader, words: list[str]) -> None:
    reader.settings = replace(reader.settings, coordinate_system=words[0])


def _declination(reader: _Reader, words: list[str]) -> None:
    words = ["0", "degrees"] if words == ["-"] else words
    reader.settings = svx_settings.declination(reader.settings, [words[0], _unit(words[1])])


def _affix(reader: _Reader, words: list[str]) -> None:
    reader.affixes = (words[0], words[1])


def _changes(change: Callable[[Settings, list[str]], Settings]) -> Callable[[_Reader, list[str]], None]:
    """Return the command that puts changed settings in force; units are put into Survex's words."""

    def run(reader: _Reader, words: list[str]) -> None:
        axes = {"x": "dx", "y": "dy", "z": "dz"}
        reader.settings = change(reader.settings, [axes.get(word, _unit(word)) for word in words])

    return run


def _unit(word: str) -> str:
    return UNITS.get(word.lower().rstrip("s"), word)


COMMANDS: dict[str, Callable[[_Reader, list[str]], None]] = {
    "break": lambda reader, words: reader.data.blank(),
    "calibrate": _changes(svx_settings.calibrate),
    "centreline": _centreline,
    "cs": _cs,
    "data": _data,
    "declination": _declination,
    "endcentreline": lambda reader, words: reader.close("centreline"),
    "endgroup": lambda reader, words: reader.close("group"),
    "endsurvey": lambda reader, words: reader.close("survey"),
    "equate": _equate,
    "fix": _fix,
    "flags": _flags,
    "group": lambda reader, words: reader.open("group"),
    "infer": _changes(svx_settings.infer),
    "input": _input,
    "sd": _changes(svx_settings.sd),
    "station": _station,
    "station-names": _affix,
    "survey": _survey,
    "units": _changes(svx_settings.units),
}
