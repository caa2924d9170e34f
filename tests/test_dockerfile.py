"""The Dockerfile: every instruction parses, all is pinned, nobody is root, and its steps install aquanav."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import pytest

from tests.conftest import REPOSITORY
from tests.pages import text

KNOWN = {"CMD", "COPY", "FROM", "RUN", "USER", "WORKDIR"}
IMAGE = re.compile(r"python:3\.\d+\.\d+-slim-\w+ AS (\w+)|(\w+) AS (\w+)")
"""An image by its whole version, or an earlier stage."""


class Step(NamedTuple):
    """An instruction."""

    word: str
    rest: str


def stages() -> dict[str, list[Step]]:
    """Return the instructions of each stage, by its name, without FROM."""
    found: dict[str, list[Step]] = {}
    joined = text("Dockerfile").replace("\\\n", " ")
    for line in filter(None, (line.strip() for line in joined.splitlines())):
        if line.startswith("#"):
            continue
        word, _, rest = line.partition(" ")
        assert word in KNOWN and rest, line
        if word == "FROM":
            match = IMAGE.fullmatch(rest)
            assert match, f"no pinned image and name of a stage: {line}"
            assert match[1] or match[2] in found, f"no stage before it has the name: {line}"
            found[match[1] or match[3]] = []
        else:
            found[list(found)[-1]].append(Step(word, rest))
    return found


def commands(stage: str) -> list[str]:
    return [step.rest for step in stages()[stage] if step.word == "RUN"]


def test_there_is_a_slim_image_and_a_full_one() -> None:
    assert list(stages()) == ["core", "full"]


@pytest.mark.parametrize("stage", ["core", "full"])
def test_nobody_is_root_in_the_end(stage: str) -> None:
    users = [step.rest for step in stages()[stage] if step.word == "USER"]
    assert users[-1] == "aquanav"


@pytest.mark.parametrize("stage", ["core", "full"])
def test_what_is_installed_is_pinned_and_as_the_docs_say(stage: str) -> None:
    shown = "".join(text(page) for page in ("README.md", "docs/install.md"))
    installing = [command for command in commands(stage) if "install" in command]
    assert installing and all(" -c constraints.txt " in command or "==" in command for command in installing)
    assert [command for command in installing if command not in shown] == []


def test_the_python_is_one_that_aquanav_takes() -> None:
    minor = re.search(r"^FROM python:3\.(\d+)\.", text("Dockerfile"), re.M)
    bounds = re.search(r'requires-python = ">=3\.(\d+),<3\.(\d+)"', text("pyproject.toml"))
    assert minor and bounds and int(bounds[1]) <= int(minor[1]) < int(bounds[2])


@pytest.mark.slow
@pytest.mark.nightly
def test_the_steps_of_the_slim_image_install_aquanav_into_an_empty_environment(tmp_path: Path) -> None:
    """All RUN steps of `core` but making a user, which takes root; then its CMD, which tries every library.

    The full image's first step asks torch's own index, which machines that test need not reach: .ci/extras tries `all`.
    """
    checkout, environment = tmp_path / "checkout", tmp_path / "venv"
    checkout.mkdir()
    packed = subprocess.run(["git", "archive", "HEAD"], cwd=REPOSITORY, capture_output=True, check=True)
    subprocess.run(["tar", "-x", "-C", str(checkout)], input=packed.stdout, check=True)
    subprocess.run([sys.executable, "-m", "venv", str(environment)], check=True)
    paths = {"PATH": f"{environment / 'bin'}:{os.environ['PATH']}", "HOME": str(tmp_path), "PYTHONPATH": ""}
    steps = [command for command in commands("core") if not command.startswith("useradd")]
    for command in [*steps, f"cd {tmp_path} && aquanav doctor"]:
        done = subprocess.run(
            ["sh", "-c", command],
            cwd=checkout,
            env={**os.environ, **paths},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, f"{command}\n{done.stdout[-2000:]}\n{done.stderr[-2000:]}"
