"""Our commands as child processes."""

from __future__ import annotations

import sys

from eval.child import Ended, run_child

TIMEOUT = 4 * 3600.0


def aquanav(command: str, *arguments: str) -> Ended:
    """Return how one of our commands ended.

    Raises:
        RuntimeError: it did not end well; the message has the end of what it said.
    """
    program = f"from aquanav_tools.cli.{command} import main; main()"
    ended = run_child([sys.executable, "-c", program, *arguments], TIMEOUT)
    if ended.exit_code != 0:
        raise RuntimeError(f"{command} {' '.join(arguments)} ended with {ended.exit_code}: {ended.errors[-2000:]}")
    return ended
