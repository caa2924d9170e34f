"""Compiling ahead: only for large sets, in a process that ends with the build, and of what later stages call."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import pytest

from aquanav_tools.build.ahead import compiling_ahead
from tests.conftest import REPOSITORY

MODULE = [sys.executable, "-m", "aquanav_tools.build.ahead"]

CALLED = """
import runpy, sys
import numba

runpy.run_module("aquanav_tools.build.ahead", run_name="__main__")
for name, module in list(sys.modules.items()):
    if name.startswith("aquanav_tools."):
        for value in vars(module).values():
            if isinstance(value, numba.core.registry.CPUDispatcher) and value.signatures:
                print(value.__module__.split(".")[-1] + "." + value.__name__)
"""
"""Print each compiled function that compiling ahead has called, with the last name of its module."""


class Started:
    """Remembers the processes that were started."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, command: list[str] | None = None) -> None:
        self.processes: list[subprocess.Popen[bytes]] = []
        self.commands: list[list[str]] = []
        start = subprocess.Popen

        def noted(given: list[str], **settings: Any) -> subprocess.Popen[bytes]:
            self.commands.append(given)
            self.processes.append(start(command or given, **settings))
            return self.processes[-1]

        monkeypatch.setattr("aquanav_tools.build.ahead.subprocess.Popen", noted)


def test_few_photos_start_no_process(monkeypatch: pytest.MonkeyPatch) -> None:
    started = Started(monkeypatch)
    with compiling_ahead(39):
        pass
    assert not started.commands


def test_the_process_ends_with_the_build_also_when_that_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    started = Started(monkeypatch)
    with pytest.raises(ValueError, match="stopped"), compiling_ahead(40):
        assert started.processes[0].poll() is None
        raise ValueError("stopped")
    assert started.commands == [MODULE]
    assert started.processes[0].returncode is not None


def test_a_process_that_failed_is_told_of(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture) -> None:
    started = Started(monkeypatch, [sys.executable, "-c", "raise SystemExit(3)"])
    with compiling_ahead(40):
        started.processes[0].wait()
    assert "failed with 3" in caplog.text


@pytest.mark.slow
def test_kernels_of_all_later_stages_are_compiled() -> None:
    """Or taken from numba's cache, where an earlier test has left them: both say that they were called."""
    done = subprocess.run([sys.executable, "-c", CALLED], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    needed = {"cpu._sweep", "sight._votes", "intersections._count_crossings", "distance._fill", "velocity._fit"}
    assert needed <= set(done.stdout.split()), needed - set(done.stdout.split())
