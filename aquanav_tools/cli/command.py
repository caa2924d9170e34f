"""What every command shares: parse the options, run, turn errors into a sentence and an exit code."""

from __future__ import annotations

import argparse
import contextlib
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from aquanav_tools.cli.library_logs import library_logs
from aquanav_tools.errors import AquanavError
from aquanav_tools.libraries import explained_imports

if TYPE_CHECKING:
    from aquanav_tools.types import Progress

Options = TypeVar("Options")

DEBUG_FLAG = "--debug"
INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it (128 + SIGINT)."""
NO_TERMINAL = None
"""What tqdm's `disable` is called with to draw no bar into a file or a pipe."""
UNREAD = 1
"""Exit code when nobody reads the output to its end, as Python has it."""


def run_command(
    options_type: type[Options],
    function: Callable[[Options], None],
    prog: str,
    description: str,
    *,
    defaults: Callable[[Sequence[str]], Options | None] | None = None,
    arguments: Sequence[str] | None = None,
) -> None:
    """Parse the command line into `options_type`, call `function` with it, and exit when that fails.

    Args:
        options_type: Dataclass of the options; tyro makes the command line from its fields and their docstrings.
        function: The command. Import heavy libraries inside it, so that --help answers at once.
        prog: Name of the command.
        description: First lines of --help.
        defaults: Returns the values of options that are not given, from the raw arguments (say, a file named there).
        arguments: The command line without the program's name; None reads sys.argv.

    Raises:
        SystemExit: the user asked for help (0), the options do not parse (2), an AquanavError (its exit code), Ctrl-C
            (130), or what reads the output stopped early, like `head` (1). Other exceptions are our mistakes and keep
            their traceback.
    """
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    is_debug = DEBUG_FLAG in arguments
    arguments = [argument for argument in arguments if argument != DEBUG_FLAG]
    try:
        with _flushed_output(), library_logs(shown=is_debug):
            default = defaults(arguments) if defaults else None
            options = _parse(options_type, prog, description, default, arguments)
            with explained_imports(prog):
                function(options)
    except BrokenPipeError:
        # Python flushes once more at its end, and would complain then: docs.python.org, signal, "Note on SIGPIPE".
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(UNREAD)
    except AquanavError as error:
        if is_debug:
            raise
        print(f"error: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        print("error: stopped by Ctrl-C.", file=sys.stderr)
        sys.exit(INTERRUPTED)


def file_after(flag: str, arguments: Sequence[str]) -> Path | None:
    """Return the path that follows a flag on a command line, before the rest of it can be parsed; None without it."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument(flag, type=Path, dest="path")
    path: Path | None = parser.parse_known_args(arguments)[0].path
    return path


@contextlib.contextmanager
def _flushed_output() -> Iterator[None]:
    """Write all output when the body ends, also by SystemExit (--help): a closed pipe shows now, not at shutdown."""
    try:
        yield
    finally:
        sys.stdout.flush()


def _parse(
    options_type: type[Options], prog: str, description: str, default: Options | None, arguments: Sequence[str]
) -> Options:
    import tyro

    from aquanav_tools.cli.optional_values import optional_values

    text = f"{description}\n\nAdd {DEBUG_FLAG} to see the traceback of an error, and what libraries log."
    with optional_values():
        if default is None:
            return tyro.cli(options_type, prog=prog, description=text, args=arguments)
        return tyro.cli(options_type, prog=prog, description=text, args=arguments, default=default)


@contextlib.contextmanager
def stage_bar(title: str) -> Iterator[Progress]:
    """Show one stage as a progress bar with the time left; nothing where stderr is no terminal."""
    from tqdm import tqdm

    layout = "{desc} {percentage:3.0f}% |{bar:24}| {elapsed} < {remaining}"
    with tqdm(total=1, desc=f"{title:<30}", bar_format=layout, disable=NO_TERMINAL) as bar:

        def progress(done: int, total: int) -> None:
            bar.total = total
            bar.update(done - bar.n)

        try:
            yield progress
        except BaseException:
            bar.leave = False  # the message that follows says where it stopped
            raise
        bar.update((bar.total or 1) - bar.n)
