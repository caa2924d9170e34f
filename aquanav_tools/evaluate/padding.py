"""Networks whose output for one row is the same to the bit, whatever the other rows are.

A matrix product adds up a row in an order that depends on the number of rows and on how they lie in memory, and an
activation computes the last few values of an array by another routine than the rest. Both are gone when every product
has the same number of rows and widths fill whole vector registers (tests/evaluate/test_padding.py tries it).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import torch

BLOCK = 64
"""Rows computed at once: chosen, 32 take a quarter longer per row (network of 3 x 128, one core)."""
LANES = 16
"""Widths are multiples of this: float32 values in the widest vector register (AVX-512)."""


def padded_width(width: int) -> int:
    """Return a width filled up to whole registers."""
    return -(-width // LANES) * LANES


def pad_columns(rows: torch.Tensor) -> torch.Tensor:
    """Return (N, W) rows with zeros behind them, up to whole registers."""
    from torch.nn.functional import pad

    return pad(rows, (0, padded_width(rows.shape[1]) - rows.shape[1]))


def pad_layers(layers: torch.nn.Sequential) -> torch.nn.Sequential:
    """Return a sequence of linear layers and activations with widths filled up; what is added weighs nothing."""
    from torch import nn

    return nn.Sequential(*[_pad_linear(layer) if isinstance(layer, nn.Linear) else layer for layer in layers])


def _pad_linear(layer: torch.nn.Linear) -> torch.nn.Linear:
    import torch

    wide = torch.nn.Linear(padded_width(layer.in_features), padded_width(layer.out_features))
    with torch.no_grad():
        for parameter in wide.parameters():
            parameter.zero_()
        wide.weight[: layer.out_features, : layer.in_features] = layer.weight
        wide.bias[: layer.out_features] = layer.bias
    return wide


def pad_lstm(lstm: torch.nn.LSTM) -> torch.nn.LSTM:
    """Return an LSTM with widths filled up: added units keep the state 0, as tanh(0) = 0 is all they are fed."""
    import torch

    size, wide = lstm.hidden_size, padded_width(lstm.hidden_size)
    padded = torch.nn.LSTM(padded_width(lstm.input_size), wide, lstm.num_layers)
    with torch.no_grad():
        for name, target in padded.named_parameters():
            target.zero_()
            source = getattr(lstm, name)
            for gate in range(4):  # torch stacks the weights of the input, forget, cell and output gates
                rows = slice(gate * wide, gate * wide + size)
                part = source[gate * size : (gate + 1) * size]
                target[(rows, slice(part.shape[1])) if part.ndim == 2 else rows] = part
    return padded
