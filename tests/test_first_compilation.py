"""Who waits for a first compilation is told so, once; nobody else is."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
import warp as wp

from aquanav_tools.cli.library_logs import library_logs
from aquanav_tools.compile_caches import MARK_VARIABLE, NUMBA_VARIABLE, WARP_VARIABLE
from aquanav_tools.errors import ScenarioError
from aquanav_tools.first_compilation import SENTENCE, say_compiling
from aquanav_tools.sim.batch import ahead
from aquanav_tools.sim.batch.runtime import is_compiled

WITH_NUMBA = """
import numpy as np
from aquanav_tools.sim.hull import _nose_offset
_nose_offset(np.arange(13.0), 0.3)
"""
WITH_WARP = """
import numpy as np
from aquanav_tools.sim.batch.disturbance import delay
delay(np.zeros((2, 1), np.float32), np.zeros((2, 1), np.float32), [-1, -1], [True, True])
"""
FAMILY = f"""
import subprocess, sys
import aquanav_tools
children = [subprocess.Popen([sys.executable, "-c", {WITH_NUMBA!r}]) for _ in range(2)]
assert not any([child.wait() for child in children])
{WITH_WARP}
"""
OWN = "import aquanav_tools, numba; numba.njit(lambda x: x + 1)(1)"


def said(program: str, folder: Path) -> str:
    """Return what a program writes to stderr whose compiled code is kept in a folder."""
    kept = {NUMBA_VARIABLE: str(folder / "numba"), WARP_VARIABLE: str(folder / "warp")}
    environment = {name: value for name, value in os.environ.items() if name != MARK_VARIABLE} | kept
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True, env=environment)
    assert not run.stdout
    return run.stderr


def test_a_first_compilation_is_told_once_by_all_processes_and_a_second_never(tmp_path: Path) -> None:
    assert said(FAMILY, tmp_path) == SENTENCE + "\n"
    assert any((tmp_path / "numba").rglob("*.nbc")) and any((tmp_path / "warp").rglob("wp_aquanav_tools*"))
    assert said(FAMILY, tmp_path) == ""


def test_warp_alone_is_told_of_too(tmp_path: Path) -> None:
    folder = tmp_path / "Höhle 洞 2"  # where Warp's compiler has to find its files too
    assert said(WITH_WARP, folder) == SENTENCE + "\n"
    assert said(WITH_WARP, folder) == ""


def test_what_users_compile_themselves_is_theirs(tmp_path: Path) -> None:
    assert said(OWN, tmp_path) == ""


def test_a_command_says_it_as_no_warning(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(MARK_VARIABLE, str(tmp_path / "mark"))
    with library_logs(shown=False):
        say_compiling()
        say_compiling()
    assert capsys.readouterr().err == SENTENCE + "\n"


def test_without_a_place_that_lasts_more_was_said_before(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv(MARK_VARIABLE, "")
    with library_logs(shown=False):
        say_compiling()
    assert not capsys.readouterr().err


@pytest.fixture
def children(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[list[str]]:
    """Return the commands of processes that would be started where Warp's cache is in an empty folder."""
    started: list[list[str]] = []

    def start(command: list[str], **_: object) -> subprocess.Popen[bytes]:
        started.append(command)
        return popen([sys.executable, "-c", ""])

    popen = subprocess.Popen
    monkeypatch.setattr(ahead.subprocess, "Popen", start)
    monkeypatch.setenv(WARP_VARIABLE, str(tmp_path))
    monkeypatch.setenv(MARK_VARIABLE, "")
    return started


def test_kernels_are_compiled_ahead_where_none_are(children: list[list[str]], tmp_path: Path) -> None:
    with ahead.compiling_kernels(["caves/mine"]):
        assert children == [[sys.executable, "-m", ahead.__name__]]
    for name in ahead.MODULES:
        (tmp_path / "1.19.0" / f"wp_{name}_0123abc").mkdir(parents=True)
    with ahead.compiling_kernels(["caves/mine"]):
        assert len(children) == 1


def test_bays_need_no_kernels_of_caves(children: list[list[str]]) -> None:
    with ahead.compiling_kernels(["bay.toml"]), ahead.compiling_kernels([]):
        assert not children


def test_an_error_meanwhile_does_not_wait_for_the_kernels(children: list[list[str]]) -> None:
    with pytest.raises(ScenarioError), ahead.compiling_kernels(["caves/mine"]):
        raise ScenarioError("It is damaged.")
    assert len(children) == 1


def test_the_names_by_which_kernels_are_looked_for_are_those_of_warp() -> None:
    ahead.compile_kernels()  # where other tests have not
    assert all(is_compiled(wp.get_module(name), is_cpu=True) for name in ahead.MODULES)
    assert ahead._were_compiled()
