"""What each command says of itself with --help, as pages of the site."""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import get_args
from unittest import mock

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[2]
WIDTH = "88"
"""Columns of a help text: what fits beside the navigation."""
MODES = {
    "aquanav-eval": (["compare"], ["compare", "--sequential"], ["replay"], ["stress"], ["--benchmark=quick"]),
}
"""Words of a command that choose another help; those of `aquanav` are found in its options."""
ESCAPES = re.compile(r"\x1b\[[0-9;]*m")


def commands() -> str:
    """Return a section for each command."""
    return "".join(_sections())


def _sections() -> Iterator[str]:
    for command, target in _scripts().items():
        yield _section(f"{command}", help_text(target, []), 2)
        for words in _modes(command):
            title = " ".join([command, *words]).replace("=quick", "")
            yield _section(title, help_text(target, words), 3)


def _section(title: str, text: str, level: int) -> str:
    return f"\n{'#' * level} {title}\n\n```text\n{text}\n```\n"


def _scripts() -> dict[str, str]:
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    scripts: dict[str, str] = tomllib.loads(text)["project"]["scripts"]
    return scripts


def _modes(command: str) -> list[list[str]]:
    if command in MODES:
        return list(MODES[command])
    return [[name] for name in subcommands()] if command == "aquanav" else []


def subcommands() -> list[str]:
    """Return the subcommands of `aquanav` that are no commands of their own."""
    info = importlib.import_module("aquanav_tools.cli.info")
    kinds = get_args(importlib.import_module("typing").get_type_hints(info.Options, include_extras=True)["command"])
    names = [get_args(kind)[1].name for kind in kinds]
    return [name for name in names if name not in info.COMMANDS]


def help_text(target: str, words: list[str]) -> str:
    """Return what a command, as module:function, prints with --help behind some words, without colours.

    Raises:
        RuntimeError: it printed nothing, or failed.
    """
    module, function = target.split(":")
    output, code = io.StringIO(), 1
    with mock.patch.dict(os.environ, {"COLUMNS": WIDTH, "NO_COLOR": "1"}), contextlib.redirect_stdout(output):
        try:
            getattr(importlib.import_module(module), function)([*words, "--help"])
        except SystemExit as ending:
            code = int(ending.code or 0)
    text = ESCAPES.sub("", output.getvalue())
    if code or not text.strip():
        raise RuntimeError(f"{target} {' '.join(words)} --help ended with {code} and {len(text)} characters.")
    return "\n".join(line.rstrip() for line in text.strip("\n").splitlines())
