"""What a result rests on, as hashes: files, settings, and the code that made it with the libraries it uses."""

from __future__ import annotations

import ast
import dataclasses
import functools
import hashlib
import json
import sys
from pathlib import Path

import numpy as np

from aquanav_tools.libraries import installed_version

_PACKAGE = Path(__file__).resolve().parent
_DISTRIBUTIONS = {
    "PIL": "pillow",
    "cv2": "opencv-python-headless",
    "fcl": "python-fcl",
    "igl": "libigl",
    "pi_heif": "pi-heif",
    "rerun": "rerun-sdk",
    "skimage": "scikit-image",
}
"""Packages whose modules have another name."""


def file_hash(path: Path) -> str:
    """Return the SHA-256 of a file as hex digits; a file that one process asks for twice is read once."""
    status = path.stat()
    return _file_hash(path.resolve(), status.st_size, status.st_mtime_ns)


@functools.cache
def _file_hash(path: Path, size: int, changed_ns: int) -> str:
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        while block := stream.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()


def digest(*values: object) -> str:
    """Return a hash of plain values, dataclasses and arrays: 16 hex digits."""
    text = json.dumps(values, default=_plain, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def _plain(value: object) -> object:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {field.name: getattr(value, field.name) for field in dataclasses.fields(value)}
    if isinstance(value, np.ndarray):
        return [value.shape, str(value.dtype), hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()]
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} is no plain value, dataclass, array or path: {value!r}.")


@functools.cache
def code_digest(module: str) -> str:
    """Return a hash of a module of this package, of those it imports, and of the versions of libraries they use.

    Imports inside functions count too. A change of code or of a library then makes results anew, and nobody has to
    remember to raise a number. The package's front counts by its own text, for its version, and not with what it offers
    to others: that is nearly all code.
    """
    sources: dict[str, str] = {}
    libraries: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in sources:
            continue
        path = _source_of(name)
        if path is None:
            raise ValueError(f"{name} is no module of {_PACKAGE.name}.")
        sources[name] = file_hash(path)
        own, foreign = _imports(path)
        waiting += own if name != _PACKAGE.name else ()
        libraries |= foreign
    return digest(sources, {name: installed_version(_DISTRIBUTIONS.get(name, name)) for name in libraries})


@functools.cache
def _imports(path: Path) -> tuple[frozenset[str], frozenset[str]]:
    """Return the modules of this package and the libraries that a source file imports."""
    own, foreign = set(), set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            # `from package import thing`: the thing may be a module of its own.
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        else:
            continue
        for name in names:
            top = name.split(".")[0]
            if top == _PACKAGE.name:
                own.add(name if _source_of(name) else name.rpartition(".")[0])
            elif top not in sys.stdlib_module_names:
                foreign.add(top)
    return frozenset(own), frozenset(foreign)


def _source_of(module: str) -> Path | None:
    """Return the file of a module of this package; None where there is none of that name."""
    place = _PACKAGE.joinpath(*module.split(".")[1:])
    candidates = [place.with_name(f"{place.name}.py"), place / "__init__.py"]
    return next((path for path in candidates if path.is_file()), None)
