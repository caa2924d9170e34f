"""What PPO wants of an actor: its loss for a minibatch of decisions, and the gradient that this asks of the network.

The loss is the clipped surrogate of Schulman et al. (2017, arXiv:1707.06347, equation 7) less a price on entropy, as
in Stable-Baselines3. A graph of torch's would spend a third of the update's time here, on arrays of nine columns.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numba
import numpy as np
import numpy.typing as npt

TINY = 1e-8
"""Added to the advantages' spread, as in SB3."""
HALF_LOG_TAU = 0.5 * math.log(2.0 * math.pi)
Floats = npt.NDArray[np.float32]


class Told(NamedTuple):
    """Means over a minibatch, as SB3 logs them."""

    entropy_loss: float
    policy_loss: float
    divergence: float
    """Approximate Kullback-Leibler divergence from the policy that chose the actions."""
    clipped: float
    """Share of the decisions that the policy now takes too much more, or less, often to learn from."""


@numba.njit(cache=True, nogil=True, error_model="numpy")
def want_choices(
    raw: Any, actions: Any, old: Any, advantages: Any, num: int, clip: float, price: float, gradient: Any
) -> tuple[float, float, float, float]:
    """Write the loss's gradient by the logits of independent choices; return what `Told` holds.

    Args:
        raw: (N, K) logits, K / num for each choice.
        actions: (N, num) chosen, as floats.
        old: (N,) log probabilities of the actions when they were chosen.
        advantages: (N,) of the actions, as estimated.
        num: Of choices.
        clip: Range of the ratio of probabilities.
        price: Of entropy.
        gradient: (N, K), written.
    """
    rows, width = len(raw), raw.shape[1] // num
    mean, spread = _middle(advantages)
    toll, part = np.float32(price / rows), 1.0 / rows
    entropy, surrogate, divergence, clipped = 0.0, 0.0, 0.0, 0
    logs, entropies = np.empty(raw.shape[1], np.float32), np.empty(num, np.float32)
    for row in range(rows):
        shares = gradient[row]
        log_prob = 0.0
        for n in range(num):
            entropies[n] = _weigh(raw[row], logs, shares, n * width, (n + 1) * width)
            entropy += entropies[n]
            log_prob += logs[n * width + int(actions[row, n])]
        loss, slope, change, is_clipped = _surrogate(log_prob - old[row], (advantages[row] - mean) / spread, clip)
        surrogate, divergence, clipped = surrogate + loss, divergence + change, clipped + is_clipped
        pull = np.float32(slope * part)
        for n in range(num):
            for k in range(n * width, (n + 1) * width):
                shares[k] *= toll * (logs[k] + entropies[n]) - pull
            shares[n * width + int(actions[row, n])] += pull
    return -entropy / rows, surrogate / rows, divergence / rows, clipped / rows


@numba.njit(cache=True, nogil=True, error_model="numpy")
def want_levels(
    raw: Any, log_std: Any, actions: Any, old: Any, advantages: Any, clip: float, price: float, gradient: Any,
    gradient_of_log_std: Any,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Write the loss's gradients by the means of Gaussian levels and by their spread; return what `Told` holds.

    Args:
        raw: (N, K) means.
        log_std: (K,) logarithms of the standard deviations.
        actions: (N, K) levels drawn.
        old: (N,) log probabilities of the actions when they were chosen.
        advantages: (N,) of the actions, as estimated.
        clip: Range of the ratio of probabilities.
        price: Of entropy.
        gradient: (N, K), written.
        gradient_of_log_std: (K,), written.
    """
    rows, width = raw.shape
    mean, spread = _middle(advantages)
    surrogate, divergence, clipped = 0.0, 0.0, 0
    gradient_of_log_std[:] = -price
    scale = np.exp(-log_std)
    for row in range(rows):
        log_prob = 0.0
        for k in range(width):
            error = (actions[row, k] - raw[row, k]) * scale[k]
            gradient[row, k] = error
            log_prob -= 0.5 * error * error + log_std[k] + HALF_LOG_TAU
        loss, slope, change, is_clipped = _surrogate(log_prob - old[row], (advantages[row] - mean) / spread, clip)
        surrogate, divergence, clipped = surrogate + loss, divergence + change, clipped + is_clipped
        for k in range(width):
            error = gradient[row, k]
            gradient_of_log_std[k] += slope * (error * error - 1.0) / rows
            gradient[row, k] = slope * error * scale[k] / rows
    entropy = log_std.sum() + width * (0.5 + HALF_LOG_TAU)
    return -entropy, surrogate / rows, divergence / rows, clipped / rows


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _weigh(logits: Any, logs: Any, shares: Any, first: int, end: int) -> Any:
    """Write the logarithms of probabilities, and these themselves, from `first` to `end`; return their entropy."""
    top, total, entropy = logits[first], np.float32(0.0), np.float32(0.0)
    for k in range(first + 1, end):
        top = max(top, logits[k])
    for k in range(first, end):
        shares[k] = math.exp(logits[k] - top)
        total += shares[k]
    top += math.log(total)
    part = np.float32(1.0) / total
    for k in range(first, end):
        logs[k] = logits[k] - top
        shares[k] *= part
        entropy -= shares[k] * logs[k]
    return entropy


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _middle(advantages: Any) -> tuple[float, float]:
    """Return mean and standard deviation, of N - 1 degrees of freedom as torch's; a lone one is left as it is."""
    if len(advantages) == 1:
        return 0.0, 1.0
    mean = advantages.mean()
    return mean, math.sqrt(((advantages - mean) ** 2).sum() / (len(advantages) - 1)) + TINY


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _surrogate(log_ratio: float, advantage: float, clip: float) -> tuple[float, float, float, bool]:
    """Return a decision's loss, its slope by the log probability, the divergence, and whether the ratio is clipped."""
    ratio = math.exp(log_ratio)
    free, held = advantage * ratio, advantage * min(max(ratio, 1.0 - clip), 1.0 + clip)
    slope = -free if free <= held else 0.0
    return -min(free, held), slope, ratio - 1.0 - log_ratio, abs(ratio - 1.0) > clip
