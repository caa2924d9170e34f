"""Objects for workers of tests, which find them by the name of this module."""

from __future__ import annotations

import os
import signal
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aquanav_tools.errors import InputError


@dataclass(frozen=True)
class Job:
    """A task: a number, and what befalls whoever works on it."""

    number: int
    trouble: str = ""
    reason: str = ""
    """Why it has failed."""


class Adder:
    """Adds up what it is told, and has troubles."""

    def __init__(self, first: int, clock: Any) -> None:
        self._sum, self._clock = first, clock

    def add(self, number: int) -> int:
        self._sum += number
        return self._sum

    def pid(self) -> int:
        return os.getpid()

    def do(self, job: Job) -> tuple[int, str]:
        """Return the job's square and why it failed; suffer its trouble first."""
        if job.trouble and not job.reason:
            self.suffer(job.trouble)
        return job.number**2, job.reason

    def suffer(self, trouble: str) -> None:
        if trouble.startswith("once "):
            path = Path(trouble.removeprefix("once "))
            if path.exists():
                return
            path.touch()
        if trouble == "raises":
            raise ValueError("no idea")
        if trouble == "refuses":
            raise InputError("There is no such thing. Name another.")
        if trouble == "exits":
            sys.exit(3)
        if trouble == "hangs":
            time.sleep(60.0)
        if trouble == "hangs by the clock":
            self._clock.value = time.monotonic()
            time.sleep(60.0)
        os.kill(os.getpid(), signal.SIGKILL)


def fail_to_start(clock: Any) -> Any:
    os.kill(os.getpid(), signal.SIGKILL)


def raise_at_start(clock: Any) -> Any:
    raise KeyError("mesh")
