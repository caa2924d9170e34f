"""What a result rests on, as hashes: files, settings, and the code that made it with the libraries it uses."""

from __future__ import annotations

import ast
import contextlib
import dataclasses
import functools
import hashlib
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from aquanav_tools.libraries import installed_version
from aquanav_tools.machine import cache_folder

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
AT_IMPORT = ""
"""Stands for what a module does when it is imported, apart from defining things."""
KEYS_FILE = "code-keys.json"
"""In the cache: which hash the code of each stage has, of the package that was used last."""
HERE = "<here>"
"""Stands, in front of a name, for the module that is looked at."""


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
def code_digest(*roots: str | Callable[..., object]) -> str:
    """Return a hash of the code that some functions really use, and of the versions of libraries that this code uses.

    What counts are functions, classes and constants of this package that are reached by name from the roots, in
    whatever module they are, without comments and docstrings; not the modules as a whole. So a change of code or of a
    library makes results anew that rest on it, and no others, and nobody has to remember to raise a number. What is
    found at run time alone, as by `importlib` with a computed name, is not seen.

    Args:
        roots: Functions or classes, or their names as "package.module:name"; "package.module" is all in a module.

    Raises:
        ValueError: there is no such module of this package, or no such name in it.
    """
    used, libraries = _used_digest([_name(root) for root in roots])
    return digest(used, {name: installed_version(_DISTRIBUTIONS.get(name, name)) for name in libraries})


def _used_digest(names: list[str]) -> tuple[str, list[str]]:
    """Return a hash of the code that some roots use, and the libraries.

    Following the code takes a second: what came of it is kept for all processes until a file of the package changes.
    """
    key, package = " ".join(names), _package_digest()
    folder = cache_folder()
    path = None if folder is None else folder / KEYS_FILE
    known: dict[str, tuple[str, list[str]]] = {}
    with contextlib.suppress(OSError, ValueError, AttributeError):  # nothing kept, or half of it: found anew
        known = {} if path is None else json.loads(path.read_bytes()).get(package, {})
    if key not in known:
        reached, libraries = used_code(*names)
        texts = {place: _parsed(_path_of(place[0])).text(place[1]) for place in reached}
        known[key] = digest({":".join(place): text for place, text in sorted(texts.items())}), sorted(libraries)
        if path is not None:
            _keep(json.dumps({package: known}), path)
    used, names_of_libraries = known[key]
    return used, names_of_libraries


def _package_digest() -> str:
    """Return a hash of all files of this package, and of the Python that reads them."""
    whole = hashlib.sha256(sys.version.encode())
    for path in sorted(_PACKAGE.rglob("*.py")):
        whole.update(f"\0{path.relative_to(_PACKAGE)}\0{_read_source(path)}".encode())
    return whole.hexdigest()


def _keep(text: str, path: Path) -> None:
    """Write a file as a whole, where that can be."""
    partial = path.with_name(f"{path.name}.{os.getpid()}.partial")
    with contextlib.suppress(OSError):  # a full disk, or a folder of others: the next process follows the code again
        path.parent.mkdir(parents=True, exist_ok=True)
        partial.write_text(text, encoding="utf-8")
        os.replace(partial, path)


def used_code(*roots: str | Callable[..., object]) -> tuple[set[tuple[str, str]], set[str]]:
    """Return the (module, name) of all code that some roots use, and the libraries; arguments as of `code_digest`.

    The name is empty for what a module does when it is imported, apart from defining things.
    """
    reached: set[tuple[str, str]] = set()
    libraries: set[str] = set()
    waiting = [place for root in roots for place in _places(root)]
    while waiting:
        module, name = waiting.pop()
        if (module, name) in reached:
            continue
        code = _parsed(_path_of(module))
        reached.add((module, name))
        waiting.append((module, AT_IMPORT))
        for reference in code.references(name):
            target = code.resolve(reference)
            if target is None:
                continue
            found, foreign = _follow(target)
            waiting += [(module if one == HERE else one, what) for one, what in found]
            libraries |= foreign
    return reached, libraries


def _name(root: str | Callable[..., object]) -> str:
    """Return the name of a root."""
    return root if isinstance(root, str) else f"{root.__module__}:{root.__qualname__.partition('.')[0]}"


def _places(root: str | Callable[..., object]) -> list[tuple[str, str]]:
    """Return the (module, name) of a root."""
    module, _, name = _name(root).partition(":")
    if _source_of(module) is None:
        raise ValueError(f"{module} is no module of {_PACKAGE.name}.")
    code = _parsed(_path_of(module))
    if name and name not in code.definitions:
        raise ValueError(f"{module} defines no {name}.")
    return [(module, name)] if name else [(module, one) for one in (AT_IMPORT, *code.definitions)]


def _follow(target: str) -> tuple[list[tuple[str, str]], set[str]]:
    """Return what an absolute dotted name stands for: code of this package, or a library."""
    parts = target.split(".")
    if parts[0] == HERE:
        return [(HERE, parts[1])], set()
    if parts[0] != _PACKAGE.name:
        return [], set() if parts[0] in sys.stdlib_module_names else {parts[0]}
    depth = next(n for n in range(len(parts), 0, -1) if _source_of(".".join(parts[:n])))
    module, rest = ".".join(parts[:depth]), parts[depth:]
    code = _parsed(_path_of(module))
    if rest and rest[0] in code.definitions:
        return [(module, rest[0])], set()
    if rest and rest[0] in code.imports:  # handed on
        return _follow(".".join([code.imports[rest[0]], *rest[1:]]))
    if module == _PACKAGE.name:  # what it offers to others is nearly all code
        return [(module, AT_IMPORT)], set()
    return [(module, name) for name in (AT_IMPORT, *code.definitions)], set()


class _Code:
    """What a module defines and imports at its top level."""

    def __init__(self, text: str) -> None:
        self.definitions: dict[str, list[ast.stmt]] = {AT_IMPORT: []}
        self.imports: dict[str, str] = {}
        """Absolute dotted name of what each imported name stands for."""
        self._references: dict[str, set[str]] = {}
        self._texts: dict[str, list[str]] = {}
        tree = ast.parse(text)
        _drop_docstrings(tree)
        self._take(tree.body)

    def _take(self, body: list[ast.stmt]) -> None:
        for node in body:
            if isinstance(node, ast.Import | ast.ImportFrom):
                self.imports |= _imported(node)
            elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                self.definitions.setdefault(node.name, []).append(node)
            elif isinstance(node, ast.Assign | ast.AnnAssign):
                targets = node.targets if isinstance(node, ast.Assign) else [node.target]
                names = [one.id for target in targets for one in ast.walk(target) if isinstance(one, ast.Name)]
                for name in names or [AT_IMPORT]:
                    self.definitions.setdefault(name, []).append(node)
            elif isinstance(node, ast.If | ast.Try):
                for field in ("body", "orelse", "finalbody"):
                    self._take(getattr(node, field, []))
                for handler in getattr(node, "handlers", []):
                    self._take(handler.body)
            else:
                self.definitions[AT_IMPORT].append(node)

    def references(self, name: str) -> set[str]:
        """Return the dotted names that a definition uses; those that it imports itself begin with a dot."""
        if name not in self._references:
            self._references[name] = self._find_references(name)
        return self._references[name]

    def _find_references(self, name: str) -> set[str]:
        found: set[str] = set()
        waiting: list[ast.AST] = [*self.definitions[name]]
        while waiting:
            node = waiting.pop()
            if isinstance(node, ast.Import | ast.ImportFrom):
                found |= {f".{target}" for target in _imported(node).values()}
            elif isinstance(node, ast.Attribute | ast.Name) and (dotted := _dotted(node)):
                found.add(dotted)  # of a module with an attribute, not the whole module as well
            else:
                waiting += ast.iter_child_nodes(node)
        return found

    def resolve(self, reference: str) -> str | None:
        """Return the absolute dotted name behind one of `references`; None for names that the module has not."""
        if reference.startswith("."):
            return reference[1:]
        first, _, rest = reference.partition(".")
        if first in self.imports:
            return ".".join(filter(None, [self.imports[first], rest]))
        return f"{HERE}.{first}" if first in self.definitions else None

    def text(self, name: str) -> list[str]:
        """Return a definition without comments and docstrings."""
        if name not in self._texts:
            self._texts[name] = [ast.dump(node) for node in self.definitions[name]]
        return self._texts[name]


def _imported(node: ast.Import | ast.ImportFrom) -> dict[str, str]:
    """Return the names that an import binds, and for each the absolute dotted name of what it stands for."""
    if isinstance(node, ast.Import):
        return {one.asname or one.name.split(".")[0]: one.name if one.asname else one.name.split(".")[0]
                for one in node.names}  # fmt: skip
    return {one.asname or one.name: f"{node.module}.{one.name}" for one in node.names}


def _dotted(node: ast.expr) -> str:
    """Return a name with its attributes, such as "a.b"; empty for the attributes of anything else."""
    if isinstance(node, ast.Attribute):
        inner = _dotted(node.value)
        return f"{inner}.{node.attr}" if inner else ""
    return node.id if isinstance(node, ast.Name) else ""


def _drop_docstrings(tree: ast.Module) -> None:
    """Drop texts that stand by themselves from all bodies of a module."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            body[:] = [one for one in body if not (isinstance(one, ast.Expr) and isinstance(one.value, ast.Constant))]


def _parsed(path: Path) -> _Code:
    return _parsed_text(_read_source(path))


_parsed_text = functools.cache(_Code)


@functools.cache
def _read_source(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def _path_of(module: str) -> Path:
    path = _source_of(module)
    assert path is not None, module
    return path


@functools.cache
def _source_of(module: str) -> Path | None:
    """Return the file of a module of this package; None where there is none of that name."""
    place = _PACKAGE.joinpath(*module.split(".")[1:])
    candidates = [place.with_name(f"{place.name}.py"), place / "__init__.py"]
    return next((path for path in candidates if path.is_file()), None)
