"""Running the feed-forward part of an ONNX model with onnxruntime: the operations that policies are made of.

Before onnxruntime sees a model, onnx's checker and shape inference have passed every value in it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import InputError, did_you_mean
from aquanav_tools.evaluate.onnx_file import input_shapes

if TYPE_CHECKING:
    import onnx

MAX_VALUES = 10_000_000
"""All operations together may make no more numbers than this, so that shapes made for it cannot fill the memory."""
MAX_PRODUCTS = 1_000_000_000
"""Multiplications of all matrix products: about 0.1 s. The original's policies take 50,000."""
OPERATIONS = (
    "Add", "ArgMax", "Clip", "Concat", "Constant", "Div", "Exp", "Gemm", "Identity", "MatMul", "Mul", "Relu", "Sigmoid",
    "Slice", "Softmax", "Sub", "Tanh",
)  # fmt: skip
FLOATS = (1, 11)
"""ONNX's numbers for float32 and float64."""
Tensor = npt.NDArray[Any]
Shape = tuple[int, ...]


class OnnxRunner:
    """Computes some outputs for one vehicle. Operations that these do not need, such as drawing at random, go out."""

    def __init__(self, model: onnx.ModelProto, outputs: Iterable[str], what: str) -> None:
        """Choose the operations and hand them to onnxruntime, which computes them in one thread.

        Args:
            model: as `read_onnx` returns it.
            outputs: names of the values to compute.
            what: names the model in messages.

        Raises:
            InputError: an output or a value is made by nothing, an operation is not known, or shapes do not fit each
                other, or grow too large.
        """
        import onnx
        from onnx.checker import ValidationError
        from onnx.shape_inference import InferenceError

        self._outputs, self._what = tuple(outputs), what
        part = _part(model, self._outputs, what)
        try:
            part = onnx.shape_inference.infer_shapes(part, check_type=True, strict_mode=True, data_prop=True)
            onnx.checker.check_model(part)
            _check_values(part)
        except (ValidationError, InferenceError, ValueError) as cause:
            raise self._unfit(cause) from cause
        self._inputs = [value.name for value in part.graph.input]
        self._session = self._start(part.SerializeToString())

    def run(self, inputs: dict[str, Tensor]) -> list[Tensor]:
        """Return the outputs, in the order they were asked for, from inputs with one row each, used or not.

        Raises:
            InputError: onnxruntime refuses the inputs, or fails.
        """
        try:
            used = {name: inputs[name] for name in self._inputs}
            return [np.asarray(value) for value in self._session.run(self._outputs, used)]
        except _runtime_errors() as cause:
            raise self._unfit(cause) from cause

    def _start(self, content: bytes) -> Any:
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1  # the same sums in the same order
        options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_DISABLE_ALL
        options.log_severity_level = 4  # what it has to say comes as an exception too
        try:
            return onnxruntime.InferenceSession(content, options, providers=["CPUExecutionProvider"])
        except _runtime_errors() as cause:
            raise self._unfit(cause) from cause

    def _unfit(self, cause: Exception) -> InputError:
        return InputError(
            f"{self._what} cannot be run: {' '.join(str(cause).split())}. It is damaged, or made for observations of "
            "another shape. Export it again."
        )


def _runtime_errors() -> tuple[type[Exception], ...]:
    from onnxruntime.capi import onnxruntime_pybind11_state as state

    names = "EPFail EngineError Fail InvalidArgument InvalidGraph InvalidProtobuf NotImplemented RuntimeException"
    return (*(getattr(state, name) for name in names.split()), ValueError, RuntimeError)


def _part(model: onnx.ModelProto, outputs: tuple[str, ...], what: str) -> onnx.ModelProto:
    """Return the operations that outputs need, with a batch of one."""
    import onnx

    needed = set(outputs)
    nodes: list[onnx.NodeProto] = []
    for node in reversed(model.graph.node):
        if needed & set(node.output):
            if node.op_type not in OPERATIONS:
                raise InputError(
                    f"{what} uses the operation {node.op_type}, which no policy of plain layers has."
                    f"{did_you_mean(node.op_type, OPERATIONS)} Export it without memory and without cameras."
                )
            nodes.insert(0, node)
            needed.difference_update(node.output)
            needed.update(name for name in node.input if name)
    constants = [tensor for tensor in model.graph.initializer if tensor.name in needed]
    inputs = {name: shape for name, shape in input_shapes(model).items() if name in needed}
    unknown = needed - {tensor.name for tensor in constants} - set(inputs)
    if unknown:
        raise InputError(f"{what} computes {', '.join(sorted(unknown))} nowhere. It is damaged: export it again.")
    graph = onnx.helper.make_graph(
        nodes, "policy",
        [onnx.helper.make_tensor_value_info(name, 1, [1, *shape[1:]]) for name, shape in inputs.items()],
        [onnx.ValueInfoProto(name=name) for name in outputs],
        constants,
    )  # fmt: skip
    return onnx.helper.make_model(graph, opset_imports=model.opset_import, ir_version=max(model.ir_version, 4))


def _check_values(model: onnx.ModelProto) -> None:
    """Refuse values without a shape of their own or without numbers, too much work, and whole numbers in a division.

    onnxruntime 1.32 divides -2^63 by -1, whole numbers, and the processor ends the process (SIGFPE).
    """
    graph = model.graph
    described = {value.name: value.type.tensor_type for value in [*graph.input, *graph.value_info, *graph.output]}
    shapes: dict[str, Shape] = {tensor.name: tuple(tensor.dims) for tensor in graph.initializer}
    kinds = {tensor.name: tensor.data_type for tensor in graph.initializer}
    for name, kind in described.items():
        shapes[name], kinds[name] = tuple(length.dim_value for length in kind.shape.dim), kind.elem_type
    products = num_values = 0
    for node in graph.node:
        made = [name for name in node.output if name]
        if any(name not in shapes or 0 in shapes[name] for name in made):
            raise ValueError(f"what its operation {node.op_type} makes has no fixed length, or none at all")
        if node.op_type == "Div" and any(kinds[name] not in FLOATS for name in node.input):
            raise ValueError("its operation Div divides whole numbers")
        size = sum(math.prod(shapes[name]) for name in made)
        num_values += size
        if node.op_type in ("Gemm", "MatMul"):
            products += size * max(shapes[node.input[0]])
    if num_values > MAX_VALUES or products > MAX_PRODUCTS:
        raise ValueError(
            f"it would make {num_values} numbers by {products} multiplications, more than {MAX_VALUES} or "
            f"{MAX_PRODUCTS}"
        )
