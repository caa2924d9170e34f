"""Tiny ONNX files, written by the tests with onnx."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import onnx
from onnx import helper, numpy_helper

from aquanav_tools.types import Array


def tensor(name: str, values: Any) -> onnx.TensorProto:
    """Numbers, float32 or int64."""
    array = np.asarray(values)
    return numpy_helper.from_array(array.astype(np.float32 if array.dtype.kind == "f" else np.int64), name)


def node(
    kind: str, inputs: Sequence[str], outputs: Sequence[str], attributes: dict[str, Any], domain: str = ""
) -> onnx.NodeProto:
    """An operation."""
    values = {name: tensor("", value) if isinstance(value, np.generic) else value for name, value in attributes.items()}
    return helper.make_node(kind, inputs, outputs, domain=domain, **values)


def model(
    nodes: Sequence[onnx.NodeProto],
    constants: dict[str, Any],
    inputs: Mapping[str, Sequence[int]],
    outputs: Sequence[str],
    opset: int = 13,
) -> onnx.ModelProto:
    """A model; an input's length of -1 is open. Its outputs have no types, as only their names are read."""
    described = [
        helper.make_tensor_value_info(name, 1, ["batch" if length < 0 else length for length in shape])
        for name, shape in inputs.items()
    ]
    values = [tensor(name, value) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "policy", described, [onnx.ValueInfoProto(name=name) for name in outputs], values)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=6)


def policy(
    weights: Sequence[Array], sizes: Sequence[int] = (3, 4), branches: Sequence[int] = (3, 2), **changes: Any
) -> bytes:
    """A policy as ML-Agents exports it: one swish layer, then masked choices. `changes` replace constants or nodes."""
    width = sum(sizes)
    nodes = [
        node("Concat", [f"obs_{n}" for n in range(len(sizes))], ["all"], {"axis": 1}),
        node("Sub", ["all", "mean"], ["moved"], {}),
        node("Div", ["moved", "std"], ["scaled"], {}),
        node("Clip", ["scaled"], ["seen"], {"min": -5.0, "max": 5.0}),
        node("Gemm", ["seen", "w", "b"], ["h"], {"alpha": 1.0, "beta": 1.0, "transB": 1}),
        node("Sigmoid", ["h"], ["s"], {}),
        node("Mul", ["h", "s"], ["swish"], {}),
        node("Constant", [], ["one"], {"value": np.float64(1.0)}),
        node("Constant", [], ["much"], {"value": np.float64(1e8)}),
    ]
    first, constants = 0, {"mean": np.full(width, 0.1), "std": np.full(width, 0.5), "w": weights[0], "b": weights[1]}
    for n, size in enumerate(branches):
        constants[f"w{n}"], constants[f"b{n}"] = weights[2][first : first + size], weights[3][first : first + size]
        nodes += [
            node("Slice", ["action_masks"], [f"m{n}"], {"axes": [1], "starts": [first], "ends": [first + size]}),
            node("Gemm", ["swish", f"w{n}", f"b{n}"], [f"l{n}"], {"transB": 1}),
            node("Mul", [f"l{n}", f"m{n}"], [f"k{n}"], {}),
            node("Sub", ["one", f"m{n}"], [f"f{n}"], {}),
            node("Mul", [f"f{n}", "much"], [f"p{n}"], {}),
            node("Sub", [f"k{n}", f"p{n}"], [f"q{n}"], {}),
            node("Softmax", [f"q{n}"], [f"r{n}"], {"axis": 1}),
            node("Multinomial", [f"r{n}"], [f"drawn{n}"], {"sample_size": 1}),
            node("ArgMax", [f"r{n}"], [f"a{n}"], {"axis": 1, "keepdims": 1}),
        ]
        first += size
    nodes.append(node("Concat", [f"drawn{n}" for n in range(len(branches))], ["discrete_actions"], {"axis": 1}))
    best = changes.pop("output", "deterministic_discrete_actions")
    nodes.append(node("Concat", [f"a{n}" for n in range(len(branches))], [best], {"axis": 1}))
    nodes += changes.pop("more", [])
    inputs = {f"obs_{n}": (-1, size) for n, size in enumerate(sizes)} | {"action_masks": (-1, sum(branches))}
    inputs |= changes.pop("inputs", {})
    opset = changes.pop("opset", 9)
    constants = constants | {"memory_size": np.zeros(1)} | changes
    return model(nodes, constants, inputs, ["discrete_actions", best], opset).SerializeToString()
