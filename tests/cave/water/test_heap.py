"""The heap of compiled searches pops as the standard library's does."""

from __future__ import annotations

import heapq

import numpy as np

from aquanav_tools.cave.water.heap import empty_heap, pop, push


def test_items_come_out_as_from_heapq_whatever_goes_in_between(rng: np.random.Generator) -> None:
    (numbers, items), size, truth = empty_heap(), 0, []
    for item in range(20_000):  # more than there is room for at first
        number = float(rng.integers(0, 500))  # often equal
        numbers, items = push(numbers, items, size, number, item)
        size += 1
        heapq.heappush(truth, (number, item))
        while size and rng.random() < 0.4:
            assert pop(numbers, items, size) == heapq.heappop(truth)
            size -= 1
    assert len(truth) == size > 5000
    while size:
        assert pop(numbers, items, size) == heapq.heappop(truth)
        size -= 1
