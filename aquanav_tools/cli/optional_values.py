"""Options that may be left out, read like those that may not: `--rig a b` is told that it lacks a number.

tyro tries the kinds of a union one after the other, and for `X | None` tells what is wrong with each of both, None
first, in words for programmers and with its own markup in them.
"""

from __future__ import annotations

import dataclasses
import types
from typing import Any, Union, get_args, get_origin

from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    UnsupportedTypeAnnotationError,
)

NONE = "None"
"""What takes back a value that a recipe or a protocol gives."""


def optional_values() -> ConstructorRegistry:
    """Return the rule, to be active while a command line is parsed."""
    registry = ConstructorRegistry()
    registry.primitive_rule(_read_optional)
    return registry


def _read_optional(
    info: PrimitiveTypeInfo,
) -> PrimitiveConstructorSpec[Any] | UnsupportedTypeAnnotationError | None:
    """Return how `X | None` is read; None for other types, which tyro reads by its own rules."""
    kinds = [kind for kind in get_args(info.type) if kind is not type(None)]
    if get_origin(info.type) not in (Union, types.UnionType) or len(kinds) != 1:
        return None
    spec = ConstructorRegistry.get_primitive_spec(PrimitiveTypeInfo.make(kinds[0], info.markers))
    if not isinstance(spec, PrimitiveConstructorSpec):
        return spec

    return dataclasses.replace(
        spec,
        instance_from_str=lambda words: None if words == [NONE] else spec.instance_from_str(words),
        is_instance=lambda value: True if value is None else spec.is_instance(value),
        str_from_instance=lambda value: [NONE] if value is None else spec.str_from_instance(value),
        choices=None if spec.choices is None else (*spec.choices, NONE),
    )
