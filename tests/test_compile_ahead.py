"""Compiling on a second core: what is listed can be compiled, is all that a first run needs, and ends with the run."""

from __future__ import annotations

import inspect
import itertools
import logging
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import pytest
from numba import types

from aquanav_tools import compile_ahead
from aquanav_tools.compile_ahead import compiling_on_second_core, named, read_signatures, type_of
from aquanav_tools.first_compilation import on_first_compilation
from aquanav_tools.geometry.mesh.box_tree import BoxTree
from tests.conftest import REPOSITORY

LENGTHS = itertools.count(20)
"""Of arguments that nothing was compiled for yet."""
FIRST_RUN = """
import sys
from numba.core import event
class Listener(event.Listener):
    def on_start(self, event):
        function = event.data["dispatcher"]
        if function.py_func.__module__.startswith("aquanav_tools.") and function.stats.cache_path is not None:
            print(function.py_func.__module__, function.py_func.__name__, event.data["args"])
    def on_end(self, event):
        pass
event.register("numba:compile", Listener())
from aquanav_tools.build.shipped_scenarios import build_shipped
build_shipped("cave-test-1")
"""


def test_all_that_is_listed_is_compiled_and_kept_and_takes_as_many_arguments() -> None:
    listed = read_signatures()
    assert len(listed) > 30
    assert len({str(entry) for entry in listed}) == len(listed)
    for name, kinds in listed:
        function = named(name)
        assert isinstance(function, numba.core.registry.CPUDispatcher), name
        assert function.stats.cache_path is not None, name
        assert len(inspect.signature(function.py_func).parameters) == len(kinds), name
        assert all(isinstance(type_of(kind), types.Type) for kind in kinds)


@pytest.mark.parametrize(
    ("kind", "wanted"),
    [
        ("float32", types.float32),
        ("none", types.none),
        (["array", "uint8", 2, "A", True], types.Array(types.uint8, 2, "A", readonly=True)),
        (["tuple", "int64", "float64"], types.Tuple((types.int64, types.float64))),
        (["tuple", "int64", "int64"], types.UniTuple(types.int64, 2)),
        (["omitted", 0.5], types.Omitted(0.5)),
        (
            ["named", "aquanav_tools.geometry.mesh.box_tree:BoxTree", *[["array", "float64", 2, "C", False]] * 2],
            types.NamedUniTuple(types.Array(types.float64, 2, "C"), 2, BoxTree),
        ),
    ],
)
def test_types_are_those_of_numba(kind: Any, wanted: types.Type) -> None:
    assert type_of(kind) == wanted


class Children:
    """Starts a program of the test's in place of each process, and remembers them."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, code: str) -> None:
        self.commands: list[list[str]] = []
        self.processes: list[subprocess.Popen[bytes]] = []
        start = subprocess.Popen

        def noted(command: list[str], **settings: Any) -> subprocess.Popen[bytes]:
            self.commands.append(command)
            self.processes.append(start([sys.executable, "-c", code], **settings))
            return self.processes[-1]

        monkeypatch.setattr("aquanav_tools.compile_ahead.subprocess.Popen", noted)


@pytest.fixture
def compile_something(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """Return what has numba compile a function that is of the package and is kept."""
    from aquanav_tools.sim.hull import _nose_offset

    monkeypatch.setenv("AQUANAV_COMPILING_MARK", "")
    monkeypatch.setattr(_nose_offset._cache, "load_overload", lambda *_: None)
    return lambda: _nose_offset.compile((types.UniTuple(types.float64, next(LENGTHS)), types.float64)) and None


def test_another_process_starts_once_something_is_compiled_and_ends_with_the_work(
    monkeypatch: pytest.MonkeyPatch, compile_something: Callable[[], None]
) -> None:
    monkeypatch.setattr(compile_ahead, "num_cores", lambda: 2)
    children = Children(monkeypatch, "import time; time.sleep(600)")
    with pytest.raises(ValueError, match="stopped"), compiling_on_second_core():
        assert not children.commands  # nothing was missing yet
        compile_something()
        compile_something()
        raise ValueError("stopped")
    assert children.commands == [[sys.executable, "-m", "aquanav_tools.compile_ahead"]]
    assert children.processes[0].returncode is not None
    compile_something()  # after the work, nobody waits
    assert len(children.commands) == 1


def test_one_core_is_left_to_the_work(monkeypatch: pytest.MonkeyPatch, compile_something: Callable[[], None]) -> None:
    monkeypatch.setattr(compile_ahead, "num_cores", lambda: 1)
    children = Children(monkeypatch, "")
    with compiling_on_second_core():
        compile_something()
    assert not children.commands


def test_a_process_that_failed_is_told_of(
    monkeypatch: pytest.MonkeyPatch, compile_something: Callable[[], None], caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(compile_ahead, "num_cores", lambda: 2)
    children = Children(monkeypatch, "raise SystemExit(3)")
    with caplog.at_level(logging.WARNING), compiling_on_second_core():
        compile_something()
        children.processes[0].wait()
    assert "failed with 3" in caplog.text


def test_nothing_is_called_where_nothing_is_compiled() -> None:
    called: list[int] = []
    with on_first_compilation(lambda: called.append(1)):
        pass
    assert not called


@pytest.mark.slow
def test_the_list_has_all_that_a_first_build_compiles(tmp_path: Path) -> None:
    places = {"NUMBA_CACHE_DIR": str(tmp_path / "numba"), "AQUANAV_CACHE": str(tmp_path / "caves")}
    environment = {**os.environ, **places}
    command = [sys.executable, "-m", "aquanav_tools.compile_ahead"]
    subprocess.run(command, env=environment, cwd=REPOSITORY, check=True)
    command = [sys.executable, "-c", FIRST_RUN]
    run = subprocess.run(command, env=environment, cwd=REPOSITORY, check=True, capture_output=True, text=True)
    assert not run.stdout, f"not in signatures.json (see .ci/make_signatures.py):\n{run.stdout}"
