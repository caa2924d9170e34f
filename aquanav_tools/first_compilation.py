"""Saying once that numba or Warp compile for the first time here, which takes a minute in which nothing else shows.

Both compile when a function is first called, deep within the work, and keep what they made; so who waits is told then,
and nothing is said where all comes from the cache. Processes that one command starts speak for it only once.
"""

from __future__ import annotations

import atexit
import contextlib
import importlib.abc
import importlib.util
import logging
import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import ModuleType
from typing import Any

from aquanav_tools.compile_caches import MARK_VARIABLE
from aquanav_tools.outdated_code import forget_outdated

SENTENCE = "Compiling for the first time on this machine: a minute or two in all, and only once."
NO_PREFIX = {"prefix": ""}
"""Of a log record that is no warning, for the command line; see `cli.library_logs`."""
_OURS = __package__ + "."
_waiting: list[Callable[[], None]] = []
"""What is called when numba compiles next."""
logger = logging.getLogger(__name__)


def watch_numba() -> None:
    """Have numba tell when it compiles a function of ours that it keeps, once it is imported."""
    if MARK_VARIABLE not in os.environ:
        mark = Path(_temporary_folder(), f"aquanav-compiling-{os.getpid()}-{time.time_ns()}")
        os.environ[MARK_VARIABLE] = str(mark)
        atexit.register(_remove, mark, os.getpid())
    if "numba" in sys.modules:
        _listen()
    else:
        sys.meta_path.insert(0, _NumbaFinder())


def say_compiling() -> None:
    """Log the sentence, once for this process and all that it was started by or starts."""
    mark = os.environ.get(MARK_VARIABLE)
    if mark and _is_first(Path(mark)):
        logger.warning(SENTENCE, extra=NO_PREFIX)


@contextlib.contextmanager
def on_first_compilation(call: Callable[[], None] | None) -> Iterator[None]:
    """Have something called, at most once, when numba compiles a function of ours while the body runs."""
    if call is None:
        yield
        return
    _waiting.append(call)
    try:
        yield
    finally:
        with contextlib.suppress(ValueError):  # it was called
            _waiting.remove(call)


def _temporary_folder() -> str:
    try:
        return tempfile.gettempdir()
    except FileNotFoundError:  # there is none that can be written to
        return os.devnull


def _is_first(mark: Path) -> bool:
    try:
        mark.touch(exist_ok=False)
    except FileExistsError:
        return False
    except OSError:  # no place for temporary files: better twice than never
        return True
    return True


def _remove(mark: Path, owner: int) -> None:
    if os.getpid() == owner:  # not in a forked child
        with contextlib.suppress(OSError):
            mark.unlink()


class _NumbaFinder(importlib.abc.MetaPathFinder):
    """Starts to listen once numba is imported: importing it for that would take half a second from each command."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != "numba":
            return None
        others = (finder for finder in sys.meta_path if finder is not self and hasattr(finder, "find_spec"))
        spec = next(filter(None, (finder.find_spec(fullname, path, target) for finder in others)), None)
        if spec is not None and spec.loader is not None:
            run = spec.loader.exec_module

            def run_and_listen(module: ModuleType) -> None:
                run(module)
                _listen()

            spec.loader.exec_module = run_and_listen  # type: ignore[method-assign]
        return spec


def _listen() -> None:
    from numba.core import event

    forget_outdated(Path(__file__).parent)

    class Listener(event.Listener):  # type: ignore[misc]
        def on_start(self, event: Any) -> None:
            function = event.data["dispatcher"]
            # One without a place in the cache is compiled in every process, which takes no time worth a word.
            if function.py_func.__module__.startswith(_OURS) and function.stats.cache_path is not None:
                say_compiling()
                while _waiting:
                    _waiting.pop()()

        def on_end(self, event: Any) -> None:
            """Do nothing."""

    event.register("numba:compile", Listener())
