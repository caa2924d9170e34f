"""A picture's rows shared out among the processor's cores: compiled functions that let go of Python's lock."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from aquanav_tools.machine import num_cores

BANDS_PER_CORE = 2
"""So that no core waits long for one that has more to draw, or something else to do."""


def in_bands(height: int, draw: Callable[[int, int], None]) -> None:
    """Call `draw` with the first row of each band and the one behind its last, as many at once as there are cores."""
    bounds = np.linspace(0, height, BANDS_PER_CORE * num_cores() + 1).astype(int).tolist()
    for _ in _threads(os.getpid()).map(draw, bounds[:-1], bounds[1:]):
        pass


@functools.cache
def _threads(_process: int) -> ThreadPoolExecutor:
    """Return a process's own threads: one that was forked has none of its parent's."""
    return ThreadPoolExecutor(num_cores())
