"""PatchMatch on a CUDA graphics card: one thread per pixel, the functions of the processor compiled once more."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numba import cuda

from aquanav_tools.reconstruct.dense.planes import (
    MAX_SAMPLES,
    ROWS,
    choose_sources,
    lay_out,
    num_samples,
    reject_vague,
)
from aquanav_tools.reconstruct.dense.search import improve
from aquanav_tools.reconstruct.dense.state import Photo, Planes, Search, Sources

BLOCK = (16, 8)
"""Threads along x and y."""


def solve(photo: Photo, sources: Sources, planes: Planes, search: Search, iterations: int) -> None:
    """Choose every pixel's sources, improve its plane, and give up those that nothing tells, in place."""
    height, width = photo.image.shape
    there = [_sent(values) for values in (photo, sources, planes)]
    choose[_grid(width, height), BLOCK](*there, search)
    for iteration in range(iterations):
        for colour in (0, 1):
            sweep[_grid((width + 1) // 2, height), BLOCK](colour, iteration, *there, search)
    if search.distinction > 0.0:
        reject[_grid(width, height), BLOCK](*there, search._replace(agreement=np.float32(0.0)))
    for array, result in zip(planes, there[2], strict=True):
        result.copy_to_host(array)


def _sent(values: Any) -> Any:
    """Return the same tuple with its arrays in the card's memory."""
    return type(values)(*(cuda.to_device(value) if isinstance(value, np.ndarray) else value for value in values))


def _grid(width: int, height: int) -> Sequence[int]:
    return -(-width // BLOCK[0]), -(-height // BLOCK[1])


@cuda.jit(fastmath=True)
def choose(photo, sources, planes, search):  # type: ignore[no-untyped-def]
    """Choose the sources of a thread's pixel."""
    x, y = cuda.grid(2)
    height, width = photo.image.shape
    if x >= width or y >= height:
        return
    room = cuda.local.array((ROWS, MAX_SAMPLES), np.float32)
    patch = room[:, : num_samples(search)]
    lay_out(search, patch)
    choose_sources(x, y, photo, sources, planes, search, patch)


@cuda.jit(fastmath=True)
def sweep(colour, iteration, photo, sources, planes, search):  # type: ignore[no-untyped-def]
    """Improve a thread's pixel, the x-th of its colour in a row of the checkerboard."""
    half_x, y = cuda.grid(2)
    x = 2 * half_x + ((y + colour) & 1)
    height, width = photo.image.shape
    if x >= width or y >= height:
        return
    room = cuda.local.array((ROWS, MAX_SAMPLES), np.float32)
    patch = room[:, : num_samples(search)]
    lay_out(search, patch)
    improve(x, y, iteration, photo, sources, planes, search, patch)


@cuda.jit(fastmath=True)
def reject(photo, sources, planes, search):  # type: ignore[no-untyped-def]
    """Give up a thread's pixel where nothing tells its depth."""
    x, y = cuda.grid(2)
    height, width = photo.image.shape
    if x >= width or y >= height:
        return
    room = cuda.local.array((ROWS, MAX_SAMPLES), np.float32)
    patch = room[:, : num_samples(search)]
    lay_out(search, patch)
    reject_vague(x, y, photo, sources, planes, search, patch)
