"""Imports run one way through the rooms, heavy libraries have one room each, and commands start without them."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY
from tests.project import command_modules

PACKAGE = "aquanav_tools"

ROOMS_BELOW = {
    "geometry": set(),
    "cave": {"geometry"},
    "survey": {"geometry", "cave"},
    "synthetic": {"geometry", "cave"},
    "photograph": {"geometry", "synthetic"},
    "reconstruct": {"cave", "survey"},
    "scenario": {"geometry", "cave", "synthetic", "sea"},
    "sea": set(),
    "sim": {"geometry", "cave", "scenario", "sea"},
    "envs": {"geometry", "cave", "photograph", "scenario", "sea", "sim", "report"},
    "policy": set(),
    "report": {"geometry", "cave", "survey", "scenario", "sea"},
    "deploy": {"sim", "policy"},
    "workers": set(),
    "train": {"build", "cave", "scenario", "sim", "envs", "policy", "report", "evaluate", "workers"},
    "export": {"cave", "photograph", "report", "scenario", "sim"},
    "evaluate": {"geometry", "cave", "scenario", "sea", "sim", "envs", "policy", "report", "workers"},
    "build": {
        "geometry",
        "cave",
        "survey",
        "synthetic",
        "reconstruct",
        "scenario",
        "sim",
        "report",
        "workers",
    },
    "benchmark": {"scenario", "sim", "envs", "evaluate", "policy", "report", "workers", "build"},
    "api": {"envs", "evaluate", "train", "build"},
    "cli": {
        "api",
        "benchmark",
        "cave",
        "synthetic",
        "photograph",
        "reconstruct",
        "scenario",
        "sea",
        "sim",
        "envs",
        "policy",
        "report",
        "train",
        "evaluate",
        "workers",
        "build",
        "export",
    },
}
"""Which other rooms a room may import. Every room may import the modules at the package's root; they import no room."""

CAVE_BELOW = {
    "scan": set(),
    "closing": {"scan"},
    "water": set(),
    "route": {"water"},
    "centreline": {"route", "water"},
    "measure": {"route", "water"},
    "api": {"scan", "closing", "water", "route", "centreline", "measure"},
}
"""The same for what is in the room `cave`; all may import its other modules, which import none of these."""

IMPORTERS = {
    "onnx": {"evaluate/onnx_file.py", "evaluate/onnx_run.py", "train/export.py"},
    "onnxruntime": {"deploy/policy.py", "evaluate/onnx_run.py"},
    "open3d": {"libraries.py"},
    "pycolmap": {"reconstruct/"},
    "pybullet": {"sim/bullet.py"},
    "ray": {"workers/ray_cluster.py"},
    "rerun": {"report/recording/"},
    "tensorboardX": {"train/events.py"},
    "tyro": {"cli/"},
    "warp": {"sim/batch/"},
}
"""Which files, or folders where it ends in a slash, may import a library. The doctor may try them all."""
DOCTOR = "cli/doctor.py"

FRONT = "__init__.py"
"""The package itself shows what is in `api`, which it loads when it is asked for."""

HEAVY = {
    "ray", "torch", "onnx", "onnxruntime", "open3d", "pycolmap", "rerun", "pybullet", "matplotlib", "numba", "scipy",
    "tensorboardX", "warp", "numpy",
}  # fmt: skip
"""Libraries that take long to import, down to a tenth of a second for numpy."""


@dataclass(frozen=True)
class Import:
    """One imported module, as a file names it."""

    line: int
    module: str


def imports_of(source: str, package: str) -> Iterator[Import]:
    """Yield every import in a module's source, also those inside functions.

    Args:
        source: text of the module.
        package: dotted name of the package the module is in, from which relative imports count.
    """
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (Import(node.lineno, alias.name) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield from (Import(node.lineno, f"{base}.{alias.name}") for alias in node.names)


def faults_of(path: str, source: str) -> list[str]:
    """Return a sentence for every forbidden import in a module.

    Args:
        path: the module's place below the package, such as "sim/bullet.py".
        source: its text.
    """
    folders = path.split("/")[:-1]
    room = folders[0] if folders else ""
    found = imports_of(source, ".".join([PACKAGE, *folders]))
    return [
        f"{path}:{item.line} {fault}"
        for item in found
        if (fault := _arrow_fault(room, item) or _library_fault(path, item))
        if not (path == FRONT and item.module.startswith(f"{PACKAGE}.api."))
    ]


def _arrow_fault(room: str, item: Import) -> str:
    parts = item.module.split(".")
    if parts[0] != PACKAGE or len(parts) < 2 or parts[1] not in ROOMS_BELOW or parts[1] == room:
        return ""
    allowed = ROOMS_BELOW[room] if room else set()
    return "" if parts[1] in allowed else f"imports {item.module}, which {room or 'the root'} may not"


def _library_fault(path: str, item: Import) -> str:
    library = item.module.split(".")[0]
    allowed = IMPORTERS.get(library)
    if allowed is None or path == DOCTOR or any(path == a or (a.endswith("/") and path.startswith(a)) for a in allowed):
        return ""
    return f"imports {library}, which only {' and '.join(sorted(allowed))} may"


def test_every_import_follows_the_arrows() -> None:
    root = REPOSITORY / PACKAGE
    files = sorted(root.rglob("*.py"))
    faults = [fault for file in files for fault in faults_of(file.relative_to(root).as_posix(), file.read_text())]
    assert len(files) > 20
    assert not faults, "\n".join(faults)


def test_every_folder_with_code_is_a_known_room() -> None:
    rooms = {file.parent.name for file in (REPOSITORY / PACKAGE).glob("*/__init__.py")}
    assert rooms == set(ROOMS_BELOW)


def test_packages_of_the_cave_follow_their_arrows() -> None:
    root, faults = REPOSITORY / PACKAGE / "cave", []
    for file in sorted(root.rglob("*.py")):
        path = file.relative_to(root)
        inner = path.parts[0].removesuffix(".py")
        allowed = {*CAVE_BELOW.get(inner, set()), inner, *({"api"} if path.name == FRONT else set())}
        for item in imports_of(file.read_text(), ".".join([PACKAGE, "cave", *path.parts[:-1]])):
            parts = item.module.split(".")
            if parts[:2] == [PACKAGE, "cave"] and parts[2] in set(CAVE_BELOW) - allowed:
                faults.append(f"cave/{path}:{item.line} imports {item.module}, which {inner} may not")
    packages = {folder.parent.name for folder in root.glob("*/__init__.py")}
    assert packages | {"api"} == set(CAVE_BELOW)
    assert not faults, "\n".join(faults)


@pytest.mark.parametrize("table", [ROOMS_BELOW, CAVE_BELOW], ids=["rooms", "cave"])
def test_the_arrows_have_no_circle(table: dict[str, set[str]]) -> None:
    below = {room: set(rooms) for room, rooms in table.items()}
    while below:
        ground = {room for room, rooms in below.items() if not rooms}
        assert ground, f"each of these rests on another of them: {sorted(below)}"
        below = {room: rooms - ground for room, rooms in below.items() if room not in ground}


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("geometry/volume/field.py", "import aquanav_tools.scenario.schema"),
        ("geometry/mesh/welding.py", "from aquanav_tools.cave.cavity import Cavity"),
        ("cave/water/flow.py", "from aquanav_tools import sim"),
        ("scenario/folder.py", "def read():\n    from aquanav_tools.build.recipe import run"),
        ("sim/bullet.py", "from ..envs import task"),
        ("evaluate/rollout.py", "from aquanav_tools.cli.command import run_command"),
        ("types.py", "from aquanav_tools.geometry.volume.field import DistanceField"),
        ("envs/cave_env.py", "import pybullet as p"),
        ("geometry/mesh.py", "def read():\n    import open3d.io"),
        ("build/photos.py", "from pycolmap import Reconstruction"),
        ("report/html.py", "import rerun"),
        ("evaluate/options.py", "import tyro"),
        ("api/scores.py", "from aquanav_tools.cli.command import run_command"),
        ("envs/vector_env.py", "import warp as wp"),
    ],
)
def test_the_check_catches_a_forbidden_import(path: str, source: str) -> None:
    assert len(faults_of(path, source)) == 1


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("geometry/volume/field.py", "import numpy\nfrom aquanav_tools.errors import MeshError\nfrom . import guide"),
        ("build/recipe.py", "from aquanav_tools.reconstruct.images import read_photos"),
        ("reconstruct/mapping.py", "import pycolmap"),
        ("sim/bullet.py", "import pybullet\nimport pybullet_data"),
        ("cli/doctor.py", "import pybullet, rerun, pycolmap"),
    ],
)
def test_the_check_lets_allowed_imports_pass(path: str, source: str) -> None:
    assert faults_of(path, source) == []


@pytest.mark.parametrize("module", command_modules())
def test_a_command_starts_without_heavy_libraries(module: str, tmp_path: Path) -> None:
    code = f"import sys, {module}; print(*sorted(set({sorted(HEAVY)}) & sys.modules.keys()))"
    done = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == []
