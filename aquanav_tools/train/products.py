"""Matrix products by the faster of torch's two libraries, where it rounds no more.

On the processor torch hands products to MKL, which leaves AVX-512 unused on AMD's. oneDNN, which torch brings too, uses
it, but gets float32 only where it may round to bfloat16, which it does on processors with AMX alone. So that is allowed
where a product shows that nothing is rounded.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import torch

SIZE = 512
"""Rows, columns and terms of the product that is tried: larger than small ones that have kernels of their own."""
MAX_ERROR = 2e-3
"""Of a sum of SIZE products of values of about 1: float32 errs by 1e-4 at most, bfloat16 by 1e-1."""


@contextmanager
def fast_products() -> Iterator[bool]:
    """Let oneDNN multiply in float32 within the context; yield whether it does."""
    matmul: Any = getattr(torch.backends.mkldnn, "matmul", None)  # torch before 2.9 has none
    if matmul is None or not torch.backends.mkldnn.is_available():  # type: ignore[no-untyped-call]
        yield False
        return
    before = matmul.fp32_precision
    try:
        matmul.fp32_precision = "bf16"
        is_exact = _error() < MAX_ERROR
        if not is_exact:
            matmul.fp32_precision = before
        yield is_exact
    finally:
        matmul.fp32_precision = before


def _error() -> float:
    """Return the greatest error of a product."""
    left, right = np.random.default_rng(0).standard_normal((2, SIZE, SIZE), dtype=np.float32)
    product = (torch.from_numpy(left) @ torch.from_numpy(right)).numpy()
    return float(np.abs(product - left.astype(np.float64) @ right.astype(np.float64)).max())
