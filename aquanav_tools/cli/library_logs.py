"""What libraries write to the terminal beside our own messages: held back, unless --debug asks for it."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TextIO

NATIVE_SETTINGS = {
    "GLOG_minloglevel": "3",  # COLMAP: only what ends the process; of the rest our own messages tell
    "NUMBA_THREADING_LAYER_PRIORITY": "omp tbb workqueue",  # it warns at each start of a TBB that is too old for it
    "OPENCV_FFMPEG_LOGLEVEL": "8",  # AV_LOG_FATAL; a damaged video makes a line per frame
    "OPENCV_LOG_LEVEL": "ERROR",
    "RUST_LOG": "error",  # rerun
}
"""Environment variables that tell native libraries, in worker processes too, how much to write. They write to file
descriptor 2 themselves; that is not redirected, so that the last words of a process that aborts are always seen."""
_INSTALLED = frozenset({"site-packages", "dist-packages"})
_PACKAGE = Path(__file__).parents[1]


@contextlib.contextmanager
def library_logs(*, shown: bool) -> Iterator[None]:
    """Show what libraries log and warn of while the body runs, or hold it back.

    Either way, what our own loggers warn of reaches stderr, and so do Python warnings that the user's own code causes,
    such as a policy's. What the user has set in the environment stays.
    """
    ours, every = logging.getLogger("aquanav_tools"), logging.getLogger()
    level, show = ours.level, warnings.showwarning
    stream = _AboveBars(sys.stderr)
    layout = "%(name)s: %(message)s" if shown else "%(prefix)s%(message)s"
    stream.setFormatter(logging.Formatter(layout, defaults={"prefix": "warning: "}))
    # Where the root has no handler, Python prints libraries' warnings by itself (logging.lastResort).
    handlers = [(every, stream)] if shown else [(ours, stream), (every, logging.NullHandler())]
    added = {} if shown else {name: value for name, value in NATIVE_SETTINGS.items() if name not in os.environ}
    os.environ.update(added)
    for logger, handler in handlers:
        logger.addHandler(handler)
    if shown:
        ours.setLevel(logging.INFO)
    else:
        warnings.showwarning = _without_libraries(show)
    try:
        yield
    finally:
        ours.setLevel(level)
        warnings.showwarning = show
        for logger, handler in handlers:
            logger.removeHandler(handler)
        for name in added:
            os.environ.pop(name, None)


class _AboveBars(logging.StreamHandler):  # type: ignore[type-arg]  # Python 3.10 takes no argument here
    """Writes each line above the progress bars that there are."""

    def emit(self, record: logging.LogRecord) -> None:
        from tqdm import tqdm

        tqdm.write(self.format(record), file=self.stream)


def _without_libraries(show: Callable[..., None]) -> Callable[..., None]:
    """Return a `warnings.showwarning` that leaves out what installed packages, or this one's sums, warn of."""

    def show_own(
        message: Warning | str,
        category: type[Warning],
        filename: str,
        lineno: int,
        file: TextIO | None = None,
        line: str | None = None,
    ) -> None:
        path = Path(filename)
        if _INSTALLED.isdisjoint(path.parts) and _PACKAGE not in path.parents:
            show(message, category, filename, lineno, file, line)

    return show_own
