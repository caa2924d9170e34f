"""Policies for other programs: ONNX, in the form of Unity's ML-Agents, and TorchScript.

The ONNX file is put together with onnx's own helpers, in the form that ML-Agents gives it; torch's exporter was left
out, as it needs two packages more and names values in its own way.
"""

from __future__ import annotations

import io
import json
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.torch_layers import FlattenExtractor
from torch import nn

from aquanav_tools.errors import InputError
from aquanav_tools.policy.normaliser import LIMIT, NormalisedObservations
from aquanav_tools.policy.observed import OBSERVED
from aquanav_tools.store import write_whole
from aquanav_tools.train.actors import Actor

if TYPE_CHECKING:
    import onnx

ONNX_FILE, SCRIPT_FILE = "policy.onnx", "policy.pt"
OPSET, IR_VERSION = 13, 8
FLOAT, INT64 = 1, 7
"""Types of values in ONNX."""
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
    write_whole(folder / ONNX_FILE, onnx_bytes(actor, getattr(learner, OBSERVED, None)))
    stream = io.BytesIO()
    with torch.no_grad(), warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # TorchScript is, but other programs still ask for it
        traced: Any = torch.jit.trace(actor.eval(), torch.zeros(1, actor.size))  # type: ignore[no-untyped-call]
        torch.jit.save(torch.jit.freeze(traced), stream)
    write_whole(folder / SCRIPT_FILE, stream.getvalue())


def onnx_bytes(actor: Actor, observed: dict[str, Any] | None = None) -> bytes:
    """Return a policy as an ONNX file. Its inputs and outputs are called as ML-Agents calls them.

    Args:
        actor: The network.
        observed: What the file is to say that it observes, as `policy.observed` has it.
    """
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
    return _model(graph, inputs, output, observed)


class _Graph:
    """Operations and constants so far."""

    def __init__(self) -> None:
        self.nodes: list[onnx.NodeProto] = []
        self.constants: list[onnx.TensorProto] = []

    def constant(self, values: Any, name: str = "", *, scalar: bool = False) -> str:
        """Add numbers, float32 or int64, and return their name."""
        from onnx.numpy_helper import from_array

        array = np.asarray(values.detach().numpy() if isinstance(values, torch.Tensor) else values)
        array = array.astype(np.int64 if array.dtype.kind == "i" else np.float32)
        name = name or f"constant_{len(self.constants)}"
        self.constants.append(from_array(array.reshape(()) if scalar else array, name))
        return name

    def node(self, kind: str, inputs: list[str], output: str = "", **attributes: int) -> str:
        """Add an operation and return the name of its value."""
        from onnx.helper import make_attribute, make_node

        output = output or f"value_{len(self.nodes)}"
        self.nodes.append(make_node(kind, inputs, [output]))
        self.nodes[-1].attribute.extend(make_attribute(name, value) for name, value in attributes.items())
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


def _model(
    graph: _Graph, inputs: dict[str, int], output: tuple[str, int, int], observed: dict[str, Any] | None
) -> bytes:
    import onnx
    from onnx import helper

    described = [helper.make_tensor_value_info(name, FLOAT, ["batch", size]) for name, size in inputs.items()]
    name, kind, size = output
    outputs = [helper.make_tensor_value_info(name, kind, ["batch", size])]
    whole = helper.make_graph(graph.nodes, "policy", described, outputs, graph.constants)
    opset = helper.make_opsetid("", OPSET)
    model = helper.make_model(whole, opset_imports=[opset], ir_version=IR_VERSION, producer_name="aquanav")
    if observed is not None:
        helper.set_model_props(model, {OBSERVED: json.dumps(observed)})
    onnx.checker.check_model(model, full_check=True)
    return model.SerializeToString()
