"""Distributions of choices are those of torch."""

from __future__ import annotations

import pytest
import torch
from torch.distributions import Categorical

from aquanav_tools.train.distributions import Choices

ROWS = 300


@pytest.mark.parametrize(("num_choices", "options"), [(3, 3), (1, 27), (2, 5)])
def test_log_probabilities_and_entropy_are_torchs_with_their_gradients(num_choices: int, options: int) -> None:
    """float32 rounds a sum of some terms of size 10 by 1e-6."""
    torch.manual_seed(0)
    logits = torch.randn(ROWS, num_choices * options).mul(2.0).requires_grad_()
    actions = torch.randint(options, (ROWS, num_choices))
    law = Categorical(logits=logits.double().reshape(ROWS, num_choices, options))
    expected = law.log_prob(actions).sum(dim=1), law.entropy().sum(dim=1)
    choices = Choices(logits, num_choices)
    weights = torch.randn(ROWS)
    for mine, theirs in zip((choices.log_prob(actions.float()), choices.entropy()), expected, strict=True):
        assert torch.allclose(mine.double(), theirs, atol=1e-5)
        (found,) = torch.autograd.grad((weights * mine).sum(), logits, retain_graph=True)
        (wanted,) = torch.autograd.grad((weights * theirs).sum(), logits, retain_graph=True)
        assert torch.allclose(found, wanted, atol=1e-5)


def test_samples_come_as_often_as_their_probabilities_say() -> None:
    """Of 40,000 draws a share of a half errs by 0.0025; five times that in none of four options."""
    torch.manual_seed(0)
    probs = torch.tensor([[0.5, 0.3, 0.2], [0.1, 0.1, 0.8]])
    drawn = Choices(probs.log().reshape(1, 6).repeat(40_000, 1), 2).sample()
    assert drawn.shape == (40_000, 2)
    for choice, expected in enumerate(probs):
        shares = torch.bincount(drawn[:, choice], minlength=3) / len(drawn)
        assert torch.allclose(shares, expected, atol=0.0125)
