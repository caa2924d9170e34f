"""What a worker is, however it is reached: an object somewhere else whose methods are called, one call at a time."""

from __future__ import annotations

import math
import sysconfig
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from aquanav_tools.errors import AquanavError

READY = "ready"
"""The method that every worker has: it makes the object, and returns None."""
_LIBRARIES = tuple(sysconfig.get_paths()[name] for name in ("stdlib", "purelib", "platlib"))
"""Folders of code that is nobody's own here."""


class WorkerError(AquanavError):
    """A worker's object raised what is no AquanavError, or took too long; the message names worker and cause."""


class WorkerLostError(Exception):
    """A worker has ended, so that no answer will come."""

    def __init__(self, ending: str, cause: str) -> None:
        super().__init__(f"{ending} {cause}")
        self.ending = ending
        """As a predicate: "was ended by SIGKILL"."""
        self.cause = cause
        """The likely cause, and what to do, as sentences."""


@dataclass(frozen=True)
class WorkerSpec:
    """What the workers of a pool are; travels to them."""

    make: Callable[[Any], Any]
    """Returns the object, in the worker. Its argument has a `value`, which the worker's owner sees where the transport
    can show it: the monotonic clock (s) when work began that must not take longer than `clock_limit`; 0 for none."""
    name: str
    """Such as "training worker"."""
    activity: str
    """What goes on in it: "environments ran"."""
    advice: str
    """Last sentence of messages: what is kept, and how to go on."""
    clock_limit: float = math.inf
    """Wall time of what the object times by its clock, s."""
    late: str = ""
    """Why a task fails that takes longer by that clock, as a predicate."""
    call_limit: float = math.inf
    """Wall time of a call after the first, which makes the object, s."""


@dataclass(frozen=True)
class Reply:
    """What came of a call."""

    result: Any = None
    error: Exception | None = None
    """What the object raised: an AquanavError, or a WorkerError in its place."""
    trace: str = ""
    """The traceback of what a WorkerError stands for."""

    def outcome(self) -> Any:
        """Return the result, or raise the error."""
        if self.error is not None:
            raise self.error from (RuntimeError(self.trace) if self.trace else None)
        return self.result


class Worker(Protocol):
    """The owner's end."""

    name: str
    """Such as "training worker 2 of 4"."""

    @property
    def place(self) -> str:
        """Where it runs: "process 4711"."""

    @property
    def overrun(self) -> float:
        """Time by which what the object times is too long, s; not positive while it is not."""

    def call(self, method: str, *arguments: Any) -> None:
        """Have a method called.

        Raises:
            WorkerLostError: the worker has ended.
        """

    def is_done(self, timeout: float) -> bool:
        """Return whether the call has an answer, or the worker has ended, within a time in s."""

    def answer(self) -> Reply:
        """Return what came of the call, which is done.

        Raises:
            WorkerLostError: the worker has ended.
        """

    def end(self) -> str:
        """End it at once, if it has not; return how it ended, as a predicate. Ending twice does nothing."""


class Transport(Protocol):
    """Starts workers and hears from them."""

    blames_tasks: bool
    """Whether what a worker does may be why it ended: false where whole machines come and go."""
    start_limit: float
    """Wall time in which one worker at least must be ready, s."""

    def start(self, spec: WorkerSpec, name: str) -> Worker:
        """Start a worker; its object is made by the first call, of READY."""

    def done(self, workers: Sequence[Any], timeout: float) -> list[Any]:
        """Return those workers, of those with a call, that have an answer or have ended, once there is one."""

    def close(self, idle: Sequence[Any]) -> None:
        """Let the objects of workers without a call clear up, before all are ended."""

    def waiting_text(self) -> str:
        """Return why no worker may have started, as sentences."""


class Served:
    """The worker's end: makes the object at the first call, and turns what it raises into a reply."""

    def __init__(self, spec: WorkerSpec, clock: Any, name: str, place: str) -> None:
        self._spec, self._clock, self._name, self._place = spec, clock, name, place
        self._object: Any = None

    def call(self, method: str, arguments: Sequence[Any]) -> Reply:
        """Return what came of a call."""
        try:
            if self._object is None:
                self._object = self._spec.make(self._clock)
            return Reply(None if method == READY else getattr(self._object, method)(*arguments))
        except AquanavError as error:
            return Reply(error=error)
        except Exception as error:  # whatever the object's code raises is told to the owner
            return Reply(error=WorkerError(self._sentence(error)), trace=traceback.format_exc())

    def close(self) -> None:
        """Let the object clear up, where it can."""
        if hasattr(self._object, "close"):
            self._object.close()

    def _sentence(self, error: Exception) -> str:
        text = " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(": ")
        return (
            f"The {self._name} ({self._place}) raised {text[:500]}{_line_of(error)} while {self._spec.activity} in it. "
            f"{self._spec.advice}"
        )


def _line_of(error: BaseException) -> str:
    """Return the last line outside of libraries on the way to an error: " (own.py, line 7)"."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if not frame.filename.startswith(("<", *_LIBRARIES))
    ]
    return f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
