"""Functions of a package that are loaded when they are first asked for: importing the package takes no time."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from types import ModuleType
from typing import Any

_OFFERED = "__offered__"
"""Name under which a package keeps where its functions are."""


class _Package(ModuleType):
    """A package with functions. Python sets an imported subpackage as its attribute; a function of that name stays."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (name in self.__dict__[_OFFERED] and isinstance(value, ModuleType)):
            super().__setattr__(name, value)

    def __getattr__(self, name: str) -> Any:
        if name not in self.__dict__[_OFFERED]:
            raise AttributeError(f"module {self.__name__!r} has no attribute {name!r}")
        return getattr(importlib.import_module(self.__dict__[_OFFERED][name]), name)

    def __dir__(self) -> list[str]:
        return sorted({*self.__dict__, *self.__dict__[_OFFERED]})


def offer_functions(package: str, modules: Mapping[str, str]) -> None:
    """Make functions attributes of a package.

    Args:
        package: its `__name__`.
        modules: for the name of each function the module that defines it.
    """
    module = sys.modules[package]
    module.__dict__[_OFFERED] = dict(modules)
    module.__class__ = _Package
