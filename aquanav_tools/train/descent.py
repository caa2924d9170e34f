"""Torch's Adam for one of two networks that learn side by side, in one pass over each of its arrays.

The two share a limit on the length of their joint gradient (`Meeting`) and otherwise do not wait for each other.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Sequence
from typing import Any

import numba
import numpy as np
import torch


class Descent:
    """Steps of some of an optimiser's parameters; values and moments stay the optimiser's own."""

    def __init__(self, optimiser: Any, parameters: Sequence[torch.Tensor], gradients: Sequence[torch.Tensor]) -> None:
        """Take the settings of the optimiser's first group.

        Raises:
            TypeError: the optimiser is not plain Adam.
        """
        group = optimiser.param_groups[0]
        if type(optimiser) is not torch.optim.Adam or group["weight_decay"] or group["amsgrad"] or group["maximize"]:
            raise TypeError(f"Descent is that of plain Adam, not of {optimiser}.")
        self._decays = tuple(map(float, group["betas"]))
        self._rate, self._tiny = float(group["lr"]), float(group["eps"])
        self._states = [_state_of(optimiser, one) for one in parameters]
        self._count = int(self._states[0]["step"])
        self._rows = [
            (_flat(value), _flat(gradient), _flat(state["exp_avg"]), _flat(state["exp_avg_sq"]))
            for value, gradient, state in zip(parameters, gradients, self._states, strict=True)
        ]

    def square(self) -> float:
        """Return the square of the gradient's length."""
        return float(sum(_square(gradient) for _, gradient, _, _ in self._rows))

    def step(self, scale: float) -> None:
        """Take one step along the gradient times `scale`."""
        self._count += 1
        first, second = self._decays
        rate = self._rate / (1.0 - first**self._count)
        correction = 1.0 / math.sqrt(1.0 - second**self._count)
        settings = (scale, first, 1.0 - first, second, 1.0 - second, rate, correction, self._tiny)
        for row in self._rows:
            _descend(*row, *map(np.float32, settings))

    def end(self) -> None:
        """Let the optimiser know how many steps were taken."""
        for state in self._states:
            state["step"].fill_(float(self._count))


class Meeting:
    """Where two threads learn how long their joint gradient is, once per step."""

    def __init__(self, limit: float) -> None:
        """Set the greatest length."""
        self._limit = limit
        self._barrier = threading.Barrier(2)
        self._squares = np.zeros((2, 2))

    def scale(self, step: int, side: int, square: float) -> float:
        """Wait for the other side's square; return what to multiply the gradient with.

        Args:
            step: How many steps were taken before; a fast side is never more than one ahead, so that two slots do.
            side: 0 or 1.
            square: Of the length of this side's gradient.

        Raises:
            BrokenBarrierError: the other side gave up.
        """
        slot = self._squares[step % 2]
        slot[side] = square
        self._barrier.wait()
        return float(np.minimum(self._limit / (math.sqrt(slot[0] + slot[1]) + 1e-6), 1.0))  # nan stays nan

    def give_up(self) -> None:
        """Let the other side wait no longer."""
        self._barrier.abort()


def _state_of(optimiser: Any, parameter: torch.Tensor) -> dict[str, torch.Tensor]:
    """Return torch's record of a parameter, made as torch would make it where no step was taken yet."""
    state: dict[str, torch.Tensor] = optimiser.state[parameter]
    if not state:
        state["step"] = torch.tensor(0.0)
        state["exp_avg"], state["exp_avg_sq"] = torch.zeros_like(parameter), torch.zeros_like(parameter)
    return state


def _flat(tensor: torch.Tensor) -> Any:
    """Return a view of all numbers, to be written to."""
    return tensor.detach().view(-1).numpy()


@numba.njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _square(values: Any) -> float:
    total = 0.0
    for value in values:
        total += value * value
    return total


@numba.njit(cache=True, nogil=True, fastmath={"contract", "arcp"}, error_model="numpy")
def _descend(
    values: Any, gradients: Any, means: Any, squares: Any, scale: Any, first: Any, new: Any, second: Any,
    new_square: Any, rate: Any, correction: Any, tiny: Any,
) -> None:  # fmt: skip
    """Kingma and Ba (2015, arXiv:1412.6980), algorithm 1; `new` is 1 - `first`, which float32 would round by 5e-5."""
    for n in range(len(values)):
        gradient = gradients[n] * scale
        means[n] = first * means[n] + new * gradient
        squares[n] = second * squares[n] + new_square * gradient * gradient
        values[n] -= rate * means[n] / (np.sqrt(squares[n]) * correction + tiny)
