"""Progress bars for whoever asks for them: on stderr, with the time left, where that is a terminal."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterator

from tqdm import tqdm

from aquanav_tools.types import Progress, Stages, silent


@contextlib.contextmanager
def bar(title: str, unit: str = "", *, shown: bool = True) -> Iterator[Progress]:
    """Yield what long work tells its progress."""
    # disable=None: no bar where stderr is no terminal
    with tqdm(desc=title or None, unit=unit, file=sys.stderr, delay=0.5, disable=None if shown else True) as drawn:

        def show(done: int, total: int) -> None:
            if drawn.total is None:
                drawn.initial = drawn.n = done  # what a stopped run did says nothing about the speed of this one
            drawn.total = total
            drawn.update(done - drawn.n)

        yield show


def stages(shown: bool) -> Stages:
    """Return what shows a bar for each stage, or nothing."""
    return bar if shown else silent
