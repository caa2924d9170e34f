"""Keeping plain values (dataclasses of arrays and numbers, as stages return them) in one file, without any code in it.

The file is NumPy's npz: an array per array, and one JSON text for all the rest. What comes back is made after the types
that the dataclasses declare, never after names in the file; so no file can make anything run.
"""

from __future__ import annotations

import dataclasses
import json
import os
import types
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

T = TypeVar("T")
_TEXT = "values"
"""Name of the JSON text among the arrays, which are called by numbers."""


def kept_value(kind: type[T], path: Path, make: Callable[[], T]) -> T:
    """Return the value in a file, made and written first where there is none.

    Args:
        kind: Its class: a dataclass whose fields are declared as arrays, plain values, tuples, and such dataclasses.
        path: Of the file, with the suffix .npz.
        make: Makes the value.
    """
    if not path.is_file():
        write_value(make(), path)
    return read_value(kind, path)


def write_value(value: object, path: Path) -> None:
    """Write a value so that the file is whole or not there."""
    arrays: list[np.ndarray[Any, Any]] = []
    text = json.dumps(_packed(value, arrays))
    partial = path.with_name(f"{path.name}.partial")
    named: dict[str, Any] = {_TEXT: np.array(text), **{str(n): array for n, array in enumerate(arrays)}}
    with partial.open("wb") as stream:
        np.savez(stream, **named)
    os.replace(partial, path)


def read_value(kind: type[T], path: Path) -> T:
    """Return the value in a file that `write_value` wrote."""
    with np.load(path, allow_pickle=False) as stored:
        arrays = {name: stored[name] for name in stored.files if name != _TEXT}
        packed = json.loads(str(stored[_TEXT]))
    value: T = _unpacked(kind, packed, arrays)
    return value


def _packed(value: object, arrays: list[np.ndarray[Any, Any]]) -> Any:
    """Return a value for JSON; arrays are moved into a list, and their number stands for them."""
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return len(arrays) - 1
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {one.name: _packed(getattr(value, one.name), arrays) for one in dataclasses.fields(value) if one.init}
    if isinstance(value, tuple | list):
        return [_packed(item, arrays) for item in value]
    if isinstance(value, dict):
        return {str(name): _packed(item, arrays) for name, item in value.items()}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Path):
        return str(value)
    if value is None or isinstance(value, str | int | float | bool):
        return value
    raise TypeError(f"{type(value).__name__} is no plain value, dataclass or array: {value!r}.")


def _unpacked(hint: Any, packed: Any, arrays: dict[str, np.ndarray[Any, Any]]) -> Any:
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        if packed is None:
            return None
        return _unpacked(next(one for one in arguments if one is not type(None)), packed, arrays)
    if hint is np.ndarray or origin in (np.ndarray, npt.NDArray):  # NDArray is an alias of its own since NumPy 2.5
        return arrays[str(packed)]
    if dataclasses.is_dataclass(hint):
        hints = typing.get_type_hints(hint)
        values = {name: _unpacked(hints[name], item, arrays) for name, item in packed.items()}
        return hint(**values)  # type: ignore[operator]  # mypy takes it for an instance
    if origin is tuple:
        is_open = len(arguments) == 2 and arguments[1] is Ellipsis
        hints_of_items = [arguments[0]] * len(packed) if is_open else arguments
        return tuple(_unpacked(one, item, arrays) for one, item in zip(hints_of_items, packed, strict=True))
    if origin is list:
        return [_unpacked(arguments[0], item, arrays) for item in packed]
    if origin is dict:
        return {name: _unpacked(arguments[1], item, arrays) for name, item in packed.items()}
    return Path(packed) if hint is Path else packed
