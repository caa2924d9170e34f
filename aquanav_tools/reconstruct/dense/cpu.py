"""PatchMatch on the processor: one photo per thread, so that no core waits for what a photo cannot share.

What the kernels call is compiled into them (`forceinline`): with calls, fast arithmetic would add up in another order
in the process that compiles than in those that read the compiled code from disk.
"""

from __future__ import annotations

import numba
import numpy as np

from aquanav_tools.reconstruct.dense.planes import (
    ROWS,
    choose_sources,
    lay_out,
    num_samples,
    reject_vague,
)
from aquanav_tools.reconstruct.dense.search import improve
from aquanav_tools.reconstruct.dense.state import Photo, Planes, Search, Sources


def solve(photo: Photo, sources: Sources, planes: Planes, search: Search, iterations: int) -> None:
    """Choose every pixel's sources, improve its plane, and give up those that nothing tells, in place."""
    _choose(photo, sources, planes, search)
    for iteration in range(iterations):
        for colour in (0, 1):
            _sweep(colour, iteration, photo, sources, planes, search)
    if search.distinction > 0.0:
        _reject(photo, sources, planes, search._replace(agreement=np.float32(0.0)))


@numba.njit(cache=True, nogil=True, fastmath=True)
def _choose(photo, sources, planes, search):  # type: ignore[no-untyped-def]
    height, width = photo.image.shape
    patch = np.empty((ROWS, num_samples(search)), np.float32)
    lay_out(search, patch)
    for y in range(height):
        for x in range(width):
            choose_sources(x, y, photo, sources, planes, search, patch)


@numba.njit(cache=True, nogil=True, fastmath=True)
def _sweep(colour, iteration, photo, sources, planes, search):  # type: ignore[no-untyped-def]
    """Improve the pixels of one colour of the checkerboard: neighbours that are read are of the other one."""
    height, width = photo.image.shape
    patch = np.empty((ROWS, num_samples(search)), np.float32)
    lay_out(search, patch)
    for y in range(height):
        for x in range((y + colour) & 1, width, 2):
            improve(x, y, iteration, photo, sources, planes, search, patch)


@numba.njit(cache=True, nogil=True, fastmath=True)
def _reject(photo, sources, planes, search):  # type: ignore[no-untyped-def]
    height, width = photo.image.shape
    patch = np.empty((ROWS, num_samples(search)), np.float32)
    lay_out(search, patch)
    for y in range(height):
        for x in range(width):
            reject_vague(x, y, photo, sources, planes, search, patch)
