"""Damaged files of every format end in a sentence: never in a traceback, a crash or a hang. See tests/fuzz."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import REPOSITORY


def run_fuzz(*arguments: object) -> str:
    """Return what the fuzzer prints. A process of its own: it forks for each case, and has no threads that break there.

    On the way each seed is read undamaged, which must be accepted.
    """
    command = [sys.executable, "-m", "tests.fuzz.run", *map(str, arguments)]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-3000:]
    return done.stdout


def test_a_few_damaged_files_of_every_format_are_read_or_refused() -> None:
    assert ", 0 faults" in run_fuzz("--cases", 3, "--decoder-cases", 1)


@pytest.mark.slow
def test_two_thousand_damaged_files_are_read_or_refused() -> None:
    assert ", 0 faults" in run_fuzz("--cases", 45, "--salt", 2)


@pytest.mark.slow
@pytest.mark.nightly
def test_ten_thousand_damaged_files_are_read_or_refused() -> None:
    last = run_fuzz("--cases", 290, "--salt", 1).splitlines()[-1]
    assert int(last.split(" files")[0]) >= 10_000


def test_the_fuzzer_tells_a_traceback_a_crash_and_a_hang_from_a_refusal(tmp_path: Path) -> None:
    code = """if True:
        import os, pathlib, sys, tests.fuzz.outcome as run
        from aquanav_tools.errors import InputError
        run.CPU_SECONDS = 1
        def refuse(path): raise InputError("no")
        def stumble(path): raise KeyError("x")
        def crash(path): os.abort()
        def hang(path):
            while True: pass
        def fill(path): return bytearray(2 * run.MEMORY)
        path = pathlib.Path(sys.argv[1]) / "file"
        for reader in (len, refuse, stumble, crash, hang, fill):
            print(run.outcome(reader if reader is not len else str, path))
    """
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)], cwd=REPOSITORY, capture_output=True, text=True, check=True
    )
    accepted, refused, stumbled, crashed, hung, filled = done.stdout.splitlines()
    assert (accepted, refused, crashed, hung) == ("accepted", "refused", "ended by SIGABRT", "hang")
    assert stumbled.startswith("KeyError: 'x'")
    assert filled.startswith("MemoryError")
