"""Gradients written by hand are those of torch's graph."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch import nn

from aquanav_tools.train.towers import Tower, swish


def test_swish_and_its_slope_are_torchs() -> None:
    """The quotient of polynomials errs by a few units of the last place of a share, 6e-8, times |z|."""
    values = torch.linspace(-30.0, 30.0, 20_001)
    exact = values.double().requires_grad_()
    expected = nn.functional.silu(exact)
    expected.sum().backward()  # type: ignore[no-untyped-call]
    slope, activated = values.numpy().copy(), np.empty(len(values), np.float32)
    swish(slope, activated)
    tolerance = 3e-7 * (1.0 + values.abs().double())
    assert (torch.from_numpy(activated).double() - expected.detach()).abs().sub(tolerance).max() < 0.0
    assert exact.grad is not None
    assert (torch.from_numpy(slope).double() - exact.grad).abs().sub(tolerance).max() < 0.0


@pytest.mark.parametrize("hidden", [[], [16], [24, 8, 32]])
def test_gradients_are_those_of_torchs_graph(hidden: list[int]) -> None:
    """Also after a batch of another size; sums of 200 in another order round by 1e-5 of the largest at most."""
    torch.manual_seed(0)
    layers: list[nn.Module] = []
    for a, b in zip([7, *hidden], hidden, strict=False):
        layers += [nn.Linear(a, b), nn.SiLU()]
    layers.append(nn.Linear([7, *hidden][-1], 4))
    tower, network = Tower(layers), nn.Sequential(*layers)
    for rows in (200, 60):
        features, gradient = torch.randn(rows, 7), torch.randn(rows, 4)
        expected = torch.autograd.grad(network(features), list(network.parameters()), gradient)
        for gradient_kept in tower.gradients:
            gradient_kept.fill_(np.nan)
        assert torch.allclose(tower.ahead(features), network(features), atol=1e-5)
        tower.back(gradient)
        for found, one in zip(tower.gradients, expected, strict=True):
            assert torch.allclose(found, one, atol=1e-5 * float(one.abs().max()))


def test_other_layers_are_refused() -> None:
    with pytest.raises(TypeError, match="swish"):
        Tower([nn.Linear(3, 3), nn.Tanh(), nn.Linear(3, 1)])
