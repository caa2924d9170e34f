"""A chain of linear layers with swish between them, whose values and gradients are written into buffers kept for it.

Torch's own graph makes each of these arrays anew, and computes the exponential of swish twice, ahead and back. Here it
is computed once, as a quotient of polynomials that the compiler puts into vector instructions.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numba
import torch
from torch import nn

SATURATED = 7.90531110763549805
"""Beyond it, the quotient's hyperbolic tangent is 1 in float32."""
ODD = (4.89352455891786e-3, 6.37261928875436e-4, 1.48572235717979e-5, 5.12229709037114e-8, -8.60467152213735e-11,
       2.00018790482477e-13, -2.76076847742355e-16)  # fmt: skip
EVEN = (4.89352518554385e-3, 2.26843463243900e-3, 1.18534705686654e-4, 1.19825839466702e-6)
"""Coefficients of x, x^3, ... and 1, x^2, ... in tanh(x), to a few units of the last place of float32.

Source: Eigen, Eigen/src/Core/MathFunctionsImpl.h, generic_fast_tanh_float (version 3.4).
"""
_LIMIT, _ODD, _EVEN = (numba.float32(SATURATED), *(tuple(map(numba.float32, row)) for row in (ODD, EVEN)))


@numba.njit(cache=True, nogil=True, fastmath=True, error_model="numpy")
def swish(values: Any, activated: Any) -> None:
    """Write z / (1 + exp(-z)) of (M,) `values` to (M,) `activated`, and its slope in their own place."""
    half, one = numba.float32(0.5), numba.float32(1.0)
    for n in range(len(values)):
        z = values[n]
        t = min(max(half * z, -_LIMIT), _LIMIT)
        u = t * t
        odd = _ODD[3] + u * (_ODD[4] + u * (_ODD[5] + u * _ODD[6]))
        odd = t * (_ODD[0] + u * (_ODD[1] + u * (_ODD[2] + u * odd)))
        even = _EVEN[0] + u * (_EVEN[1] + u * (_EVEN[2] + u * _EVEN[3]))
        share = half + half * (odd / even)
        result = z * share
        activated[n] = result
        values[n] = share + result * (one - share)


class Tower:
    """The layers from features to a network's raw output; they stay the network's own."""

    def __init__(self, layers: Iterable[nn.Module]) -> None:
        """Take linear layers, each but the last followed by swish.

        Raises:
            TypeError: the layers are others.
        """
        *body, head = layers
        kinds = (nn.Linear, nn.SiLU)
        if not isinstance(head, nn.Linear) or any(type(one) is not kinds[n % 2] for n, one in enumerate(body)):
            raise TypeError(f"A tower is linear layers with swish between them, not {[*body, head]}.")
        self._linear: list[nn.Linear] = [*body[::2], head]  # type: ignore[list-item]  # checked above
        self.parameters = [tensor for layer in self._linear for tensor in (layer.weight, layer.bias)]
        self.gradients = [torch.zeros_like(one) for one in self.parameters]
        """What `back` writes; one for each of `parameters`."""
        self._values: list[torch.Tensor] = []
        self._slopes: list[torch.Tensor] = []
        self._changes: list[torch.Tensor] = []

    def ahead(self, features: torch.Tensor) -> torch.Tensor:
        """Return the (N, K) output for (N, F) features, in a buffer that the next call writes to."""
        self._make_room(len(features))
        values = features
        with torch.no_grad():
            for layer, slope, activated in zip(self._linear[:-1], self._slopes, self._values[1:], strict=True):
                torch.addmm(layer.bias, values, layer.weight.t(), out=slope)
                swish(slope.view(-1).numpy(), activated.view(-1).numpy())
                values = activated
            head = self._linear[-1]
            self._values[0] = features
            return torch.addmm(head.bias, values, head.weight.t())

    def back(self, gradient: torch.Tensor) -> None:
        """Write `gradients`.

        Args:
            gradient: (N, K) of the output that `ahead` returned last.
        """
        with torch.no_grad():
            for n in range(len(self._linear) - 1, -1, -1):
                torch.mm(gradient.t(), self._values[n], out=self.gradients[2 * n])
                torch.sum(gradient, 0, out=self.gradients[2 * n + 1])
                if n > 0:
                    change = self._changes[n - 1]
                    torch.mm(gradient, self._linear[n].weight, out=change)
                    gradient = change.mul_(self._slopes[n - 1])

    def _make_room(self, rows: int) -> None:
        if self._slopes and len(self._slopes[0]) == rows:
            return
        widths = [layer.out_features for layer in self._linear[:-1]]
        self._slopes, self._changes, values = ([torch.empty(rows, width) for width in widths] for _ in range(3))
        self._values = [torch.empty(0), *values]
