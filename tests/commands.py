"""The commands, run in this process: a process of their own costs seconds of imports each time."""

from __future__ import annotations

import contextlib
import io
import subprocess
from collections.abc import Callable, Sequence


def run_here(main: Callable[[Sequence[str]], None], *arguments: object) -> subprocess.CompletedProcess[str]:
    """Return what a command's main function left; a mistake of ours passes through as an exception."""
    code, output, errors = 0, io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as ending:
            code = int(ending.code or 0)
    return subprocess.CompletedProcess(arguments, code, output.getvalue(), errors.getvalue())
