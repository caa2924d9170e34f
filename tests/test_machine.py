"""What systems differ in: right answers here, and the ways of other systems, with stand-ins for their modules."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import types
from pathlib import Path
from typing import Any

import pytest

from aquanav_tools import machine
from aquanav_tools.errors import InputError
from aquanav_tools.store import locked


def test_the_cores_are_those_that_this_process_may_use() -> None:
    code = "from aquanav_tools.machine import num_cores; print(num_cores())"
    bound = [sys.executable, "-c", f"import os; os.sched_setaffinity(0, {{0}}); {code}"]
    assert subprocess.run(bound, capture_output=True, text=True, check=True).stdout == "1\n"


def test_without_affinity_all_cores_count(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(os, "sched_getaffinity")
    monkeypatch.setattr(os, "cpu_count", lambda: 7)
    assert machine.num_cores() == 7


def test_free_memory_is_what_the_kernel_says() -> None:
    lines = Path("/proc/meminfo").read_text(encoding="utf-8").splitlines()
    told = 1024 * next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable:"))
    assert machine.free_memory() == pytest.approx(told, rel=0.2)


def test_the_peak_of_memory_is_what_was_held() -> None:
    code = (
        "import numpy as np; from aquanav_tools.machine import peak_memory; "
        "held = np.ones(100_000_000); print(peak_memory())"
    )
    # From a shell: a process takes over the peak of the one that started it (getrusage(2)), and tests hold much.
    shell = ["sh", "-c", '"$0" -c "$1"; exit $?', sys.executable, code]
    told = float(subprocess.run(shell, capture_output=True, text=True, check=True).stdout)
    assert 100e6 * 8 / 2**20 < told < 100e6 * 8 / 2**20 + 200.0  # beside it stands Python with NumPy


class Console:
    """Stands in for Windows' `msvcrt`: locks by inode and byte, mandatory as there."""

    LK_NBLCK, LK_UNLCK = 2, 0

    def __init__(self) -> None:
        self.held: dict[tuple[int, int], int] = {}
        self.places: list[int] = []

    def locking(self, descriptor: int, mode: int, count: int) -> None:
        key = os.fstat(descriptor).st_ino, os.lseek(descriptor, 0, os.SEEK_CUR)
        self.places.append(key[1])
        if mode == self.LK_UNLCK:
            assert self.held.pop(key) == descriptor
        elif key in self.held:
            raise OSError(errno.EACCES, "Permission denied")
        else:
            self.held[key] = descriptor


@pytest.fixture
def windows(monkeypatch: pytest.MonkeyPatch) -> Console:
    """Return the console of a system with neither fcntl nor resource."""
    console = Console()
    monkeypatch.setitem(sys.modules, "fcntl", None)
    monkeypatch.setitem(sys.modules, "resource", None)
    module: Any = types.ModuleType("msvcrt")
    module.LK_NBLCK, module.LK_UNLCK, module.locking = console.LK_NBLCK, console.LK_UNLCK, console.locking
    monkeypatch.setitem(sys.modules, "msvcrt", module)
    return console


def test_without_fcntl_a_folder_is_held_by_one_at_a_time_too(tmp_path: Path, windows: Console) -> None:
    with locked(tmp_path):
        with pytest.raises(InputError, match="Another process is at work in"), locked(tmp_path):
            pytest.fail("two hold it")
        assert "process" in (tmp_path / "lock").read_text(encoding="utf-8")  # who holds it can be read meanwhile
    with locked(tmp_path):
        pass
    assert not windows.held
    assert min(windows.places) > 1_000_000  # far behind what is written


def test_without_fcntl_who_waits_gets_it_in_the_end(
    tmp_path: Path, windows: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    naps = []

    def nap(seconds: float) -> None:
        naps.append(seconds)
        if len(naps) == 3:
            windows.held.clear()  # the other process ends

    monkeypatch.setattr(machine.time, "sleep", nap)
    with (tmp_path / "lock").open("w+b") as stream:
        stream.seek(machine.FAR)
        windows.locking(stream.fileno(), windows.LK_NBLCK, 1)
        with locked(tmp_path, waits=True):
            assert len(naps) == 3


def test_without_resource_memory_and_priority_come_from_psutil(
    windows: Console, monkeypatch: pytest.MonkeyPatch
) -> None:
    import psutil

    asked: list[Any] = []

    class Process:
        def memory_info(self) -> Any:
            return types.SimpleNamespace(peak_wset=3 * 2**20)

        def nice(self, value: Any) -> None:
            asked.append(value)

    monkeypatch.setattr(psutil, "Process", Process)
    monkeypatch.setattr(psutil, "BELOW_NORMAL_PRIORITY_CLASS", 16384, raising=False)
    monkeypatch.delattr(os, "nice")
    assert machine.peak_memory() == 3.0
    machine.lower_priority(0)
    assert asked == []
    machine.lower_priority(19)
    assert asked == [16384]


def test_on_windows_files_are_synced_for_writing_and_folders_not_at_all(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened: list[tuple[Path, int]] = []
    real = os.open

    def note(path: Path, flags: int) -> int:
        opened.append((path, flags))
        return real(path, flags)

    (tmp_path / "file").write_text("content", encoding="utf-8")
    monkeypatch.setattr(os, "open", note)
    machine.sync(tmp_path)
    assert opened == [(tmp_path, os.O_RDONLY)]
    monkeypatch.setattr(sys, "platform", "win32")
    machine.sync(tmp_path)
    machine.sync(tmp_path / "file")
    assert opened[1:] == [(tmp_path / "file", os.O_RDWR)]
