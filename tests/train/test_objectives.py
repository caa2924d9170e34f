"""Loss and gradient written by hand are those of torch's graph through its own distributions."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from torch.distributions import Categorical, Normal

from aquanav_tools.train.objectives import want_choices, want_levels

CLIP, PRICE, ROWS = 0.2, 0.05, 300


def decided(chance: np.random.Generator, log_probs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Return log probabilities before, so that a third of the ratios are clipped, and advantages of odd scale."""
    old = log_probs.detach() + torch.from_numpy(chance.normal(0.0, 0.2, ROWS).astype(np.float32))
    return old, torch.from_numpy(chance.normal(3.0, 7.0, ROWS).astype(np.float32))


def losses(
    log_probs: torch.Tensor, entropy: torch.Tensor, old: torch.Tensor, advantages: torch.Tensor
) -> list[torch.Tensor]:
    """Return entropy loss, policy loss, divergence and share clipped, as the paper and Stable-Baselines3 have them."""
    scaled = (advantages - advantages.mean()) / (advantages.std() + 1e-8)
    ratio = (log_probs - old).exp()
    surrogate = torch.min(scaled * ratio, scaled * ratio.clamp(1.0 - CLIP, 1.0 + CLIP))
    divergence = (ratio - 1.0 - (log_probs - old)).mean()
    return [-entropy.mean(), -surrogate.mean(), divergence, ((ratio - 1.0).abs() > CLIP).float().mean()]


@pytest.mark.parametrize(("num", "width"), [(3, 3), (1, 27), (2, 5)])
def test_choices(num: int, width: int) -> None:
    chance = np.random.default_rng(0)
    raw = torch.from_numpy(chance.normal(0.0, 2.0, (ROWS, num * width)).astype(np.float32)).requires_grad_()
    actions = torch.from_numpy(chance.integers(0, width, (ROWS, num)))
    law = Categorical(logits=raw.reshape(ROWS, num, width))
    log_probs = law.log_prob(actions).sum(dim=1)
    old, advantages = decided(chance, log_probs)
    expected = losses(log_probs, law.entropy().sum(dim=1), old, advantages)
    (slope,) = torch.autograd.grad(expected[1] + PRICE * expected[0], [raw])
    gradient = np.full(raw.shape, np.nan, np.float32)
    numbers = (actions.float().numpy(), old.numpy(), advantages.numpy())
    told = want_choices(raw.detach().numpy(), *numbers, num, CLIP, PRICE, gradient)
    assert told == pytest.approx([one.item() for one in expected], abs=1e-5)
    assert 0.1 < told[3] < 0.9
    assert np.abs(gradient - slope.numpy()).max() < 1e-5 * float(slope.abs().max())


def test_levels() -> None:
    chance = np.random.default_rng(1)
    raw = torch.from_numpy(chance.normal(0.0, 1.0, (ROWS, 3)).astype(np.float32)).requires_grad_()
    log_std = torch.tensor([-0.5, 0.0, 0.3], requires_grad=True)
    law = Normal(raw, log_std.exp())
    actions = law.sample()
    log_probs = law.log_prob(actions).sum(dim=1)
    old, advantages = decided(chance, log_probs)
    expected = losses(log_probs, law.entropy().sum(dim=1), old, advantages)
    slopes = torch.autograd.grad(expected[1] + PRICE * expected[0], [raw, log_std])
    gradients = np.full((ROWS, 3), np.nan, np.float32), np.full(3, np.nan, np.float32)
    numbers = (actions.numpy(), old.numpy(), advantages.numpy())
    told = want_levels(raw.detach().numpy(), log_std.detach().numpy(), *numbers, CLIP, PRICE, *gradients)
    assert told == pytest.approx([one.item() for one in expected], abs=1e-5)
    for found, slope in zip(gradients, slopes, strict=True):
        assert np.abs(found - slope.numpy()).max() < 1e-5 * float(slope.abs().max())
