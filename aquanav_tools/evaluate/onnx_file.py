"""Reading ONNX files without trusting them: refused before onnxruntime sees what no feed-forward policy holds.

Such are numbers in other files, operations of a domain of one's own, subgraphs, functions, and sizes beyond bounds.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.policy.observed import OBSERVED

if TYPE_CHECKING:
    import onnx

MAX_FILE_BYTES = 64 << 20
"""The original's policies have 0.2 MB."""
MAX_NODES = 5_000
MAX_RANK = 8
MAX_OPSET = 23
"""The newest that onnxruntime runs on Python 3.10 (its version 1.23)."""
DOMAINS = ("", "ai.onnx")
TENSOR_TYPES = {1: np.float32, 6: np.int32, 7: np.int64, 9: np.bool_, 11: np.float64}
"""ONNX's numbers for the types that policies use."""


def read_onnx(path: Path) -> onnx.ModelProto:
    """Return the model in an ONNX file; its operations may still be unknown, or not fit each other.

    Raises:
        InputError: no such file, too large, damaged, or with contents that no feed-forward policy has.
    """
    if not path.is_file():
        raise InputError(f"There is no policy at {path}. Name an ONNX file that ML-Agents exported.")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise InputError(
            f"{path} has {path.stat().st_size} bytes, more than {MAX_FILE_BYTES}: no policy for this task."
        )
    import onnx
    from google.protobuf.message import DecodeError

    try:
        model = onnx.load_model_from_string(path.read_bytes())
        _check_model(model)
    except (DecodeError, ValueError, TypeError) as cause:
        raise InputError(
            f"{path} is not a readable ONNX policy: {cause}. It was cut off while being copied, is a pointer of Git "
            "LFS (run: git lfs pull), or is something else. Copy or export it again."
        ) from cause
    return model


def onnx_properties(model: onnx.ModelProto, path: Path) -> dict[str, Any]:
    """Return what an ONNX file from aquanav-train says of itself, by name; nothing of others.

    Raises:
        InputError: it is not JSON.
    """
    texts = {item.key: item.value for item in model.metadata_props if item.key == OBSERVED}
    try:
        return {name: json.loads(text) for name, text in texts.items()}
    except (json.JSONDecodeError, RecursionError) as cause:
        raise InputError(
            f"{path} says what it observes in another form than JSON: {cause}. Export it again."
        ) from cause


def constants_of(model: onnx.ModelProto) -> dict[str, Any]:
    """Return the arrays that a model holds, by name."""
    from onnx.numpy_helper import to_array

    return {tensor.name: to_array(tensor) for tensor in model.graph.initializer}


def input_shapes(model: onnx.ModelProto) -> dict[str, tuple[int, ...]]:
    """Return the shapes of the inputs that are no constants; -1 for a length that is open, such as the batch's."""
    constants = {tensor.name for tensor in model.graph.initializer}
    return {value.name: _shape(value) for value in model.graph.input if value.name not in constants}


def _shape(value: onnx.ValueInfoProto) -> tuple[int, ...]:
    lengths = value.type.tensor_type.shape.dim
    return tuple(length.dim_value if length.HasField("dim_value") else -1 for length in lengths)


def _check_model(model: onnx.ModelProto) -> None:
    if not model.HasField("graph"):
        raise ValueError("it has no graph")
    if model.functions or model.training_info:
        raise ValueError("it holds functions or training steps, which no policy of plain layers has")
    _check_names(model)
    versions = {entry.domain: entry.version for entry in model.opset_import}
    foreign = sorted(set(versions) - set(DOMAINS))
    if foreign:
        raise ValueError(f"it uses operations of the foreign domain '{foreign[0]}'")
    if not versions:
        raise ValueError("it names no version of ONNX's operations")
    if max(versions.values()) > MAX_OPSET:
        raise ValueError(
            f"it uses operations of ONNX version {max(versions.values())}; versions up to {MAX_OPSET} are known"
        )
    if len(model.graph.node) > MAX_NODES:
        raise ValueError(f"it has {len(model.graph.node)} operations, more than {MAX_NODES}")
    if model.graph.sparse_initializer:
        raise ValueError("it holds sparse numbers, which no policy of plain layers has")
    for tensor in model.graph.initializer:
        _check_tensor(tensor)
    for node in model.graph.node:
        _check_node(node)


def _check_names(model: onnx.ModelProto) -> None:
    """Refuse names that are no UTF-8, which the library returns as bytes."""
    graph = model.graph
    named = [
        *graph.node,
        *graph.initializer,
        *graph.input,
        *graph.output,
        *(a for n in graph.node for a in n.attribute),
    ]
    names: list[Any] = [item.name for item in named] + [entry.domain for entry in model.opset_import]
    for node in graph.node:
        names += [node.op_type, node.domain, *node.input, *node.output]
    if not all(isinstance(name, str) for name in names):
        raise ValueError("a name in it is no text")


def _check_node(node: onnx.NodeProto) -> None:
    if node.domain not in DOMAINS:
        raise ValueError(f"its operation {node.op_type} is of the foreign domain '{node.domain}'")
    for attribute in node.attribute:
        if attribute.HasField("g") or attribute.graphs:
            raise ValueError(f"its operation {node.op_type} holds a graph, which no policy of plain layers has")
        if attribute.HasField("sparse_tensor") or attribute.sparse_tensors:
            raise ValueError(f"its operation {node.op_type} holds sparse numbers")
        for tensor in [*([attribute.t] if attribute.HasField("t") else []), *attribute.tensors]:
            _check_tensor(tensor)


def _check_tensor(tensor: onnx.TensorProto) -> None:
    from onnx.numpy_helper import to_array

    if tensor.data_location or tensor.external_data:
        raise ValueError(f"the numbers '{tensor.name}' lie in another file")
    if tensor.data_type not in TENSOR_TYPES:
        raise ValueError(f"the numbers '{tensor.name}' are of the type {tensor.data_type}")
    if len(tensor.dims) > MAX_RANK or any(length < 0 for length in tensor.dims):
        raise ValueError(f"the numbers '{tensor.name}' have the shape {list(tensor.dims)}")
    values = to_array(tensor)  # a ValueError where shape and numbers do not fit
    if values.dtype.kind == "f" and not np.isfinite(values).all():
        raise ValueError(f"the numbers '{tensor.name}' are not all finite; its training diverged")
