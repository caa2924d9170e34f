"""Reading Gymnasium spaces from the readable fields that Stable-Baselines3 writes beside its pickles."""

from __future__ import annotations

import re
from typing import Any

from gymnasium import spaces

from aquanav_tools.errors import InputError

MAX_SIZE = 100_000
NUMBER = re.compile(r"[-+]?\d+")


def parse_space(entry: Any, name: str) -> spaces.Space[Any]:
    """Return the space described by one entry of an SB3 zip's settings, with unit bounds where it is a Box.

    Bounds do not matter to a network of weights; numpy shortens them in long texts, so they are not read.

    Raises:
        InputError: it is neither a flat Box nor Discrete nor MultiDiscrete, or its fields make no sense.
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
    except (KeyError, TypeError, ValueError) as cause:
        raise InputError(
            f"The policy's {name} cannot be read from its zip ({cause!r}). An unknown version of Stable-Baselines3 "
            "wrote it. Save it again with version 2.x."
        ) from cause
    raise InputError(
        f"The policy's {name} is a {kind}; a flat Box, Discrete or MultiDiscrete is needed. It was trained for another "
        "task. Train one here with aquanav-train."
    )


def is_same_space(first: spaces.Space[Any], second: spaces.Space[Any]) -> bool:
    """Return whether a network for one space fits the other: same kind, same shape, same counts."""
    if isinstance(first, spaces.Box) and isinstance(second, spaces.Box):
        return first.shape == second.shape
    return first == second


def describe_space(space: spaces.Space[Any]) -> str:
    """Return the space in a few words for a message."""
    if isinstance(space, spaces.Box):
        return f"Box of {' x '.join(map(str, space.shape))} values"
    if isinstance(space, spaces.MultiDiscrete):
        return f"MultiDiscrete({space.nvec.tolist()})"
    return str(space)


def _count(value: Any) -> int:
    count = int(value)
    if not 1 <= count <= MAX_SIZE:
        raise ValueError(f"{count} is outside [1, {MAX_SIZE}]")
    return count
