"""Running the feed-forward part of an ONNX graph with numpy: the operations that ML-Agents' policies are made of."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.evaluate.onnx_file import OnnxGraph, OnnxNode, Tensor

MAX_OPSET = 25
MAX_VALUES = 10_000_000
"""An operation may make no more numbers than this, so that shapes made for it cannot fill the memory."""

Operation = Callable[[OnnxNode, list[Tensor]], Tensor]


class OnnxRunner:
    """Computes some outputs of a graph. Operations that these do not need, such as drawing at random, never run."""

    def __init__(self, graph: OnnxGraph, outputs: Iterable[str], what: str) -> None:
        """Choose the operations.

        Args:
            graph: has them in an order in which they can run.
            outputs: names of the values to compute.
            what: names the graph in messages.

        Raises:
            InputError: an output or a value is made by nothing, or an operation is not known.
        """
        self._outputs = tuple(outputs)
        self._constants = graph.constants
        self._nodes: list[OnnxNode] = []
        self._what = what
        if graph.opset > MAX_OPSET:
            raise InputError(f"{what} uses operations of ONNX version {graph.opset}; up to {MAX_OPSET} are known.")
        needed = set(self._outputs)
        for node in reversed(graph.nodes):
            if needed & set(node.outputs):
                if node.kind not in OPERATIONS:
                    raise InputError(
                        f"{what} uses the operation {node.kind}, which no policy of plain layers has."
                        f"{did_you_mean(node.kind, OPERATIONS)} Export it without memory and without cameras."
                    )
                self._nodes.insert(0, node)
                needed.difference_update(node.outputs)
                needed.update(name for name in node.inputs if name)
        unknown = needed - set(graph.constants) - set(graph.input_shapes)
        if unknown:
            raise InputError(f"{what} computes {', '.join(sorted(unknown))} nowhere. It is damaged: export it again.")

    def run(self, inputs: dict[str, Tensor]) -> list[Tensor]:
        """Return the outputs, in the order they were asked for.

        Raises:
            InputError: shapes do not fit each other, or grow too large.
        """
        values = {**self._constants, **inputs}
        for node in self._nodes:
            try:
                values[node.outputs[0]] = OPERATIONS[node.kind](node, [values[name] for name in node.inputs if name])
            except (ValueError, IndexError, KeyError, TypeError) as cause:
                raise InputError(
                    f"{self._what} cannot be run: its operation {node.kind} failed ({cause}). It is damaged, or made "
                    "for observations of another shape. Export it again."
                ) from cause
        return [values[name] for name in self._outputs]


def _elementwise(function: Callable[..., Any]) -> Operation:
    def run(node: OnnxNode, inputs: list[Tensor]) -> Tensor:
        _check_size(np.broadcast_shapes(*(value.shape for value in inputs)))
        return np.asarray(function(*inputs))

    return run


def _check_size(shape: tuple[int, ...]) -> None:
    if np.prod(shape, dtype=float) > MAX_VALUES:
        raise ValueError(f"it would make {shape} numbers, more than {MAX_VALUES}")


def _gemm(node: OnnxNode, inputs: list[Tensor]) -> Tensor:
    a, b = inputs[0], inputs[1]
    a = a.T if node.attributes.get("transA", 0) else a
    b = b.T if node.attributes.get("transB", 0) else b
    _check_size((a.shape[0], b.shape[1]))
    product: Tensor = np.float32(node.attributes.get("alpha", 1.0)) * (a @ b)
    if len(inputs) > 2:
        product = product + np.float32(node.attributes.get("beta", 1.0)) * inputs[2]
    return np.asarray(product)


def _matmul(node: OnnxNode, inputs: list[Tensor]) -> Tensor:
    a, b = inputs
    _check_size((*a.shape[:-1], *b.shape[-1:]))
    return np.asarray(a @ b)


def _clip(node: OnnxNode, inputs: list[Tensor]) -> Tensor:
    low = inputs[1] if len(inputs) > 1 else node.attributes.get("min", -np.inf)
    high = inputs[2] if len(inputs) > 2 else node.attributes.get("max", np.inf)
    return np.clip(inputs[0], low, high).astype(inputs[0].dtype)


def _slice(node: OnnxNode, inputs: list[Tensor]) -> Tensor:
    value = inputs[0]
    rows = [[int(number) for number in row] for row in inputs[1:]]  # since opset 10 the bounds are inputs
    starts = rows[0] if rows else node.attributes["starts"]
    ends = rows[1] if rows else node.attributes["ends"]
    axes = rows[2] if len(rows) > 2 else node.attributes.get("axes", range(len(starts)))
    steps = rows[3] if len(rows) > 3 else [1] * len(starts)
    index = [slice(None)] * value.ndim
    for start, end, axis, step in zip(starts, ends, axes, steps, strict=True):
        index[axis] = slice(start, end, step)
    return value[tuple(index)]


def _softmax(node: OnnxNode, inputs: list[Tensor]) -> Tensor:
    axis = node.attributes.get("axis", -1)
    powers = np.exp(inputs[0] - inputs[0].max(axis=axis, keepdims=True))
    return np.asarray(powers / powers.sum(axis=axis, keepdims=True))


def _argmax(node: OnnxNode, inputs: list[Tensor]) -> Tensor:
    axis, is_kept = node.attributes.get("axis", 0), bool(node.attributes.get("keepdims", 1))
    return np.asarray(np.argmax(inputs[0], axis=axis, keepdims=is_kept))


def _concat(node: OnnxNode, inputs: list[Tensor]) -> Tensor:
    return np.concatenate(inputs, axis=node.attributes["axis"])


def _constant(node: OnnxNode, inputs: list[Tensor]) -> Tensor:
    return np.asarray(node.attributes["value"])


def _sigmoid(value: Tensor) -> Tensor:
    return np.asarray(0.5 * (1.0 + np.tanh(0.5 * value)), dtype=value.dtype)  # cannot overflow


OPERATIONS: dict[str, Operation] = {
    "Add": _elementwise(np.add),
    "ArgMax": _argmax,
    "Clip": _clip,
    "Concat": _concat,
    "Constant": _constant,
    "Div": _elementwise(np.divide),
    "Exp": _elementwise(np.exp),
    "Gemm": _gemm,
    "Identity": _elementwise(np.positive),
    "MatMul": _matmul,
    "Mul": _elementwise(np.multiply),
    "Relu": _elementwise(lambda value: np.maximum(value, 0)),
    "Sigmoid": _elementwise(_sigmoid),
    "Slice": _slice,
    "Softmax": _softmax,
    "Sub": _elementwise(np.subtract),
    "Tanh": _elementwise(np.tanh),
}
