"""What pyproject.toml declares."""

from __future__ import annotations

import sys
from typing import Any

from tests.conftest import REPOSITORY

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def pyproject() -> dict[str, Any]:
    """The tables of pyproject.toml."""
    return tomllib.loads((REPOSITORY / "pyproject.toml").read_text())


def commands() -> dict[str, str]:
    """Each command and the function behind it, as "module:function"."""
    scripts: dict[str, str] = pyproject()["project"]["scripts"]
    return scripts


def command_modules() -> list[str]:
    """The modules of the commands."""
    return sorted({target.split(":")[0] for target in commands().values()})
