"""Run a command as a child process that is timed, measured and ended when it takes too long."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass

POLL_SECONDS = 0.1
NICENESS = 10


@dataclass(frozen=True)
class Ended:
    """How a child ended."""

    exit_code: int | None
    """None when it took too long; negative for a signal."""
    seconds: float
    """Wall clock."""
    cpu_seconds: float
    peak_gb: float
    """Largest resident memory, 10^9 bytes. Linux counts the parent's size at the start too: keep the parent small."""
    output: str
    """Standard output."""
    errors: str
    """Standard error."""


def run_child(command: Sequence[str], timeout: float) -> Ended:
    """Return how a command ended; after `timeout` seconds it is killed with all its children."""
    with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
        began = time.monotonic()
        child = subprocess.Popen(
            ["nice", "-n", str(NICENESS), *command], stdout=output, stderr=errors, start_new_session=True
        )
        is_late = False
        while not (ended := os.wait4(child.pid, os.WNOHANG))[0]:
            if not is_late and time.monotonic() - began > timeout:
                os.killpg(child.pid, signal.SIGKILL)
                is_late = True
            time.sleep(POLL_SECONDS)
        _, status, usage = ended
        child.returncode = os.waitstatus_to_exitcode(status)  # tells Popen that nobody is left to wait for
        for stream in (output, errors):
            stream.seek(0)
        texts = [stream.read().decode(errors="replace") for stream in (output, errors)]
    return Ended(
        exit_code=None if is_late else child.returncode,
        seconds=time.monotonic() - began,
        cpu_seconds=usage.ru_utime + usage.ru_stime,
        peak_gb=usage.ru_maxrss * 1024 / 1e9,
        output=texts[0],
        errors=texts[1],
    )
