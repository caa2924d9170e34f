"""Reading Survex data files (.svx), as the Survex manual describes them.

Every command of the manual is known. Those that say nothing about positions (team, instrument, date, copyright, ref,
require) are passed over. Some are taken differently, each with a warning: *solve (all is adjusted at once), *prefix
(deprecated), and *declination auto (bearings are left as read: we carry no model of the Earth's magnetic field). An
unknown command is an error.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.survey import svx_settings
from aquanav_tools.survey.characters import DEFAULTS, Characters
from aquanav_tools.survey.data_lines import STYLE_ALIASES, STYLES, DataLines, Layout, number, parse_layout
from aquanav_tools.survey.fieldbook import FieldBook, Fix
from aquanav_tools.survey.finish import finish
from aquanav_tools.survey.model import LegFlag, StationFlag, Survey
from aquanav_tools.survey.projection import to_system
from aquanav_tools.survey.settings import Settings
from aquanav_tools.survey.svx_files import MAX_DEPTH, SurveyFiles
from aquanav_tools.types import Array

PASSED_OVER = {"team", "instrument", "date", "copyright", "ref", "require"}


def read_svx(path: Path) -> Survey:
    """Return the adjusted survey of a Survex data file and all it includes.

    Raises:
        InputError: a line cannot be read (the message names file and line), or stations are not tied together.
    """
    reader = _Reader(SurveyFiles(path, ".svx"))
    reader.read_file(path, 0)
    return finish(reader.book, path.stem)


@dataclass(frozen=True)
class _Scope:
    """What *end puts back."""

    survey: str | None
    settings: Settings
    characters: Characters
    layout: Layout


@dataclass(eq=False)
class _Reader:
    """Walks through files line by line."""

    files: SurveyFiles
    book: FieldBook = field(default_factory=FieldBook)
    settings: Settings = field(default_factory=Settings)
    characters: Characters = field(default_factory=Characters)
    scopes: list[_Scope] = field(default_factory=list)
    path: Path = Path()
    line: int = 0
    depth: int = 0

    def __post_init__(self) -> None:
        self.data = DataLines(Layout(), self.book)

    @property
    def where(self) -> str:
        return f"{self.path}:{self.line}"

    def error(self, text: str) -> InputError:
        return InputError(f"{self.where}: {text}. Correct the file there.")

    def warn(self, text: str) -> None:
        self.book.warnings.append(f"{self.where}: {text}.")

    def read_file(self, path: Path, depth: int) -> None:
        if depth > MAX_DEPTH:
            raise self.error(f"files include each other {MAX_DEPTH} levels deep; one may include itself")
        before = self.path, self.line, self.depth, len(self.scopes), self.settings.survey
        text = self.files.text(path)
        self.path, self.depth = path, depth
        for self.line, line in enumerate(text.splitlines(), 1):
            self.read_line(line)
        if len(self.scopes) != before[3]:
            raise self.error(f"the file ends before *end {self.scopes[-1].survey or ''}")
        self.path, self.line, self.depth = before[:3]
        self.settings = replace(self.settings, survey=before[4])

    def read_line(self, line: str) -> None:
        command = self.characters.command(line)
        if command is not None:
            if command:
                self.run(command[0].lower(), command[1:])
            return
        words = self.characters.words(line)
        try:
            if words:
                self.data.read([self.characters.plain(word) for word in words], self.settings, self.resolve, self.where)
            elif not line.strip(self.characters.by_item["blank"]):
                self.data.blank()
        except ValueError as cause:
            raise self.error(str(cause)) from cause

    def run(self, name: str, words: list[str]) -> None:
        if name in PASSED_OVER:
            return
        action = COMMANDS.get(name)
        if action is None:
            raise InputError(
                f"{self.where}: there is no command *{name}.{did_you_mean(name, [*COMMANDS, *PASSED_OVER])} "
                "Correct the file there."
            )
        try:
            action(self, words)
        except (ValueError, IndexError) as cause:
            reason = str(cause) if isinstance(cause, ValueError) else "words are missing"
            raise self.error(f"*{name} {' '.join(words)}: {reason}") from cause

    def full_name(self, name: str) -> str:
        """Return the full name of a station or survey that a line names from within the current survey."""
        separators = self.characters.by_item["separator"]
        if name and name[0] in self.characters.by_item["root"]:
            base: tuple[str, ...] = ()
            name = name[1:].lstrip(separators)
        else:
            base = self.settings.survey
        table = {ord(char): "." for char in separators}
        levels = [self._level(level, name) for level in name.translate(table).split(".")]
        return ".".join([*base, *levels])

    def _level(self, level: str, name: str) -> str:
        allowed = self.characters.by_item["names"]
        if not level or not all(char.isalnum() or char in allowed for char in level):
            raise ValueError(f"'{name}' is no name: letters, digits and {allowed} may be in one")
        cased = {"tolower": level.lower(), "toupper": level.upper(), "preserve": level}[self.settings.case]
        return cased[: self.settings.significant]

    def resolve(self, name: str) -> int:
        """Return the index of a station that a data line names."""
        separators = self.characters.by_item["separator"]
        if name == "-" and self.settings.is_dash_splay:
            name = 2 * separators[0]
        if 1 <= len(name) <= 3 and all(char in separators for char in name):
            flags = StationFlag.WALL if len(name) == 2 else StationFlag.NONE
            return self.book.anonymous(flags, is_splay=len(name) < 3)
        return self.book.station(self.full_name(name))


def _begin(reader: _Reader, words: list[str]) -> None:
    survey = words[0] if words else None
    reader.scopes.append(_Scope(survey, reader.settings, reader.characters, reader.data.layout))
    if survey is not None:
        reader.settings = replace(reader.settings, survey=tuple(reader.full_name(survey).split(".")))
    reader.data = DataLines(reader.data.layout, reader.book)


def _end(reader: _Reader, words: list[str]) -> None:
    if not reader.scopes:
        raise ValueError("there is no *begin for it")
    scope = reader.scopes.pop()
    if words and (scope.survey is None or words[0].lower() != scope.survey.lower()):
        raise ValueError(f"the block began as '{scope.survey or ''}'")
    reader.settings, reader.characters = scope.settings, scope.characters
    reader.data = DataLines(scope.layout, reader.book)


def _include(reader: _Reader, words: list[str]) -> None:
    path = reader.files.find_included(words[0], reader.path, reader.where)
    reader.read_file(path, reader.depth + 1)


def _data(reader: _Reader, words: list[str]) -> None:
    if not words:
        reader.data = DataLines(reader.data.layout, reader.book)
        return
    try:
        layout = parse_layout(words)
    except KeyError as cause:
        known = STYLES.get(STYLE_ALIASES.get(words[0].lower(), words[0].lower()), {*STYLES, *STYLE_ALIASES})
        word = str(cause.args[0])
        raise ValueError(f"'{word}' is not known here.{did_you_mean(word, known)}") from cause
    reader.data = DataLines(layout, reader.book)


def _equate(reader: _Reader, words: list[str]) -> None:
    if len(words) < 2:
        raise ValueError("two or more stations are needed")
    first, *others = [reader.book.station(reader.full_name(word)) for word in words]
    reader.book.equates.extend((first, other) for other in others)


def _fix(reader: _Reader, words: list[str]) -> None:
    station = reader.book.station(reader.full_name(words[0]))
    numbers = [word for word in words[1:] if word.lower() != "reference"]
    values = [number(reader.characters.plain(word)) for word in numbers]
    if len(values) not in (0, 3, 4, 5, 6, 9):
        raise ValueError(f"{len(values)} numbers follow the name; 0, 3, 4, 5, 6 or 9 are expected")
    if not values and reader.settings.coordinate_system:
        raise ValueError("in a coordinate system the position must be given")
    position = _in_output_system(reader, np.array(values[:3] or [0.0, 0.0, 0.0]))
    problem = reader.book.fix(station, Fix(position, _fix_covariance(values[3:]), reader.where))
    if problem:
        raise ValueError(problem)


def _in_output_system(reader: _Reader, position: Array) -> Array:
    source, target = reader.settings.coordinate_system, reader.book.coordinate_system
    if source is None:
        return position
    if target is None:
        raise ValueError("*cs is given without *cs out. Add the system that positions shall come out in")
    converted = to_system(position, source, target)
    if converted is None:
        raise ValueError(
            f"from {source} to {target} we cannot convert, only from LONG-LAT to a UTM zone on WGS84. Give the "
            "position in the output's system, or process the survey with Survex's cavern and hand over the .3d file"
        )
    return converted


def _fix_covariance(values: list[float]) -> Array | None:
    """Return the covariance from one, two or three standard deviations and maybe three covariances."""
    if not values:
        return None
    deviations = {1: values * 3, 2: [values[0], values[0], values[-1]]}.get(len(values), values[:3])
    covariance = np.diag(np.square(deviations))
    if len(values) == 6:
        xy, yz, zx = values[3:]
        covariance = covariance + np.array([[0, xy, zx], [xy, 0, yz], [zx, yz, 0]])
    return covariance


def _entrance(reader: _Reader, words: list[str]) -> None:
    reader.book.mark(reader.book.station(reader.full_name(words[0])), StationFlag.ENTRANCE)


def _export(reader: _Reader, words: list[str]) -> None:
    for word in words:
        reader.book.mark(reader.book.station(reader.full_name(word)), StationFlag.EXPORTED)


def _flags(reader: _Reader, words: list[str]) -> None:
    flags, is_on = reader.settings.flags, True
    known = {"duplicate": LegFlag.DUPLICATE, "splay": LegFlag.SPLAY, "surface": LegFlag.SURFACE}
    for word in (word.lower() for word in words):
        if word == "not":
            is_on = False
            continue
        if word not in known:
            raise ValueError(f"there is no flag '{word}'.{did_you_mean(word, known)}")
        flags = flags | known[word] if is_on else flags & ~known[word]
        is_on = True
    reader.settings = replace(reader.settings, flags=flags)


def _alias(reader: _Reader, words: list[str]) -> None:
    if words[0].lower() != "station" or words[1] != "-" or words[2:] not in ([], [".."]):
        raise ValueError("only *alias station - .. and *alias station - are known")
    reader.settings = replace(reader.settings, is_dash_splay=len(words) == 3)


def _prefix(reader: _Reader, words: list[str]) -> None:
    reader.warn("*prefix is deprecated; *begin and *end say where a survey ends")
    if all(char in reader.characters.by_item["root"] for char in words[0]):
        reader.settings = replace(reader.settings, survey=())
    else:
        reader.settings = replace(reader.settings, survey=tuple(reader.full_name(words[0]).split(".")))


def _set(reader: _Reader, words: list[str]) -> None:
    try:
        reader.characters = reader.characters.with_item(words[0].lower(), "".join(words[1:]))
    except KeyError as cause:
        raise ValueError(f"there is no item '{words[0]}'.{did_you_mean(words[0].lower(), DEFAULTS)}") from cause


def _cs(reader: _Reader, words: list[str]) -> None:
    if words[0].lower() != "out":
        reader.settings = replace(reader.settings, coordinate_system=" ".join(words))
    elif reader.book.coordinate_system is None:  # Survex ignores all but the first
        reader.book.coordinate_system = " ".join(words[1:])


def _declination(reader: _Reader, words: list[str]) -> None:
    if words[0].lower() == "auto":
        reader.warn(
            "*declination auto needs a model of the Earth's magnetic field, which we do not carry; bearings are taken "
            "as read, so that the survey is turned by the declination. Give *declination <angle> degrees, or process "
            "it with Survex's cavern and hand over the .3d file"
        )
        words = ["0", "degrees"]
    reader.settings = svx_settings.declination(reader.settings, words)


def _default(reader: _Reader, words: list[str]) -> None:
    for word in (word.lower() for word in words):
        if word not in ("all", "calibrate", "data", "units"):
            raise ValueError(f"there is no group '{word}'.{did_you_mean(word, ['all', 'calibrate', 'data', 'units'])}")
        if word in ("all", "calibrate"):
            reader.settings = svx_settings.calibrate(reader.settings, ["default"])
        if word in ("all", "units"):
            reader.settings = svx_settings.units(reader.settings, ["default"])
        if word in ("all", "data"):
            _data(reader, ["default"])


def _solve(reader: _Reader, words: list[str]) -> None:
    reader.warn("*solve is left out; all of the survey is adjusted at once")


def _title(reader: _Reader, words: list[str]) -> None:
    if reader.book.title is None and not reader.settings.survey:  # Survex shows only a title of the outermost level
        reader.book.title = " ".join(words)


def _changes(change: Callable[[Settings, list[str]], Settings]) -> Callable[[_Reader, list[str]], None]:
    """Return the command that puts changed settings in force."""

    def run(reader: _Reader, words: list[str]) -> None:
        reader.settings = change(reader.settings, [reader.characters.plain(word) for word in words])

    return run


COMMANDS: dict[str, Callable[[_Reader, list[str]], None]] = {
    "alias": _alias,
    "begin": _begin,
    "calibrate": _changes(svx_settings.calibrate),
    "case": _changes(svx_settings.case),
    "cs": _cs,
    "data": _data,
    "declination": _declination,
    "default": _default,
    "end": _end,
    "entrance": _entrance,
    "equate": _equate,
    "export": _export,
    "fix": _fix,
    "flags": _flags,
    "include": _include,
    "infer": _changes(svx_settings.infer),
    "prefix": _prefix,
    "sd": _changes(svx_settings.sd),
    "set": _set,
    "solve": _solve,
    "title": _title,
    "truncate": _changes(svx_settings.truncate),
    "units": _changes(svx_settings.units),
}
