"""Definitions by name: those that come with aquanav, and the user's own code as module:Name.

Code of the user's own is imported only where the user's own call, command line or pipeline names it. What a file says
that came from elsewhere (results, a policy's zip, a scenario, a protocol) is refused by `refuse_recorded`.
"""

from __future__ import annotations

import importlib
import re
import sys
import sysconfig
import traceback
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import aquanav_tools
from aquanav_tools.errors import InputError, did_you_mean

OWN = re.compile(r"([A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*):([A-Za-z_]\w*)")
"""module:Name."""
NAME_OF_PART = "="
"""Ends the name that a part of an observation is given: "front=fan"."""
_ADDRESS = re.compile(r" at 0x[0-9a-f]+")
"""In texts of objects; it changes from run to run."""
_MAX_ERROR = 500
"""Characters kept of an error's text."""
_LIBRARIES = (
    str(Path(aquanav_tools.__file__).parent),
    *(sysconfig.get_paths()[name] for name in ("stdlib", "purelib", "platlib")),
)
"""Folders of code that is not the user's own."""


@dataclass(frozen=True)
class Registry:
    """The definitions of one kind."""

    kind: str
    """As messages call it: "reward"."""
    built_in: Mapping[str, Any]
    """Those that come with aquanav, by name."""

    def find(self, name: str) -> Any:
        """Return what a name means: what is built in, or the user's own, as `import_own` returns it.

        Raises:
            InputError: there is none of the name (the nearest is named), or the user's own cannot be had.
        """
        if is_own(name):
            return import_own(name, self.kind)
        if name not in self.built_in:
            near = did_you_mean(name, self.built_in) if self.built_in else " None comes with aquanav."
            raise InputError(f"There is no {self.kind} '{name}'.{near} Code of your own is named as module:Name.")
        return self.built_in[name]


def is_own(name: object) -> bool:
    """Return whether a name means code of the user's own."""
    return isinstance(name, str) and OWN.fullmatch(name) is not None


def named_part(text: str) -> tuple[str, str]:
    """Return the name of an observation's part and what it is, of "front=fan"; of "fan" alone both are that."""
    name, mark, part = text.partition(NAME_OF_PART)
    return (name, part) if mark else (text, text)


def import_own(spec: str, kind: str) -> Any:
    """Return what module:Name means, the working directory first; of a class an instance, made without arguments.

    Raises:
        InputError: the module cannot be imported, it has no such name (the nearest is named), or making the instance
            failed.
    """
    module_name, name = spec.split(":")
    module = import_module(module_name)
    if not hasattr(module, name):
        raise InputError(f"The module {module_name} has no {name}.{did_you_mean(name, _callables(module))}")
    found = getattr(module, name)
    return _made(found, spec, kind) if isinstance(found, type) else found


def module_file(spec: str) -> Path | None:
    """Return the file of the module in module:Name, which has been imported; None where it has none."""
    path = getattr(sys.modules[spec.split(":")[0]], "__file__", None)
    return Path(path) if path else None


def is_library(path: str) -> bool:
    """Return whether a file holds code that is not the user's own."""
    return path.startswith(("<", *_LIBRARIES))


def refuse_recorded(names: Iterable[object], where: str, advice: str) -> None:
    """Refuse code that a file names which may come from anyone.

    Args:
        names: What the file names; only module:Name is code.
        where: What the message calls the file.
        advice: How the user allows it.

    Raises:
        InputError: there is such a name.
    """
    own = [str(name) for name in names if is_own(named_part(str(name))[1])]
    if own:
        raise InputError(
            f"{where} names code: {', '.join(own)}. A file runs none by itself, as anyone may have written it. {advice}"
        )


def error_text(error: BaseException) -> str:
    """Return an error in a line, with the last line of the user's own code on the way to it: " (own.py, line 7)"."""
    text = _ADDRESS.sub("", f"{type(error).__name__}: {error}").strip()[:_MAX_ERROR]
    frames = [frame for frame in traceback.extract_tb(error.__traceback__) if not is_library(frame.filename)]
    return text + (f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else "")


def import_module(name: str) -> Any:
    """Return a module of the user's own, the working directory first.

    Raises:
        InputError: it cannot be imported.
    """
    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))  # a command's own path begins with its folder instead
    try:
        return importlib.import_module(name)
    except Exception as cause:  # foreign code runs here: whatever it raises is told
        raise InputError(
            f"The module {name} cannot be imported: {type(cause).__name__}: {cause}. It is looked for in the working "
            f"directory {Path.cwd()} and where Python finds modules. Run the command from the folder of the module."
        ) from cause


def _made(cls: type[Any], spec: str, kind: str) -> Any:
    try:
        return cls()
    except Exception as cause:  # foreign code again
        raise InputError(
            f"{spec} is a class, and making one without arguments failed: {type(cause).__name__}: {cause}. Name a "
            f"{kind} that needs no arguments."
        ) from cause


def _callables(module: Any) -> list[str]:
    return [name for name, value in vars(module).items() if callable(value) and not name.startswith("_")]
