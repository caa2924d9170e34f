"""Pipelines: files that say what to learn, lesson by lesson.

A file has settings for the run and for all lessons at its top, and a table [[lessons]] for each lesson with what
differs there. `extends` names another file to begin with. Whatever is said later counts: what a file says for all
lessons counts above all that the file it extends says, and the command line above all files.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping, Sequence, Set
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.shipped import shipped_names, shipped_path
from aquanav_tools.tables import from_table, read_toml
from aquanav_tools.train.renamed import OLD_NAMES, refuse_old_name
from aquanav_tools.train.settings import NETWORK, RunSettings, TrainSettings

FOLDER = "pipelines/train"
MAX_CHAIN = 8
"""Files that extend one another."""
RUN_KEYS = frozenset(field.name for field in dataclasses.fields(RunSettings))
LESSON_KEYS = frozenset(field.name for field in dataclasses.fields(TrainSettings))


@dataclass(frozen=True)
class Pipeline:
    """A training run: its lessons in their order."""

    lessons: tuple[TrainSettings, ...]
    run: RunSettings

    def __post_init__(self) -> None:
        if not self.lessons:
            raise ValueError("A pipeline has at least one lesson.")
        for number, lesson in enumerate(self.lessons, 1):
            if not lesson.scenario:
                raise ValueError(
                    f"Lesson {number} names no scenario. Name a folder, or a shipped one like cave-train-1."
                )
            for name in NETWORK:
                first, here = getattr(self.lessons[0], name), getattr(lesson, name)
                if here != first:
                    raise ValueError(
                        f"{name} is {first!r} in lesson 1 and {here!r} in lesson {number}; it makes the network, which "
                        "all lessons have in common."
                    )

    @property
    def steps(self) -> int:
        """Decisions in all lessons together."""
        return sum(lesson.steps for lesson in self.lessons)


@dataclass(frozen=True)
class _Tables:
    """A pipeline before its values are checked."""

    run: dict[str, Any]
    common: dict[str, Any]
    """What all lessons have in common."""
    lessons: tuple[dict[str, Any], ...]
    """Each with what they have in common."""

    def changed(self, table: dict[str, Any], where: str) -> _Tables:
        """Return these tables with those of a file, or of a command line, above them."""
        run = {key: value for key, value in table.items() if key in RUN_KEYS}
        overrides = {key: value for key, value in table.items() if key in LESSON_KEYS}
        common = {**self.common, **overrides}
        if "lessons" in table:
            own = _lesson_tables(table["lessons"], where)
            lessons = tuple({**common, **lesson} for lesson in own)
        else:
            lessons = tuple({**lesson, **overrides} for lesson in self.lessons)
        return _Tables({**self.run, **run}, common, lessons)


def read_pipeline(name: str | Path | None, overrides: dict[str, Any]) -> Pipeline:
    """Return the pipeline in a file, or the shipped one of a name, with other values above it.

    Args:
        name: A path, or a shipped name such as "paper"; None takes one lesson of defaults.
        overrides: Values that count above those of the file, in all lessons.

    Raises:
        InputError: there is no such file, or it has an unknown key or a senseless value; the message names it.
    """
    tables = _Tables({}, {}, ({},))
    where = "The command line" if name is None else str(name)
    chain = _chain(name)
    _refuse_old_names(chain, overrides)
    for path, table in chain:
        tables = tables.changed(table, path.name)
    tables = tables.changed(overrides, where)
    lessons = tuple(
        from_table(TrainSettings, lesson, f"{where}: lesson {number}" if len(tables.lessons) > 1 else where)
        for number, lesson in enumerate(tables.lessons, 1)
    )
    try:
        return Pipeline(lessons, from_table(RunSettings, tables.run, where))
    except ValueError as cause:
        raise InputError(f"{where}: {cause}") from cause


def _chain(name: str | Path | None) -> list[tuple[Path, dict[str, Any]]]:
    """Return a file and those it extends, the first of them first."""
    found: list[tuple[Path, dict[str, Any]]] = []
    folder = Path()
    while name is not None:
        path = _path_of(name, folder)
        table = read_toml(path)
        _check_keys(table, path.name, RUN_KEYS | LESSON_KEYS | OLD_NAMES | {"extends", "lessons"})
        found.insert(0, (path, table))
        if len(found) > MAX_CHAIN:
            raise InputError(
                f"{found[-1][0]} extends more than {MAX_CHAIN} files. Do they extend one another in a circle?"
            )
        name, folder = table.get("extends"), path.parent
        if name is not None and not isinstance(name, str):
            raise InputError(f"{path}: extends must be a name or a path, not {name!r}. Correct it there.")
    return found


def _refuse_old_names(chain: Sequence[tuple[Path, dict[str, Any]]], overrides: dict[str, Any]) -> None:
    """Refuse settings by old names in files, the first of which the others extend, with `overrides` above them."""
    tables = [table for _, table in chain]
    for number, (path, table) in enumerate(chain):
        above, below = (overrides, *tables[:number:-1]), tables[number::-1]
        lessons = _lesson_tables(table["lessons"], path.name) if "lessons" in table else []
        for part in (table, *lessons):
            found = [one["num_envs"] for one in (*above, part, *below) if "num_envs" in one]
            for key, value in part.items():
                refuse_old_name(key, value, (found or [TrainSettings.num_envs])[0], path.name)


def _path_of(name: str | Path, folder: Path) -> Path:
    """Return the file of a name: a path, also relative to the file that names it, or a shipped pipeline."""
    for path in (folder / name, Path(name)):
        if path.is_file():
            return path
    if Path(name).suffix or len(Path(name).parts) > 1:
        raise InputError(f"There is no file {name}. Shipped pipelines: {', '.join(shipped_names(FOLDER))}.")
    return shipped_path(FOLDER, str(name))


def check_settings(settings: Mapping[str, Any], where: str) -> None:
    """Check that there are settings of some names.

    Raises:
        InputError: there is none of a name; the message has the nearest or the new one, and `where` it was found.
    """
    for key, value in settings.items():
        refuse_old_name(key, value, settings.get("num_envs"), where)
    _check_keys(settings, where, RUN_KEYS | LESSON_KEYS)


def _check_keys(names: Iterable[str], where: str, known: Set[str]) -> None:
    for key in names:
        if key not in known:
            raise InputError(f"{where} has the unknown key '{key}'.{did_you_mean(key, known)}")


def _lesson_tables(lessons: object, where: str) -> list[dict[str, Any]]:
    if not isinstance(lessons, list) or not lessons or not all(isinstance(lesson, dict) for lesson in lessons):
        raise InputError(f"{where}: lessons must be tables [[lessons]], at least one. Correct it there.")
    return lessons
