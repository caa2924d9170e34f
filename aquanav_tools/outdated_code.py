"""Forgetting compiled code whose source has changed in another file than its own, which numba does not see.

Numba compiles what a function calls, and constants that it names, into the function itself, and keeps that for as long
as the function's own file is the same: after an update the old code would go on.

Whole files are compared, as read: what a build rests on name by name (`provenance.py`) takes a second to find, and this
is done whenever numba is imported.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
import re
from pathlib import Path

IMPORT = re.compile(r"^from ([\w.]+) import (\([^)]*\)|[^\n]*)", re.MULTILINE)
CONSTANT = re.compile(r"\b[A-Z][A-Z0-9_]+\b")
COMPILED = "@numba."
MARK = "{stem}.callees"
"""File beside a module's compiled code: a hash of the other files that are in it."""


def forget_outdated(package: Path) -> None:
    """Delete numba's compiled code of each module of a package that holds older code of the package's other modules.

    Where the folder cannot be written to, nothing there can have been compiled by this user.

    Args:
        package: Its folder, by whose name its modules import each other.
    """
    for file in sorted(package.rglob("*.py")):
        source = _text(file)
        if COMPILED in source and (callees := _callees(package, file)):
            digest = hashlib.sha256("\0".join(_text(callee) for callee in sorted(callees)).encode()).hexdigest()
            with contextlib.suppress(OSError):
                _forget(_cache_path(file), file.stem, digest)
    _text.cache_clear()


def _forget(folder: Path, stem: str, digest: str) -> None:
    mark = folder / MARK.format(stem=stem)
    if mark.is_file() and mark.read_text(encoding="utf-8") == digest:
        return
    for index in folder.glob(f"{stem}.*.nbi"):
        index.unlink(missing_ok=True)
    unfinished = folder / f"{mark.name}.{os.getpid()}"
    unfinished.write_text(digest, encoding="utf-8")
    unfinished.replace(mark)


def _cache_path(file: Path) -> Path:
    """Return the folder where numba keeps what it compiles of a file."""
    from numba.core.caching import CacheImpl

    for locator_class in CacheImpl._locator_classes:
        if (locator := locator_class.from_function(_cache_path, str(file))) is not None:
            return Path(locator.get_cache_path())
    raise OSError(f"There is no place for what is compiled of {file}.")


def _callees(package: Path, file: Path) -> set[Path]:
    """Return the other modules whose code or constants are compiled into a module's functions."""
    found: set[Path] = set()
    ahead = [file]
    while ahead:
        for callee in _imported(package, ahead.pop()) - found:
            found.add(callee)
            if COMPILED in _text(callee):
                ahead.append(callee)
    return found - {file}


def _imported(package: Path, file: Path) -> set[Path]:
    """Return the package's modules from which a module has compiled functions or constants."""
    found: set[Path] = set()
    for module, names in IMPORT.findall(_text(file)):
        first, *parts = module.split(".")
        if first != package.name:
            continue
        place = package.joinpath(*parts)
        modules = [place / f"{name}.py" for name in re.findall(r"\w+", names)]
        found.update(path for path in modules if path.is_file())
        source = place.with_suffix(".py")
        if source.is_file() and (CONSTANT.search(names) or COMPILED in _text(source)):
            found.add(source)
    return found


@functools.cache
def _text(file: Path) -> str:
    return file.read_text(encoding="utf-8")
