"""Where the search runs: on a CUDA graphics card where one is at hand, else on the processor.

Both run the same functions (planes.py, search.py), which numba compiles for either. Numba was chosen for the sake of
processors, where most of this runs: kernels of Warp run on one thread there, and a plane sweep in torch took 26 to 90 s
per photo. The price is that numba's CUDA target wants CUDA's compiler library (NVVM) on the machine.
The search has been run on the processor and in numba's CUDA simulator, and compiled for cards; its speed on a card has
not been measured (eval/benchmarks/depth.py does).
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from aquanav_tools.errors import ResourceError
from aquanav_tools.machine import num_cores
from aquanav_tools.reconstruct.dense.state import Photo, Planes, Search, Sources

Device = Literal["auto", "cpu", "cuda"]
Solve = Callable[[Photo, Sources, Planes, Search, int], None]
"""Chooses every pixel's sources and improves its plane in place, for a number of rounds."""
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Solver:
    """The search on a device."""

    solve: Solve
    at_once: int
    """Photos that are searched at the same time, each in its own thread."""


def solver(device: Device) -> Solver:
    """Return the search on a device; `auto` takes a graphics card that numba can use, else the processor.

    Raises:
        ResourceError: `cuda` was asked for, and cannot be used.
    """
    obstacle = "" if device == "cpu" else cuda_obstacle()
    if device == "cuda" and obstacle:
        raise ResourceError(f"{obstacle} Run with the device 'auto' or 'cpu' for the processor.")
    if device == "cpu" or obstacle:
        from aquanav_tools.reconstruct.dense import cpu

        return Solver(cpu.solve, num_cores())
    from aquanav_tools.reconstruct.dense import card

    return Solver(card.solve, 1)


def cuda_obstacle() -> str:
    """Return the sentence that says why no graphics card can be used; empty when one can."""
    from numba import cuda

    if not cuda.is_available():
        return "There is no CUDA graphics card here, or numba does not reach its driver."
    if _has_compiler():
        return ""
    sentence = (
        "There is a CUDA graphics card here, but numba does not find CUDA's compiler library (NVVM). Install the CUDA "
        "toolkit and set CUDA_HOME to its folder."
    )
    _log.warning("%s The processor is used.", sentence)
    return sentence


def _has_compiler() -> bool:
    from numba import config

    if config.ENABLE_CUDASIM:
        return True
    from numba.cuda.cudadrv import nvvm

    return bool(nvvm.is_available())
