"""A crew of environments in a process of its own."""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
from collections.abc import Sequence
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any

from aquanav_tools.errors import AquanavError, ResourceError
from aquanav_tools.train.settings import TrainSettings

if TYPE_CHECKING:
    from aquanav_tools.envs.places import Place
    from aquanav_tools.train.crew import Crew

PATIENCE = 10.0
"""Time that a worker gets to end by itself, s."""


class Worker:
    """Hands calls to a crew in another process. `ask`, then `answer`: workers that were asked work side by side."""

    def __init__(self, scenarios: Sequence[Place], settings: TrainSettings, name: str) -> None:
        # A forked child would share locks of threads (torch's, the ray tracer's) that do not live on in it.
        context = multiprocessing.get_context("spawn")
        self._connection, theirs = context.Pipe()
        arguments = (theirs, scenarios, settings)
        self._process = context.Process(target=_work, args=arguments, name=name, daemon=True)
        self._process.start()
        theirs.close()

    @property
    def pid(self) -> int | None:
        """Of the process."""
        return self._process.pid

    def ask(self, method: str, *arguments: Any) -> None:
        """Have a method of the crew called.

        Raises:
            ResourceError: the process has ended.
        """
        try:
            self._connection.send((method, arguments))
        except (BrokenPipeError, ConnectionResetError) as cause:
            raise self._ended() from cause

    def answer(self) -> Any:
        """Return what the method returned that was asked for.

        Raises:
            ResourceError: the process has ended.
            AquanavError: what the crew raised.
        """
        try:
            result, error = self._connection.recv()
        except (EOFError, ConnectionResetError) as cause:
            raise self._ended() from cause
        if error is not None:
            raise error
        return result

    def close(self) -> None:
        """End the process. Closing twice does nothing."""
        self._connection.close()
        self._process.join(PATIENCE)
        if self._process.is_alive():
            self._process.kill()

    def _ended(self) -> ResourceError:
        self._process.join(PATIENCE)
        code = self._process.exitcode
        if code is not None and code < 0:
            how, cause = (
                f"was ended by {signal.Signals(-code).name}",
                "If nobody did that, the machine is out of memory",
            )
        else:
            how, cause = f"ended with exit code {code}", "What it printed above says why; if that is memory"
        return ResourceError(
            f"The {self._process.name} (process {self._process.pid}) {how} while environments ran in it. {cause}: take "
            "fewer environments or workers. The last checkpoint is kept; the same command goes on from it."
        )


def _work(connection: Connection, scenarios: Sequence[Place], settings: TrainSettings) -> None:
    """Do what is asked until the other side hangs up."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the main process's to answer
    from aquanav_tools.train.crew import Crew

    crew: Crew | None = None
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            method, arguments = connection.recv()
            result: Any = None
            error: AquanavError | None = None
            try:
                crew = crew or Crew(scenarios, settings)
                result = crew.spaces if method == "spaces" else getattr(crew, method)(*arguments)
            except AquanavError as raised:
                error = raised
            connection.send((result, error))
    if crew is not None:
        crew.close()
