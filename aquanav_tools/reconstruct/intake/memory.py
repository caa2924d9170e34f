"""The memory that the search for features takes, and how many photos may be searched at once within what is free."""

from __future__ import annotations

from collections.abc import Iterable

from aquanav_tools.machine import num_cores

SIFT_SIDE = 3200
"""Longer side, px, to which COLMAP shrinks photos for SIFT."""
_SIFT_BYTES = 290.0
"""Per pixel and thread (measured on fountain-P11 at three sizes)."""
_SHARE = 0.7
"""Of the free memory that may be taken."""


def shrunk_px(width: int, height: int, side: int) -> float:
    """Return the pixels of a photo whose longer side is shrunk to a limit."""
    return width * height * min(1.0, side / max(width, height)) ** 2


def sift_bytes(sizes: Iterable[tuple[int, int]], threads: int) -> float:
    """Return the memory that the search takes at most, for photos of some widths and heights, px."""
    return threads * _SIFT_BYTES * max(shrunk_px(*size, SIFT_SIDE) for size in sizes)


def sift_threads(sizes: Iterable[tuple[int, int]], free_bytes: int) -> int:
    """Return how many photos may be searched at once: one at least, one per core at most."""
    fitting = int(_SHARE * free_bytes / sift_bytes(sizes, 1))
    return max(1, min(num_cores(), fitting))
