"""Workers that are processes of this machine, each at the other end of a pipe."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import time
from collections.abc import Sequence
from multiprocessing import connection
from typing import Any

from aquanav_tools.workers.worker import Reply, Served, WorkerLostError, WorkerSpec

START_LIMIT = 600.0
"""Time in which a process must be ready, s: one that compiles loops for the first time takes two minutes."""

PATIENCE = 10.0
"""Time that a process gets to end by itself, s."""


class PipeTransport:
    """Starts processes; see `Transport`. They import the main module again: a script needs `if __name__ ...`."""

    blames_tasks = True
    start_limit = START_LIMIT

    def start(self, spec: WorkerSpec, name: str) -> PipeWorker:
        """Start a process."""
        return PipeWorker(spec, name)

    def done(self, workers: Sequence[PipeWorker], timeout: float) -> list[PipeWorker]:
        """Return the workers that have an answer or have ended, once there is one."""
        ends: dict[Any, PipeWorker] = {end: worker for worker in workers for end in worker.ends}
        ready = {ends[end].name for end in connection.wait(list(ends), timeout)}
        return [worker for worker in workers if worker.name in ready]

    def close(self, idle: Sequence[PipeWorker]) -> None:
        """Do nothing: the end of a process frees all it has."""

    def waiting_text(self) -> str:
        """Return why no process may be ready."""
        return ". The likely cause is a machine that is busy with other work."


class PipeWorker:
    """A process; see `Worker`."""

    def __init__(self, spec: WorkerSpec, name: str) -> None:
        # A forked child would share locks of threads (torch's, the ray tracer's) that do not live on in it.
        context = multiprocessing.get_context("spawn")
        self.name, self._limit = name, spec.clock_limit
        self._clock = context.RawValue("d", 0.0)
        self._pipe, inner = context.Pipe()
        self._process = context.Process(target=_serve, args=(spec, name, inner, self._clock), name=name, daemon=True)
        self._process.start()
        inner.close()
        self.pid = self._process.pid
        self.ends = (self._pipe, self._process.sentinel)
        """What becomes ready when there is an answer, or the process has ended."""

    @property
    def place(self) -> str:
        """Which process it is."""
        return f"process {self.pid}"

    @property
    def overrun(self) -> float:
        """Time by which what the object times is too long, s."""
        began = float(self._clock.value)
        return time.monotonic() - began - self._limit if began else 0.0

    def call(self, method: str, *arguments: Any) -> None:
        """Have a method called."""
        try:
            self._pipe.send((method, arguments))
        except OSError as cause:
            raise self._lost() from cause

    def is_done(self, timeout: float) -> bool:
        """Return whether there is an answer, or the process has ended, within a time."""
        return bool(connection.wait(self.ends, timeout))

    def answer(self) -> Reply:
        """Return what came of the call."""
        try:
            if self._pipe.poll():
                reply: Reply = self._pipe.recv()
                return reply
        except (EOFError, OSError) as cause:
            raise self._lost() from cause
        raise self._lost()

    def end(self) -> str:
        """End the process, and return how it ended."""
        self._process.kill()  # does nothing to one that has ended
        self._process.join()
        self._pipe.close()
        return _ending(self._process.exitcode or 0)

    def _lost(self) -> WorkerLostError:
        self._process.join(PATIENCE)  # its pipe may close a moment before it ends
        ending = self.end()
        if (self._process.exitcode or 0) < 0:
            return WorkerLostError(
                ending, "The likely cause, if nobody did that, is too little memory: take fewer workers (--workers)."
            )
        return WorkerLostError(
            ending,
            'What it printed above says why; a script needs `if __name__ == "__main__":` around what starts workers. '
            "Without workers (--workers) nothing depends on them.",
        )


def is_wanted() -> bool:
    """Return whether there is still somebody to work for: false in a worker whose owner is gone."""
    owner = multiprocessing.parent_process()
    return owner is None or owner.is_alive()


def _ending(exit_code: int) -> str:
    if exit_code >= 0:
        return f"ended with exit code {exit_code}"
    try:
        return f"was ended by {signal.Signals(-exit_code).name}"
    except ValueError:
        return f"was ended by signal {-exit_code}"


def _serve(spec: WorkerSpec, name: str, pipe: Any, clock: Any) -> None:
    """Answer calls until the other side hangs up."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to the whole group; the owner ends this process
    served = Served(spec, clock, name, f"process {multiprocessing.current_process().pid}")
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            method, arguments = pipe.recv()
            pipe.send(served.call(method, arguments))
    served.close()
