"""Steps written by hand are those of torch's Adam, and two networks that share a limit do not wait in vain."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from threading import BrokenBarrierError

import numpy as np
import pytest
import torch

from aquanav_tools.train.descent import Descent, Meeting

SHAPES = ((128, 31), (128,), (9, 128), (1,))


def weights() -> list[torch.nn.Parameter]:
    chance = torch.Generator().manual_seed(0)
    return [torch.nn.Parameter(torch.randn(shape, generator=chance)) for shape in SHAPES]


def test_steps_are_those_of_torchs_adam() -> None:
    """Ten steps by hand go on from ten of torch's, and torch goes on from them; float32 rounds by 6e-8 of a value."""
    chance = np.random.default_rng(1)
    ours, theirs = weights(), weights()
    mine, yours = (torch.optim.Adam(values, lr=1e-3, eps=1e-5) for values in (ours, theirs))
    gradients = [torch.zeros(shape) for shape in SHAPES]
    for turn in range(3):
        descent = Descent(mine, ours, gradients)
        for _ in range(10):
            for kept, one, other in zip(gradients, ours, theirs, strict=True):
                kept.copy_(torch.from_numpy(chance.normal(size=tuple(kept.shape)).astype(np.float32)))
                other.grad, one.grad = kept * 0.5, kept * 0.5
            if turn == 1:
                mine.step()
            else:
                descent.step(0.5)
            yours.step()
        if turn != 1:
            descent.end()
    for one, other in zip(ours, theirs, strict=True):
        assert torch.allclose(one, other, atol=1e-6)
        assert int(mine.state[one]["step"]) == int(yours.state[other]["step"]) == 30
        for name in ("exp_avg", "exp_avg_sq"):
            assert torch.allclose(mine.state[one][name], yours.state[other][name], rtol=1e-6, atol=1e-6)


def test_length_of_a_gradient() -> None:
    values = weights()
    gradients = [torch.full(shape, 2.0) for shape in SHAPES]
    descent = Descent(torch.optim.Adam(values), values, gradients)
    assert descent.square() == pytest.approx(4.0 * sum(math.prod(shape) for shape in SHAPES))


def test_another_optimiser_is_refused() -> None:
    values = weights()
    with pytest.raises(TypeError, match="plain Adam"):
        Descent(torch.optim.Adam(values, amsgrad=True), values, [])


@pytest.mark.parametrize(("squares", "scale"), [((9.0, 16.0), 0.1), ((0.01, 0.02), 1.0), ((math.nan, 1.0), math.nan)])
def test_both_sides_learn_the_same_scale(squares: tuple[float, float], scale: float) -> None:
    """A gradient of length 5 is shortened to 0.5; one of 0.17 is left alone; one that diverged is not hidden."""
    meeting = Meeting(0.5)
    with ThreadPoolExecutor(1) as helper:
        for step in range(5):
            other = helper.submit(meeting.scale, step, 1, squares[1])
            found = (meeting.scale(step, 0, squares[0]), other.result())
            assert found == pytest.approx((scale, scale), rel=1e-5, nan_ok=True)


def test_a_side_that_fails_lets_the_other_go() -> None:
    meeting = Meeting(0.5)
    with ThreadPoolExecutor(1) as helper:
        waiting = helper.submit(meeting.scale, 0, 1, 1.0)
        meeting.give_up()
        with pytest.raises(BrokenBarrierError):
            waiting.result(timeout=10.0)
