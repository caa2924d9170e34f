"""The commands of docs/install.md bring torch without CUDA, whatever else the package index has: tried with pip itself.

The indexes are folders with wheels of a few lines: PyPI's torch is newer and needs CUDA's libraries, torch's own index
has the build for the CPU.
"""

from __future__ import annotations

import importlib.metadata
import os
import re
import shlex
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from aquanav_tools.text_files import read_text
from tests.conftest import REPOSITORY

TORCH_INDEX = "https://download.pytorch.org/whl/cpu"
CUDA = "nvidia-cublas"


def wheel(index: Path, name: str, version: str, *needs: str) -> None:
    """Put a wheel without any code into an index (PEP 503)."""
    folder = index / name
    folder.mkdir(parents=True, exist_ok=True)
    module = name.replace("-", "_")
    path, facts = folder / f"{module}-{version}-py3-none-any.whl", f"{module}-{version}.dist-info"
    texts = {
        "METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: {version}\nProvides-Extra: train\n"
        + "".join(f"Requires-Dist: {need}\n" for need in needs),
        "WHEEL": "Wheel-Version: 1.0\nGenerator: tests\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
    }
    records = "".join(f"{facts}/{file},,\n" for file in (*texts, "RECORD"))
    with zipfile.ZipFile(path, "w") as archive:
        for file, text in {**texts, "RECORD": records}.items():
            archive.writestr(f"{facts}/{file}", text)
    links = "".join(f'<a href="{one.name.replace("+", "%2B")}">{one.name}</a>\n' for one in folder.glob("*.whl"))
    (folder / "index.html").write_text(f"<!DOCTYPE html><html><body>{links}</body></html>", encoding="utf-8")


def commands() -> list[str]:
    """Return what docs/install.md says."""
    page = read_text(REPOSITORY / "docs" / "install.md").split("## torch without CUDA")[1].split("\n## ")[0]
    return re.search(r"```bash\n(.*?)```", page, re.DOTALL)[1].splitlines()  # type: ignore[index]


def pinned() -> str:
    """Return the version of torch in constraints.txt."""
    return re.search(r"^torch==(\S+)", read_text(REPOSITORY / "constraints.txt"), re.MULTILINE)[1]  # type: ignore[index]


def after(lines: list[str], folder: Path) -> dict[str, str]:
    """Return what is installed, by name, after commands of pip in an empty environment."""
    version, newer = pinned(), f"{int(pinned().split('.')[0]) + 1}.0.0"
    pypi, torch = folder / "pypi", folder / "torch"
    wheel(pypi, "torch", version, CUDA)
    wheel(pypi, "torch", newer, CUDA)
    wheel(pypi, CUDA, "13.0")
    wheel(torch, "torch", f"{version}+cpu")
    wheel(torch, "torch", f"{newer}+cpu")
    wanted = importlib.metadata.requires("aquanav") or []
    needs = [need for need in wanted if re.fullmatch(r"torch\b.*extra == ['\"]train['\"]", need)]
    assert needs
    wheel(pypi, "aquanav", "0.1.0", *needs)
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder / "venv"], check=True)
    places = {"PIP_CONFIG_FILE": os.devnull, "PIP_INDEX_URL": pypi.as_uri(), "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PIP_")} | places
    for line in lines:
        words = [torch.as_uri() if word == TORCH_INDEX else word for word in shlex.split(line)]
        assert words[0] == "pip"
        command = [sys.executable, "-m", "pip", "--python", str(folder / "venv"), *words[1:]]
        subprocess.run(command, env=environment, check=True, capture_output=True)
    (site,) = (folder / "venv" / "lib").glob("*/site-packages")
    return {one.metadata["Name"]: one.version for one in importlib.metadata.distributions(path=[str(site)])}


@pytest.mark.skipif(sys.platform == "win32", reason="looks for packages where POSIX has them")
def test_the_commands_shown_bring_the_build_for_the_cpu_and_nothing_of_cuda(tmp_path: Path) -> None:
    assert after(commands(), tmp_path) == {"torch": f"{pinned()}+cpu", "aquanav": "0.1.0"}


def test_without_the_first_of_them_cuda_comes(tmp_path: Path) -> None:
    """Or the test above would show nothing."""
    installed = after(commands()[1:], tmp_path)
    assert CUDA in installed and "+cpu" not in installed["torch"]
