"""Compile on a second core what a first build and evaluation will call, from the last function back.

numba compiles in one thread, each function when it is first called, and keeps what it made on disk, where processes
look before they compile. So another process, of low priority, goes through the list of signatures from its end: the two
meet somewhere in the middle. Results do not depend on it; a signature that is missing from the list, or is no longer
needed, costs time alone.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import logging
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from aquanav_tools.first_compilation import on_first_compilation
from aquanav_tools.machine import lower_priority, num_cores
from aquanav_tools.text_files import read_text

SIGNATURES = Path(__file__).with_name("signatures.json")
"""What building a shipped cave and scoring a policy in it compile, as `MODULE:FUNCTION` and the types of its arguments
(see `type_of`), in the order of first use; `.ci/make_signatures.py` writes it."""
_log = logging.getLogger(__name__)


@contextlib.contextmanager
def compiling_on_second_core() -> Iterator[None]:
    """Start the other process once numba compiles a function of ours while the body runs, and end it with the body."""
    started: list[subprocess.Popen[bytes]] = []

    def start() -> None:
        command = [sys.executable, "-m", __name__]
        nowhere = subprocess.DEVNULL
        started.append(subprocess.Popen(command, stdin=nowhere, stdout=nowhere, stderr=nowhere))

    with on_first_compilation(start if num_cores() > 1 else None):
        try:
            yield
        finally:
            for child in started:
                if child.poll():
                    _log.warning("Compiling ahead failed with %d; what is needed was compiled here.", child.returncode)
                child.kill()
                child.wait()


def read_signatures() -> list[tuple[str, list[Any]]]:
    """Return functions and the types of their arguments, in the order of first use."""
    return [(function, kinds) for function, kinds in json.loads(read_text(SIGNATURES))]


def named(text: str) -> Any:
    """Return the function or class that `MODULE:NAME` stands for."""
    module, _, name = text.partition(":")
    return getattr(importlib.import_module(module), name)


def type_of(kind: Any) -> Any:
    """Return the type of numba for the name of a scalar's, or for a list.

    Lists are array (of, axes, layout, whether it may only be read), tuple (of each), named (class, of each) and omitted
    (the value by default).
    """
    from numba import types

    if isinstance(kind, str):
        return getattr(types, kind)
    what, *rest = kind
    if what == "array":
        of, num_axes, layout, is_readonly = rest
        return types.Array(type_of(of), num_axes, layout, readonly=is_readonly)
    if what == "omitted":
        return types.Omitted(rest[0])
    if what == "named":
        return types.BaseTuple.from_types([type_of(one) for one in rest[1:]], named(rest[0]))
    return types.BaseTuple.from_types([type_of(one) for one in rest])


def compile_listed() -> None:
    """Compile what is listed into the cache, the last first."""
    for function, kinds in reversed(read_signatures()):
        named(function).compile(tuple(map(type_of, kinds)))


if __name__ == "__main__":
    lower_priority(10)
    compile_listed()
