"""The user's own files that an evaluation rests on, beside scenarios, vehicles and policies' files: code and ranges."""

from __future__ import annotations

import ast
import importlib.util
import sys
from collections.abc import Iterable, Iterator, Sequence
from importlib.machinery import PathFinder
from pathlib import Path

from aquanav_tools.errors import InputError
from aquanav_tools.provenance import file_hash
from aquanav_tools.registry import import_module, is_library, is_own, named_part
from aquanav_tools.sim.randomisation import read_randomisation
from aquanav_tools.task import TaskOptions, choices_of, named_code

RANGES = ".toml"
OwnFiles = dict[str, dict[str, str]]
"""SHA-256 of each module or file, by its name, of each thing that options name."""


def own_files(
    options: TaskOptions, observation: str | None, randomisations: Iterable[str | None] = (), policy: str = ""
) -> OwnFiles:
    """Return what options name of the user's own, each with the files that it is made of.

    Of code these are its module and all modules that this imports, directly or not, but for libraries'.

    Args:
        options: Of the task.
        observation: What is observed: only module:Name is code.
        randomisations: Further ranges of dynamics, beside the options'.
        policy: Likewise: only module:function is code.

    Raises:
        InputError: a module cannot be imported, or there is no such file of ranges.
    """
    named = [named_part(text)[1] for text in (*named_code(choices_of(options)), observation or "", policy)]
    found = {spec: dict(sorted(_sources(spec.split(":")[0]).items())) for spec in named if is_own(spec)}
    for ranges in dict.fromkeys((options.randomisation, *randomisations)):
        if ranges is not None and ranges.endswith(RANGES):
            read_randomisation(ranges)
            found[ranges] = {ranges: file_hash(Path(ranges))}
    return dict(sorted(found.items()))


def names_code(files: OwnFiles) -> bool:
    """Return whether there is code among the files, which results and protocols run with --trust only."""
    return any(is_own(name) for name in files)


def seals(files: OwnFiles) -> dict[str, str | None]:
    """Return the hash of each file, by what names it."""
    return {f"{name} ({part})": sha256 for name, parts in files.items() for part, sha256 in parts.items()}


def different_files(before: OwnFiles, now: OwnFiles) -> list[str]:
    """Return what names files that are others than before."""
    return sorted(name for name in {*before, *now} if before.get(name) != now.get(name))


def check_own_files(before: OwnFiles, now: OwnFiles) -> None:
    """Check that files are those with which an evaluation was made.

    Raises:
        InputError: some are others; the message has their hashes.
    """
    for name in different_files(before, now):
        one, two = before.get(name, {}), now.get(name, {})
        parts = [part for part in sorted({*one, *two}) if one.get(part) != two.get(part)]
        told = "; ".join(f"{part}: {_short(two.get(part))} instead of {_short(one.get(part))}" for part in parts)
        raise InputError(
            f"{name} is not what was evaluated (SHA-256 of {told}). Go back to the files of then, or evaluate anew."
        )


def _short(sha256: str | None) -> str:
    return "none" if sha256 is None else sha256[:12]


def _sources(name: str) -> dict[str, str]:
    """Return the hashes of a module's file and of those that it imports, by the modules' names."""
    import_module(name)
    found: dict[str, str] = {}
    waiting = [name]
    while waiting:
        module = waiting.pop()
        path = None if module in found else _file_of(module)
        if path is None or is_library(str(path)):
            continue
        found[module] = file_hash(path)
        if path.suffix == ".py":
            package = module if path.name == "__init__.py" else module.rpartition(".")[0]
            try:
                waiting += _imports(path, package)
            except (SyntaxError, ValueError, ImportError):
                continue  # it cannot be imported either: where that matters, the evaluation says so
    return found


def _file_of(module: str) -> Path | None:
    """Return the file of a module; None where it has none, or there is no such module. Nothing is imported."""
    path = getattr(sys.modules.get(module), "__file__", None)
    if path is None and module not in sys.modules:
        where: Sequence[str] | None = None
        parts = module.split(".")
        for num in range(len(parts)):
            spec = PathFinder.find_spec(".".join(parts[: num + 1]), where)
            if spec is None:
                return None
            where, path = spec.submodule_search_locations or [], spec.origin
    return Path(path) if path is not None and Path(path).is_file() else None


def _imports(path: Path, package: str) -> Iterator[str]:
    """Yield the names of modules that a source file may import, also inside functions, and of packages around them."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names: Sequence[str] = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = "." * node.level + (node.module or "")
            whole = importlib.util.resolve_name(base, package) if node.level else base
            names = [whole, *(f"{whole}.{alias.name}" for alias in node.names)]
        else:
            continue
        for name in names:
            parts = name.split(".")
            yield from (".".join(parts[: num + 1]) for num in range(len(parts)))
