"""Products by the faster library: as exact as before, and only within the context."""

from __future__ import annotations

import pytest
import torch

from aquanav_tools.train import products
from aquanav_tools.train.products import fast_products

pytestmark = pytest.mark.skipif(
    not hasattr(torch.backends.mkldnn, "matmul"), reason="torch before 2.9 cannot be told which library multiplies"
)


def setting() -> str:
    return str(torch.backends.mkldnn.matmul.fp32_precision)


def test_products_are_of_float32_whichever_library_computes_them() -> None:
    torch.manual_seed(1)
    left, right = torch.randn(300, 512), torch.randn(512, 200)
    exact = left.double() @ right.double()
    with fast_products():
        found = left @ right
    # Rounded to float32's 24 bits in each of 512 terms and sums; bfloat16 has 8 and errs by a thousand times as much.
    assert (found.double() - exact).abs().max() < 512 * 2.0**-24 * (left.abs() @ right.abs()).max()


def test_the_setting_is_that_of_before_afterwards() -> None:
    before = setting()
    with pytest.raises(ZeroDivisionError), fast_products():
        raise ZeroDivisionError
    assert setting() == before


def test_a_library_that_rounds_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    before = setting()
    monkeypatch.setattr(products, "_error", lambda: 0.1)
    with fast_products() as is_fast:
        assert not is_fast
        assert setting() == before


def test_torch_that_cannot_be_told_stays_as_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(type(torch.backends.mkldnn), "matmul")
    with fast_products() as is_fast:
        assert not is_fast
