"""Write the newest versions that fit together as pins, with markers where Pythons differ, for constraints.txt.

    .venv/bin/python .ci/make_constraints.py python3.10 python3.11 python3.13 > pins.txt

takes interpreters that have pip, asks each for all that aquanav and its extras need, and installs nothing. Below the
head of constraints.txt, pins.txt takes the place of what is there. Where the index does not serve the metadata of
packages by themselves, pip downloads them whole, 3 GB with CUDA's libraries for torch: its progress is on stderr.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from packaging.utils import canonicalize_name
from packaging.version import Version

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parent.parent
COMPILED = {"bullet"}
"""Extras that are left out, as pip compiles them on some Pythons. What they need is a dependency on the others."""
OF_CUDA = ("cuda-", "nvidia-", "triton")
"""Beginnings of the names that torch pins by itself."""


def newest(python: str) -> tuple[str, dict[str, str]]:
    """Return the version of an interpreter, as 3.13, and the versions of all packages that pip would install there."""
    project: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = sorted(set(project["project"]["optional-dependencies"]) - COMPILED)
    asked = [f".[{','.join(extras)}]", *project["build-system"]["requires"], "editables"]
    unpinned = {**os.environ, "PIP_CONSTRAINT": ""}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "report.json")
        command = [python, "-m", "pip", "install", "--dry-run", "--ignore-installed", "--report", str(path), *asked]
        subprocess.run(command, cwd=ROOT, env=unpinned, stdout=sys.stderr, check=True)
        report = json.loads(path.read_text(encoding="utf-8"))
    found: dict[str, str] = {
        canonicalize_name(item["metadata"]["name"]): item["metadata"]["version"] for item in report["install"]
    }
    pinned = {
        name: version.split("+")[0]  # torch's build for the CPU satisfies a pin without a suffix
        for name, version in found.items()
        if name != "aquanav" and not name.startswith(OF_CUDA)
    }
    return ".".join(report["environment"]["python_full_version"].split(".")[:2]), pinned


def merged(found: Mapping[str, Mapping[str, str]]) -> Iterator[str]:
    """Yield a pin of each package, or several with markers, from the versions by package by Python."""
    pythons = sorted(found, key=Version)
    for name in sorted({name for versions in found.values() for name in versions}):
        runs: list[tuple[str, str]] = []
        for python in pythons:
            version = found[python].get(name)
            if version is not None and (not runs or runs[-1][0] != version):
                runs.append((version, python))
        for number, (version, first) in enumerate(runs):
            marks = [f"python_version >= '{first}'"] if number else []
            marks += [f"python_version < '{after}'" for _, after in runs[number + 1 : number + 2]]
            yield f"{name}=={version}" + (f"; {' and '.join(marks)}" if marks else "")


if __name__ == "__main__":
    print(*merged(dict(newest(python) for python in sys.argv[1:])), sep="\n")
