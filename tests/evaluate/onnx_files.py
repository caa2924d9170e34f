"""Tiny ONNX files, written by the tests in Protocol Buffers' wire format."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from aquanav_tools.types import Array

Node = tuple[str, list[str], list[str], dict[str, Any]]


def number(field: int, value: int) -> bytes:
    """An integer field."""
    return varint(field << 3) + varint(value % (1 << 64))


def chunk(field: int, content: bytes) -> bytes:
    """A field of bytes: a text or a nested message."""
    return varint(field << 3 | 2) + varint(len(content)) + content


def varint(value: int) -> bytes:
    """An integer, seven bits to a byte."""
    out = b""
    while value >= 0x80:
        out += bytes([value & 0x7F | 0x80])
        value >>= 7
    return out + bytes([value])


def tensor(name: str, values: Any) -> bytes:
    """A TensorProto with raw data."""
    array = np.asarray(values)
    array = array.astype(np.float32) if array.dtype.kind == "f" else array.astype(np.int64)
    dims = b"".join(number(1, length) for length in array.shape)
    return dims + number(2, 1 if array.dtype == np.float32 else 7) + chunk(8, name.encode()) + chunk(9, array.tobytes())


def node(
    kind: str, inputs: Sequence[str], outputs: Sequence[str], attributes: dict[str, Any], domain: str = ""
) -> bytes:
    """A NodeProto."""
    content = b"".join(chunk(1, name.encode()) for name in inputs) + b"".join(chunk(2, n.encode()) for n in outputs)
    content += chunk(4, kind.encode()) + chunk(7, domain.encode())
    for name, value in attributes.items():
        entry = chunk(1, name.encode())
        if isinstance(value, list):
            entry += b"".join(number(8, item) for item in value)
        elif isinstance(value, float):
            entry += varint(2 << 3 | 5) + np.float32(value).tobytes()
        elif isinstance(value, int):
            entry += number(3, value)
        else:
            entry += chunk(5, tensor("", value))
        content += chunk(5, entry)
    return content


def model(
    nodes: Sequence[bytes],
    constants: dict[str, Any],
    inputs: Mapping[str, Sequence[int]],
    outputs: Sequence[str],
    opset: int,
) -> bytes:
    """A ModelProto; an input's length of -1 is open."""
    graph = b"".join(chunk(1, entry) for entry in nodes)
    graph += b"".join(chunk(5, tensor(name, values)) for name, values in constants.items())
    for name, shape in inputs.items():
        dims = b"".join(chunk(1, chunk(2, b"batch") if length < 0 else number(1, length)) for length in shape)
        graph += chunk(11, chunk(1, name.encode()) + chunk(2, chunk(1, number(1, 1) + chunk(2, dims))))
    graph += b"".join(chunk(12, chunk(1, name.encode())) for name in outputs)
    return number(1, 6) + chunk(8, chunk(1, b"") + number(2, opset)) + chunk(7, graph)


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
    return model(nodes, constants, inputs, ["discrete_actions", best], opset)
