"""What .ci/make-venv chooses among the interpreters on a path, and says where it can use none. These are made up."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

from tests.conftest import REPOSITORY
from tests.project import pyproject

SCRIPT = REPOSITORY / ".ci" / "make-venv"
FAKE = """#!/bin/sh
case "$*" in
    *sys.version_info*) echo {version} ;;
    --version) echo Python {version} ;;
    "-c import ensurepip") exit 0 ;;
    "-m venv "*) echo "made by $0" ;;
    *) exit {last} ;;
esac
"""
SHIM = "#!/bin/sh\necho 'python3.13: command not found' >&2\nexit 127\n"
"""What pyenv puts on the path for versions that are installed and not active."""


def put(folder: Path, name: str, text: str) -> Path:
    path = folder / name
    path.write_text(text)
    path.chmod(0o755)
    return path


def fake(folder: Path, name: str, version: str, *, can_make_environments: bool = True) -> Path:
    return put(folder, name, FAKE.format(version=version, last=int(not can_make_environments)))


def make_venv(folder: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    environment = {"PATH": str(folder), **variables}
    return subprocess.run(
        ["/bin/sh", SCRIPT, "there"], env=environment, cwd=folder, capture_output=True, text=True, check=False
    )


def refused(folder: Path, **variables: str) -> str:
    done = make_venv(folder, **variables)
    assert done.returncode == 1 and done.stdout == ""
    assert done.stderr.count("\n") == 1, "it is one sentence, without the messages of what was tried"
    assert "aquanav needs Python 3.10 to 3.14, and found none" in done.stderr
    assert "sudo apt install python3 python3-venv" in done.stderr
    return done.stderr


def test_the_newest_usable_one_is_taken_whatever_its_name(tmp_path: Path) -> None:
    fake(tmp_path, "python3.10", "3.10.13")
    fake(tmp_path, "python3", "3.12.3")
    fake(tmp_path, "python3.11", "3.11.7")
    put(tmp_path, "python3.13", SHIM)
    fake(tmp_path, "python", "3.10.2")
    done = make_venv(tmp_path)
    assert done.returncode == 0, done.stderr
    assert done.stdout == f"Making there with Python 3.12.3.\nmade by {tmp_path / 'python3'}\n"


def test_the_one_that_is_named_is_taken(tmp_path: Path) -> None:
    fake(tmp_path, "python3.13", "3.13.0")
    (tmp_path / "my pythons").mkdir()
    mine = fake(tmp_path / "my pythons", "mine", "3.10.1")
    assert f"made by {mine}" in make_venv(tmp_path, PYTHON=str(mine)).stdout
    assert "python3.9 is 3.9.2, too old" in refused(tmp_path, PYTHON=str(fake(tmp_path, "python3.9", "3.9.2")))


@pytest.mark.parametrize(
    ("name", "version", "sentence"),
    [
        ("python3", "3.15.0", "python3 is 3.15.0, too new: numba does not know it yet"),
        ("python3", "3.9.18", "python3 is 3.9.18, too old"),
        ("python", "2.7.18", "python is 2.7.18, too old"),
        ("python", "4.0.0", "python is 4.0.0, too new"),
    ],
)
def test_a_python_too_new_or_too_old_is_named_with_its_version(
    tmp_path: Path, name: str, version: str, sentence: str
) -> None:
    fake(tmp_path, name, version)
    assert sentence in refused(tmp_path)


def test_a_name_that_a_version_manager_keeps_is_no_python(tmp_path: Path) -> None:
    put(tmp_path, "python3.13", SHIM)
    assert "python3.13 does not run (under pyenv, activate that version first" in refused(tmp_path)


def test_debians_python_without_venv_is_told_with_the_package_it_lacks(tmp_path: Path) -> None:
    fake(tmp_path, "python3", "3.13.5", can_make_environments=False)
    assert "cannot make virtual environments (on Debian: sudo apt install python3.13-venv)" in refused(tmp_path)


def test_a_machine_without_python_gets_the_same_advice(tmp_path: Path) -> None:
    assert "What is there" not in refused(tmp_path)


@pytest.mark.parametrize(("version", "is_taken"), [((3, 9, 18), False), ((3, 10, 0), True), ((3, 15, 0), False)])
def test_a_checkout_on_the_path_says_which_pythons_it_takes(version: tuple[int, ...], is_taken: bool) -> None:
    code = f"import sys; sys.version_info = {version}; import aquanav_tools"
    run = subprocess.run([sys.executable, "-c", code], cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert (run.returncode == 0) == is_taken
    sentence = f"ImportError: aquanav needs Python 3.10 to 3.14, and {sys.executable} is {version[0]}.{version[1]}. Run"
    assert is_taken or sentence in run.stderr.splitlines()[-1]


def test_the_script_takes_the_versions_that_the_package_does() -> None:
    oldest, newest = re.findall(r"(?:oldest|newest)=(\d+)", SCRIPT.read_text())
    taken = SpecifierSet(pyproject()["project"]["requires-python"])
    assert [minor for minor in range(30) if taken.contains(f"3.{minor}.1")] == list(range(int(oldest), int(newest) + 1))
    names = re.search(r"set -- (python3\.\d+ .*)", SCRIPT.read_text())
    assert names is not None
    assert {f"python3.{minor}" for minor in range(int(oldest), int(newest) + 1)} < set(names[1].split())
