"""The repository keeps its own promises: one configuration, pinned dependencies, small files, commands that exist."""

from __future__ import annotations

import ast
import importlib
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from tests.conftest import REPOSITORY
from tests.project import commands, pyproject

MAX_FILE_LINES = 400
MAX_FUNCTION_LINES = 50
"""Without the docstring."""
SOURCES = sorted((REPOSITORY / "aquanav_tools").rglob("*.py"))
PYTHONS = ("3.10", "3.11", "3.12", "3.13", "3.14")
PACKAGE_OF = {
    "PIL": "pillow",
    "collada": "pycollada",
    "cv2": "opencv-python-headless",
    "fcl": "python-fcl",
    "google": "protobuf",
    "igl": "libigl",
    "pxr": "usd-core",
    "rerun": "rerun-sdk",
    "skimage": "scikit-image",
    "warp": "warp-lang",
}
"""Packages whose modules have another name."""


def pins(python: str) -> dict[str, str]:
    """Return the version pinned for each package under a version of Python."""
    lines = (REPOSITORY / "constraints.txt").read_text().splitlines()
    found = [Requirement(line) for line in lines if line and not line.startswith("#")]
    active = [pin for pin in found if pin.marker is None or pin.marker.evaluate({"python_version": python})]
    names = [canonicalize_name(pin.name) for pin in active]
    assert len(names) == len(set(names)), "a package is pinned twice"
    return {name: str(pin.specifier) for name, pin in zip(names, active, strict=True)}


def requirements(python: str) -> list[Requirement]:
    """Return what pyproject.toml asks for, to build, run and develop, under a version of Python."""
    tables = pyproject()
    project = tables["project"]
    extras = project["optional-dependencies"]
    texts = project["dependencies"] + extras["dev"] + extras["all"] + tables["build-system"]["requires"]
    found = list(without_own_extras(texts))
    return [need for need in found if need.marker is None or need.marker.evaluate({"python_version": python})]


def without_own_extras(texts: list[str]) -> Iterator[Requirement]:
    """Yield requirements with what stands behind aquanav[...]."""
    for need in map(Requirement, texts):
        if need.name != "aquanav":
            yield need
        for extra in sorted(need.extras) if need.name == "aquanav" else ():
            yield from without_own_extras(pyproject()["project"]["optional-dependencies"][extra])


@pytest.mark.parametrize("python", PYTHONS)
def test_every_dependency_is_pinned_to_a_version_that_is_allowed(python: str) -> None:
    pinned = pins(python)
    for need in requirements(python):
        pin = pinned[canonicalize_name(need.name)]
        assert re.fullmatch(r"==[0-9][0-9a-z.]*", pin), f"{need.name}{pin} is no exact version"
        assert need.specifier.contains(pin.removeprefix("==")), f"{need} does not allow {pin}"


def test_what_is_imported_is_what_is_required() -> None:
    modules = (
        {module for path in SOURCES for module in _imported(path)} - set(sys.stdlib_module_names) - {"aquanav_tools"}
    )
    imported = {canonicalize_name(PACKAGE_OF.get(module, module)) for module in modules - {"tomllib"}}
    project = pyproject()["project"]
    everything = without_own_extras(project["dependencies"] + project["optional-dependencies"]["all"])
    required = {canonicalize_name(need.name) for need in everything} - {"tensorboard"}  # a command, nothing to import
    assert imported == required


def _imported(path: Path) -> set[str]:
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split(".")[0])
    return names


def test_torch_is_pinned_so_that_the_cpu_build_satisfies_the_pin() -> None:
    assert Requirement("torch" + pins("3.11")["torch"]).specifier.contains("2.13.0+cpu")


def test_pyproject_is_the_only_configuration() -> None:
    others = (
        "setup.py",
        "setup.cfg",
        "tox.ini",
        "pytest.ini",
        "ruff.toml",
        ".ruff.toml",
        "mypy.ini",
        ".flake8",
        ".coveragerc",
    )
    assert [name for name in others if (REPOSITORY / name).exists()] == []


def test_every_file_is_short() -> None:
    lengths = {str(path.relative_to(REPOSITORY)): len(path.read_text().splitlines()) for path in SOURCES}
    assert {path: lines for path, lines in lengths.items() if lines > MAX_FILE_LINES} == {}


def test_every_function_is_short() -> None:
    long = {
        f"{path.relative_to(REPOSITORY)}:{name}": lines for path in SOURCES for name, lines in _long_functions(path)
    }
    assert long == {}


def _long_functions(path: Path) -> list[tuple[str, int]]:
    functions = [node for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.FunctionDef)]
    lengths = [(function.name, _code_lines(function)) for function in functions]
    return [(name, lines) for name, lines in lengths if lines > MAX_FUNCTION_LINES]


def _code_lines(function: ast.FunctionDef) -> int:
    has_docstring = ast.get_docstring(function) is not None
    documented = (function.body[0].end_lineno or 0) - function.body[0].lineno + 1 if has_docstring else 0
    return (function.end_lineno or 0) - function.lineno + 1 - documented


@pytest.mark.parametrize("target", sorted(commands().values()))
def test_every_command_leads_to_a_function(target: str) -> None:
    module, function = target.split(":")
    assert callable(getattr(importlib.import_module(module), function))


def test_the_wheel_carries_the_content_under_the_names_that_the_code_looks_for() -> None:
    carried = pyproject()["tool"]["hatch"]["build"]["targets"]["wheel"]["force-include"]
    folders = ("pipelines", "scenarios", "eval/protocols", "eval/policies", "eval/sets")
    assert carried == {name: f"aquanav_tools/content/{name}" for name in folders}
