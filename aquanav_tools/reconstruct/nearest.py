"""Keypoints of two photos that are each other's clearly best match: all are compared, none of them approximately.

An exact search by matrix products takes no longer than an approximate one by trees, and finds a sixth more true matches
(measured on the demo's photos). Products of descriptors are whole numbers below 2^24, which float32 holds: they come
out the same on every processor, also on one that multiplies in bfloat16, which holds the bytes of a descriptor.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numba
import numpy as np
import numpy.typing as npt

Matches = npt.NDArray[np.uint32]
"""(M, 2) rows of keypoints in the first and the second photo."""
Descriptors = npt.NDArray[np.uint8]
"""(K, 128) as COLMAP keeps them: unit vectors times 512, rounded."""
Float32Array = npt.NDArray[np.float32]
IntArray = npt.NDArray[np.int64]

_UNIT = 512
_MAX_RATIO = 0.8
"""Of a keypoint's angle to its best match over that to the second best (Lowe, IJCV 2004); both ways."""
_MAX_ANGLE = 0.7
"""Between matching descriptors, radians: COLMAP's own limit."""
_ROWS = 256
"""Compared at once: what they give stays in the processor's cache. A multiple of four."""
_NOTHING = np.float32(-1.0)
"""Below every product."""


@contextmanager
def products_in_one_thread() -> Iterator[None]:
    """Let each caller multiply in its own thread, in the way that its processor does fastest.

    Threads within products this short wait for each other: a pair of photos took 0.33 s of CPU time with two, 0.09 with
    one, and 0.05 where the processor multiplies in bfloat16 (measured).
    """
    import torch

    threads, precision = torch.get_num_threads(), torch.get_float32_matmul_precision()
    torch.set_num_threads(1)
    torch.set_float32_matmul_precision("medium")
    try:
        yield
    finally:
        torch.set_num_threads(threads)
        torch.set_float32_matmul_precision(precision)


def best_matches(here: Descriptors, there: Descriptors) -> Matches:
    """Return the keypoints that are each other's best match, clearly better than the second best on both sides.

    Args:
        here: (K, 128) descriptors of one photo.
        there: (L, 128) of another one.
    """
    import torch

    count, other = len(here), len(there)
    if min(count, other) < 2:
        return np.zeros((0, 2), np.uint32)
    left, right = (torch.from_numpy(one.astype(np.float32)) for one in (here, there))
    best_back, next_back = np.full((2, other), _NOTHING)
    products = np.empty((_ROWS, other), np.float32)
    found = []
    for start in range(0, count, _ROWS):
        num_rows = min(_ROWS, count - start)
        torch.mm(left[start : start + num_rows], right.T, out=torch.from_numpy(products[:num_rows]))
        products[num_rows:] = _NOTHING
        _raise_columns(products, best_back, next_back)
        rows, columns, best = _clear_rows(products[:num_rows], best_back, next_back)
        found.append((start + rows, columns, best))
    rows, columns, best = (np.concatenate(parts) for parts in zip(*found, strict=True))
    is_kept = _may_match(best, best_back[columns], next_back[columns])
    return np.column_stack((rows, columns))[is_kept].astype(np.uint32)


def _clear_rows(
    products: Float32Array, best_back: Float32Array, next_back: Float32Array
) -> tuple[IntArray, IntArray, Float32Array]:
    """Return rows with a clearly best column that may still match, those columns, and the products."""
    columns = products.argmax(axis=1)
    best = products[np.arange(len(products)), columns]
    rows = np.flatnonzero(_may_match(best, best_back[columns], next_back[columns]))
    columns, best = columns[rows], best[rows]
    rest = products[rows]
    rest[np.arange(len(rows)), columns] = _NOTHING
    is_clear = _is_clear(best, rest.max(axis=1, initial=_NOTHING))
    return rows[is_clear], columns[is_clear], best[is_clear]


def _may_match(best: Float32Array, best_back: Float32Array, next_back: Float32Array) -> npt.NDArray[np.bool_]:
    """Return which products are the best of their columns too, and clear there; more rows only ever make it fewer."""
    return (best == best_back) & _is_clear(best_back, next_back)


def _is_clear(best: Float32Array, second: Float32Array) -> npt.NDArray[np.bool_]:
    angle, second_angle = (np.arccos(np.clip(one / np.float64(_UNIT**2), 0.0, 1.0)) for one in (best, second))
    return (angle < _MAX_ANGLE) & (angle < _MAX_RATIO * second_angle)


@numba.njit(cache=True, nogil=True, fastmath=True)
def _raise_columns(products, best, second):  # type: ignore[no-untyped-def]
    """Raise the best and second best of each column by some more rows, four at a time."""
    for i in range(0, len(products), 4):
        row_a, row_b, row_c, row_d = products[i], products[i + 1], products[i + 2], products[i + 3]
        for j in range(len(best)):
            a, b, c, d = row_a[j], row_b[j], row_c[j], row_d[j]
            high, low, higher, lower = max(a, b), min(a, b), max(c, d), min(c, d)
            low = max(min(high, higher), max(low, lower))
            high = max(high, higher)
            before = best[j]
            second[j] = max(min(before, high), max(second[j], low))
            best[j] = max(before, high)
