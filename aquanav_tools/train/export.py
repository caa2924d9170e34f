"""Policies for other programs: ONNX, in the form of Unity's ML-Agents, and TorchScript.

The ONNX file is written by hand, since a policy is a dozen plain operations: the packages that exporters need, and
their ways of changing with each version, are not worth it. `aquanav-eval` runs it, as onnxruntime does.
"""

from __future__ import annotations

import io
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from aquanav_tools.errors import InputError
from aquanav_tools.policy.normaliser import LIMIT, NormalisedObservations
from aquanav_tools.store import write_whole
from aquanav_tools.train.actors import Actor
from aquanav_tools.train.wire import chunk, integer

ONNX_FILE, SCRIPT_FILE = "policy.onnx", "policy.pt"
OPSET, IR_VERSION = 13, 8
FLOAT, INT64 = 1, 7
"""Types of values in ONNX."""
INT_ATTRIBUTE = 2
MUCH = 1e8
"""Taken from the logits of choices that are forbidden, as ML-Agents does."""
OBSERVATIONS, MASKS = "obs_0", "action_masks"
CHOICES, LEVELS = "deterministic_discrete_actions", "deterministic_continuous_actions"
LOGITS = "logits"


def export(learner: BaseAlgorithm, folder: Path) -> None:
    """Write policy.onnx and policy.pt.

    Raises:
        InputError: the policy has a memory.
    """
    learner.policy.set_training_mode(False)
    actor = Actor(learner.policy)
    write_whole(folder / ONNX_FILE, onnx_bytes(actor))
    stream = io.BytesIO()
    with torch.no_grad(), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # TorchScript is, but other programs still ask for it
        traced: Any = torch.jit.trace(actor.eval(), torch.zeros(1, actor.size))  # type: ignore[no-untyped-call]
        torch.jit.save(torch.jit.freeze(traced), stream)
    write_whole(folder / SCRIPT_FILE, stream.getvalue())


def onnx_bytes(actor: Actor) -> bytes:
    """Return a policy as an ONNX file. Its inputs and outputs are called as ML-Agents calls them."""
    graph = _Graph()
    value = OBSERVATIONS
    for layer in actor.layers:
        value = _add_layer(graph, layer, value)
    inputs = {OBSERVATIONS: actor.size}
    if actor.branches:
        inputs[MASKS] = sum(actor.branches)
        _add_choices(graph, value, actor.branches)
        output = (CHOICES, INT64, len(actor.branches))
    else:
        graph.node("Clip", [value, graph.constant([-1.0], scalar=True), graph.constant([1.0], scalar=True)], LEVELS)
        output = (LEVELS, FLOAT, actor.num_levels)
    graph.constant([0.0], name="memory_size")
    return _model(graph, inputs, output)


class _Graph:
    """Operations and constants so far."""

    def __init__(self) -> None:
        self.nodes: list[bytes] = []
        self.constants: list[bytes] = []

    def constant(self, values: Any, name: str = "", *, scalar: bool = False) -> str:
        """Add numbers, float32 or int64, and return their name."""
        array = np.asarray(values.detach().numpy() if isinstance(values, torch.Tensor) else values)
        array = array.astype(np.int64 if array.dtype.kind == "i" else np.float32)
        name = name or f"constant_{len(self.constants)}"
        shape = () if scalar else array.shape
        kind = INT64 if array.dtype == np.int64 else FLOAT
        dims = b"".join(integer(1, length) for length in shape)
        self.constants.append(dims + integer(2, kind) + chunk(8, name) + chunk(9, array.tobytes()))
        return name

    def node(self, kind: str, inputs: list[str], output: str = "", **attributes: int) -> str:
        """Add an operation and return the name of its value."""
        output = output or f"value_{len(self.nodes)}"
        content = b"".join(chunk(1, name) for name in inputs) + chunk(2, output) + chunk(4, kind)
        for name, value in attributes.items():
            content += chunk(5, chunk(1, name) + integer(3, value) + integer(20, INT_ATTRIBUTE))
        self.nodes.append(content)
        return output


def _add_layer(graph: _Graph, layer: nn.Module, value: str) -> str:
    if isinstance(layer, FlattenExtractor):
        return value
    if isinstance(layer, NormalisedObservations):
        moved = graph.node("Sub", [value, graph.constant(layer.mean)])
        scaled = graph.node("Mul", [moved, graph.constant(layer.scale)])
        limits = [graph.constant([side], scalar=True) for side in (-LIMIT, LIMIT)]
        return graph.node("Clip", [scaled, *limits])
    if isinstance(layer, nn.Linear):
        return graph.node("Gemm", [value, graph.constant(layer.weight), graph.constant(layer.bias)], transB=1)
    if isinstance(layer, nn.SiLU):
        return graph.node("Mul", [value, graph.node("Sigmoid", [value])])
    if isinstance(layer, nn.Tanh):
        return graph.node("Tanh", [value])
    raise InputError(f"A layer {type(layer).__name__} cannot be exported.")


def _add_choices(graph: _Graph, value: str, branches: list[int]) -> None:
    """Add the most likely allowed choice of each branch."""
    logits = graph.node("Identity", [value], LOGITS)
    forbidden = graph.node("Sub", [MASKS, graph.constant([1.0], scalar=True)])
    masked = graph.node("Add", [logits, graph.node("Mul", [forbidden, graph.constant([MUCH], scalar=True)])])
    axis = graph.constant([1])
    choices, first = [], 0
    for size in branches:
        part = graph.node("Slice", [masked, graph.constant([first]), graph.constant([first + size]), axis])
        choices.append(graph.node("ArgMax", [part], axis=1, keepdims=1))
        first += size
    graph.node("Concat", choices, CHOICES, axis=1)


def _model(graph: _Graph, inputs: dict[str, int], output: tuple[str, int, int]) -> bytes:
    content = b"".join(chunk(1, node) for node in graph.nodes) + chunk(2, "policy")
    content += b"".join(chunk(5, constant) for constant in graph.constants)
    content += b"".join(chunk(11, _described(name, FLOAT, size)) for name, size in inputs.items())
    content += chunk(12, _described(*output))
    return integer(1, IR_VERSION) + chunk(2, "aquanav") + chunk(8, chunk(1, "") + integer(2, OPSET)) + chunk(7, content)


def _described(name: str, kind: int, size: int) -> bytes:
    """Return the ValueInfoProto of a (batch, size) value."""
    shape = chunk(1, chunk(2, "batch")) + chunk(1, integer(1, size))
    return chunk(1, name) + chunk(2, chunk(1, integer(1, kind) + chunk(2, shape)))
