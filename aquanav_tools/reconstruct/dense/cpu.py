"""PatchMatch on the processor: rows in parallel, the result the same for any number of threads."""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.reconstruct.dense.planes import (
    ROWS,
    choose_sources,
    lay_out,
    num_samples,
)
from aquanav_tools.reconstruct.dense.search import improve
from aquanav_tools.reconstruct.dense.state import Photo, Planes, Search, Sources


def solve(photo: Photo, sources: Sources, planes: Planes, search: Search, iterations: int) -> None:
    """Choose every pixel's sources, then improve its plane, in place."""
    _choose(photo, sources, planes, search)
    for iteration in range(iterations):
        for colour in (0, 1):
            _sweep(colour, iteration, photo, sources, planes, search)


# A row is counted unsigned by numba, and unsigned plus signed would be float: hence np.int64.


@numba.njit(cache=True, parallel=True, fastmath=True)
def _choose(photo, sources, planes, search):  # type: ignore[no-untyped-def]
    height, width = photo.image.shape
    for row in numba.prange(height):
        patch = np.empty((ROWS, num_samples(search)), np.float32)
        lay_out(search, patch)
        for x in range(width):
            choose_sources(x, np.int64(row), photo, sources, planes, search, patch)


@numba.njit(cache=True, parallel=True, fastmath=True)
def _sweep(colour, iteration, photo, sources, planes, search):  # type: ignore[no-untyped-def]
    """Improve the pixels of one colour of the checkerboard: neighbours that are read are of the other one."""
    height, width = photo.image.shape
    for row in numba.prange(height):
        y = np.int64(row)
        patch = np.empty((ROWS, num_samples(search)), np.float32)
        lay_out(search, patch)
        for x in range((y + colour) & 1, width, 2):
            improve(x, y, iteration, photo, sources, planes, search, patch)
