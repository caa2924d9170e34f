"""How a reader ends: each case in a process of its own, with bounded memory and processor time."""

from __future__ import annotations

import os
import resource
import signal
import traceback
from collections.abc import Callable
from pathlib import Path

from aquanav_tools.errors import AquanavError

MEMORY = 4 << 30
"""Beyond the parent's."""
CPU_SECONDS, WALL_SECONDS = 20, 300
FINE = ("accepted", "refused")


def outcome(reader: Callable[[Path], object], path: Path) -> str:
    """Return "accepted" or "refused", or what went wrong."""
    trace = path.parent / "trace"
    child = os.fork()
    if child == 0:
        _read(reader, path, trace)
    status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    if status in (0, 1):
        return FINE[status]
    if status < 0:
        sign = signal.Signals(-status)
        return "hang" if sign in (signal.SIGXCPU, signal.SIGALRM) else f"ended by {sign.name}"
    lines = trace.read_text().strip().splitlines() if trace.exists() else [f"exit code {status}"]
    ours = [line.strip() for line in lines if "aquanav_tools" in line]
    return f"{lines[-1][:120]} @ {ours[-1][-90:] if ours else '?'}"


def _read(reader: Callable[[Path], object], path: Path, trace: Path) -> None:
    """Read a file and end this process."""
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, used + MEMORY))
    resource.setrlimit(resource.RLIMIT_CPU, (CPU_SECONDS, CPU_SECONDS + 5))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.alarm(WALL_SECONDS)
    silence = os.open(os.devnull, os.O_WRONLY)
    os.dup2(silence, 1)
    os.dup2(silence, 2)
    try:
        reader(path)
        os._exit(0)
    except AquanavError:
        os._exit(1)
    except BaseException:
        trace.write_text(traceback.format_exc())
        os._exit(3)
