"""Reading tables (TOML, JSON) into frozen dataclasses, strictly: unknown, missing and mistyped keys are refused."""

from __future__ import annotations

import dataclasses
import sys
import types
import typing
from pathlib import Path
from typing import Any, TypeVar

from aquanav_tools.errors import AquanavError, InputError, did_you_mean
from aquanav_tools.text_files import read_text

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

T = TypeVar("T")
MAX_SETTINGS_BYTES = 1_000_000


def read_toml(path: Path, error: type[AquanavError] = InputError) -> dict[str, Any]:
    """Return the table in a TOML file.

    Raises:
        error: the file is missing, too large to be settings, not UTF-8 or not TOML; the message names the place.
    """
    if not path.is_file():
        raise error(f"There is no file {path}. Check the path.")
    return parse_toml(read_text(path, error, MAX_SETTINGS_BYTES), str(path), error)


def parse_toml(text: str, where: str, error: type[AquanavError] = InputError) -> dict[str, Any]:
    """Return the table in a TOML text; `where` is what the message calls it.

    Raises:
        error: it is not TOML; the message names the place.
    """
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as cause:  # a number of 5000 digits is a ValueError of its own
        raise error(f"{where} is not valid TOML: {cause}. Correct the file there.") from cause


def from_table(cls: type[T], table: object, where: str, error: type[AquanavError] = InputError) -> T:
    """Return `cls(**table)` with nested dataclasses filled in, every name and type checked.

    Args:
        cls: a dataclass.
        table: what a TOML or JSON reader returned.
        where: what the messages call the table, for example the file's name.
        error: class to raise.

    Raises:
        error: an unknown key (with the closest match), a missing one, a wrong type, or a value that the dataclass
            itself refuses.
    """
    if not isinstance(table, dict):
        raise error(f"{where} must be a table, not {type(table).__name__}. Correct it there.")
    fields = {field.name: field for field in dataclasses.fields(cls) if field.init}  # type: ignore[arg-type]
    for key in table:
        if key not in fields:
            raise error(f"{where} has the unknown key '{key}'.{did_you_mean(str(key), fields)}")
    hints = typing.get_type_hints(cls)
    values = {}
    for name, field in fields.items():
        if name in table:
            values[name] = _convert(hints[name], table[name], f"{where}: {name}", error)
        elif field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING:
            raise error(f"{where} lacks the key '{name}'. Add it there.")
    try:
        return cls(**values)
    except ValueError as cause:
        raise error(f"{where}: {cause} Correct the value there.") from cause


def _convert(hint: Any, value: object, where: str, error: type[AquanavError]) -> Any:
    if dataclasses.is_dataclass(hint):
        return from_table(typing.cast(type, hint), value, where, error)
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is tuple:
        return _convert_tuple(arguments, value, where, error)
    if origin is typing.Literal:
        if value not in arguments:
            raise error(f"{where} is {value!r}.{did_you_mean(str(value), map(str, arguments))}")
        return value
    if origin in (typing.Union, types.UnionType):
        return _convert_union([a for a in arguments if a is not type(None)], value, where, error)
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return _to_float(value, where, error)
    if hint is Path and isinstance(value, str | Path):
        return Path(value)
    if type(value) is not hint:
        raise error(
            f"{where} must be of type {hint.__name__}, not {type(value).__name__} ({value!r}). Correct it there."
        )
    return value


def _to_float(value: int, where: str, error: type[AquanavError]) -> float:
    try:
        return float(value)
    except OverflowError as cause:
        raise error(f"{where} has more than 308 digits, too many for a number here. Correct it there.") from cause


def _convert_tuple(arguments: tuple[Any, ...], value: object, where: str, error: type[AquanavError]) -> tuple[Any, ...]:
    if not isinstance(value, list | tuple):
        raise error(f"{where} must be a list, not {type(value).__name__}. Correct it there.")
    is_open = len(arguments) == 2 and arguments[1] is Ellipsis
    if not is_open and len(value) != len(arguments):
        raise error(f"{where} must have {len(arguments)} values, not {len(value)}. Correct it there.")
    hints = [arguments[0]] * len(value) if is_open else arguments
    return tuple(
        _convert(hint, item, f"{where}[{n}]", error) for n, (hint, item) in enumerate(zip(hints, value, strict=True))
    )


def _convert_union(choices: list[Any], value: object, where: str, error: type[AquanavError]) -> Any:
    """Return the value as the first of some types that takes it; None stays None."""
    if value is None:
        return None
    faults = []
    for choice in choices:
        try:
            return _convert(choice, value, where, error)
        except error as fault:
            faults.append(fault)
    # A list of the wrong length is better explained by the type that takes lists.
    raise next((fault for fault in faults if "values" in str(fault)), faults[0])
