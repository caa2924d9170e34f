"""Reading Gymnasium spaces from the readable fields that Stable-Baselines3 writes beside its pickles."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces

from aquanav_tools.errors import InputError

MAX_SIZE = 100_000
MAX_PARTS = 100
PART_TYPES = ("float32", "float64", "uint8", "int32", "int64")
NUMBER = re.compile(r"[-+]?\d+")
PART = re.compile(
    r"""(?P<name>'(?:[^'\\\n]|\\.){0,200}'|"(?:[^"\\\n]|\\.){0,200}"):[ ]
    Box\([^()]*,\s\((?P<shape>\d+(?:,\s\d+){0,3}),?\),\s(?P<dtype>\w+)\)(?:,\s|$)""",
    re.VERBOSE,
)
"""One part of a `Dict`, as Gymnasium writes it as text."""


def parse_space(entry: Any, name: str) -> spaces.Space[Any]:
    """Return the space described by one entry of an SB3 zip's settings, with unit bounds where it is a Box.

    Bounds do not matter to a network of weights; numpy shortens them in long texts, so they are not read.

    Raises:
        InputError: it is neither a flat Box nor Discrete nor MultiDiscrete nor a Dict of Boxes, or its fields make no
            sense.
    """
    try:
        kind = str(entry[":type:"]).removesuffix("'>").rsplit(".", 1)[-1]
        if kind == "Box":
            (size,) = entry["_shape"]
            return spaces.Box(-1.0, 1.0, (_count(size),))
        if kind == "Discrete":
            return spaces.Discrete(_count(entry["n"]))
        if kind == "MultiDiscrete":
            return spaces.MultiDiscrete([_count(n) for n in NUMBER.findall(entry["nvec"])])
        if kind == "Dict":
            return _parse_parts(entry["spaces"])
    except (KeyError, TypeError, ValueError) as cause:
        raise InputError(
            f"The policy's {name} cannot be read from its zip ({cause!r}). An unknown version of Stable-Baselines3 "
            "wrote it. Save it again with version 2.x."
        ) from cause
    raise InputError(
        f"The policy's {name} is a {kind}; a flat Box, a Dict of Boxes, Discrete or MultiDiscrete is needed. It was "
        "trained for another task. Train one here with aquanav-train."
    )


def _parse_parts(text: str) -> spaces.Dict:
    """Return the parts that a text names, "{'imu': Box(-1.0, 1.0, (6,), float32), ...}", in its order."""
    rest, place = text.removeprefix("{").removesuffix("}"), 0
    parts: dict[str, spaces.Space[Any]] = {}
    while place < len(rest):
        found = PART.match(rest, place)
        if found is None or len(parts) == MAX_PARTS:
            raise ValueError(f"no part of numbers is at '{rest[place : place + 60]}'")
        shape = tuple(_count(size) for size in found["shape"].split(","))
        if found["dtype"] not in PART_TYPES or math.prod(shape) > MAX_SIZE:
            raise ValueError(f"the part {found['name']} is of {found['dtype']} and shape {shape}")
        parts[ast.literal_eval(found["name"])] = spaces.Box(0, 1, shape, np.dtype(found["dtype"]).type)
        place = found.end()
    if not parts:
        raise ValueError("it has no parts")
    return spaces.Dict(list(parts.items()))


def is_same_space(first: spaces.Space[Any], second: spaces.Space[Any]) -> bool:
    """Return whether a network for one space fits the other: same kind, same shape, same counts."""
    if isinstance(first, spaces.Box) and isinstance(second, spaces.Box):
        return first.shape == second.shape
    return first == second


def describe_space(space: spaces.Space[Any]) -> str:
    """Return the space in a few words for a message."""
    if isinstance(space, spaces.Box):
        return f"Box of {' x '.join(map(str, space.shape))} values"
    if isinstance(space, spaces.Dict):
        return f"dictionary of {describe_parts(shapes_of(space))}"
    if isinstance(space, spaces.MultiDiscrete):
        return f"MultiDiscrete({space.nvec.tolist()})"
    return str(space)


def shapes_of(space: spaces.Dict) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the parts of a Dict of Boxes, by name, in their order."""
    return {name: tuple(part.shape or ()) for name, part in space.spaces.items()}


def describe_parts(shapes: Mapping[str, tuple[int, ...]]) -> str:
    """Return parts with their sizes in a few words for a message."""
    return ", ".join(f"'{name}' ({' x '.join(map(str, shape))})" for name, shape in shapes.items())


def _count(value: Any) -> int:
    count = int(value)
    if not 1 <= count <= MAX_SIZE:
        raise ValueError(f"{count} is outside [1, {MAX_SIZE}]")
    return count
