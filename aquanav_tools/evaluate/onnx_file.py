"""Reading ONNX files without trusting them: the numbers, nodes and names of a graph, bounded, and no code.

An ONNX file is one message in Protocol Buffers' wire format. What a feed-forward policy holds is read here; whatever
else a file may carry (subgraphs, functions, data in other files) is refused or left out.

Source: the message definitions in onnx.proto of the ONNX project, versions of the format (IR) 3 to 12.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.errors import InputError

MAX_FILE_BYTES = 64 << 20
"""The original's policies have 0.2 MB."""
MAX_NODES = 5_000
MAX_RANK = 8
VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
TENSOR_TYPES = {1: np.float32, 6: np.int32, 7: np.int64, 9: np.bool_, 11: np.float64}
"""ONNX's numbers for the types that policies use."""

Tensor = npt.NDArray[Any]
Message = dict[int, list[Any]]


@dataclass(frozen=True)
class OnnxNode:
    """One operation."""

    kind: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    attributes: dict[str, Any]


@dataclass(frozen=True)
class OnnxGraph:
    """Operations in an order in which they can run, and the constants they use."""

    opset: int
    nodes: tuple[OnnxNode, ...]
    constants: dict[str, Tensor]
    input_shapes: dict[str, tuple[int, ...]]
    """Of the inputs that are no constants; -1 for a length that is open, such as the batch's."""
    outputs: tuple[str, ...]


def read_onnx(path: Path) -> OnnxGraph:
    """Return the graph in an ONNX file.

    Raises:
        InputError: no such file, too large, damaged, or with contents that no feed-forward policy has.
    """
    if not path.is_file():
        raise InputError(f"There is no policy at {path}. Name an ONNX file that ML-Agents exported.")
    if path.stat().st_size > MAX_FILE_BYTES:
        raise InputError(
            f"{path} has {path.stat().st_size} bytes, more than {MAX_FILE_BYTES}: no policy for this task."
        )
    try:
        return _graph(_message(path.read_bytes()))
    except (struct.error, IndexError, ValueError, KeyError, TypeError) as cause:
        raise InputError(
            f"{path} is not a readable ONNX policy: {cause}. It was cut off while being copied, is a pointer of Git "
            "LFS (run: git lfs pull), or is something else. Copy or export it again."
        ) from cause


def _message(content: bytes) -> Message:
    """Return the values of each field of a message; nested ones as bytes."""
    fields: Message = {}
    for number, value in _fields(content):
        fields.setdefault(number, []).append(value)
    return fields


def _fields(content: bytes) -> Iterator[tuple[int, Any]]:
    n = 0
    while n < len(content):
        key, n = _varint(content, n)
        wire = key & 7
        value: Any
        if wire == VARINT:
            value, n = _varint(content, n)
        elif wire in (FIXED32, FIXED64):
            size = 4 if wire == FIXED32 else 8
            value, n = content[n : n + size], n + size
        elif wire == BYTES:
            length, n = _varint(content, n)
            value, n = content[n : n + length], n + length
        else:
            raise ValueError(f"byte {n} begins a field of the unknown kind {wire}")
        if n > len(content):
            raise ValueError("a field reaches beyond the end of the file")
        yield key >> 3, value


def _varint(content: bytes, n: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        byte = content[n]
        n += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, n
    raise ValueError("a number of more than 10 bytes")


def _integers(values: list[Any]) -> list[int]:
    """Return a repeated integer field, packed or not, with its sign."""
    numbers: list[int] = []
    for value in values:
        if isinstance(value, int):
            numbers.append(value)
            continue
        n = 0
        while n < len(value):
            number, n = _varint(value, n)
            numbers.append(number)
    return [number - (1 << 64) if number >= 1 << 63 else number for number in numbers]


def _floats(values: list[Any]) -> list[float]:
    return np.frombuffer(b"".join(values), np.float32).astype(float).tolist()


def _text(fields: Message, number: int) -> str:
    value = fields.get(number, [b""])[0]
    if not isinstance(value, bytes):
        raise ValueError("a number where a name should stand")
    return value.decode("utf-8")


def _graph(model: Message) -> OnnxGraph:
    if 7 not in model:
        raise ValueError("it has no graph")
    opsets = [_message(entry) for entry in model.get(8, [])]
    plain = [_integers(entry.get(2, []))[0] for entry in opsets if _text(entry, 1) in ("", "ai.onnx")]
    if not plain:
        raise ValueError("it names no version of ONNX's operations")
    fields = _message(model[7][0])
    nodes = tuple(_node(_message(entry)) for entry in fields.get(1, []))
    if len(nodes) > MAX_NODES:
        raise ValueError(f"it has {len(nodes)} operations, more than {MAX_NODES}")
    constants = dict(_tensor(_message(entry)) for entry in fields.get(5, []))
    shapes = dict(_input(_message(entry)) for entry in fields.get(11, []))
    inputs = {name: shape for name, shape in shapes.items() if name not in constants}
    return OnnxGraph(
        plain[0], nodes, constants, inputs, tuple(_text(_message(entry), 1) for entry in fields.get(12, []))
    )


def _node(fields: Message) -> OnnxNode:
    if _text(fields, 7) not in ("", "ai.onnx"):
        raise ValueError(f"its operation {_text(fields, 4)} is of the foreign domain '{_text(fields, 7)}'")
    names = [tuple(name.decode("utf-8") for name in fields.get(number, [])) for number in (1, 2)]
    attributes = dict(_attribute(_message(entry)) for entry in fields.get(5, []))
    return OnnxNode(_text(fields, 4), names[0], names[1], attributes)


def _attribute(fields: Message) -> tuple[str, Any]:
    name = _text(fields, 1)
    if 5 in fields:
        return name, _tensor(_message(fields[5][0]))[1]
    if 7 in fields:
        return name, _floats(fields[7])
    if 8 in fields:
        return name, _integers(fields[8])
    if 2 in fields:
        return name, _floats(fields[2])[0]
    if 3 in fields:
        return name, _integers(fields[3])[0]
    if 4 in fields:
        return name, fields[4][0]
    return name, None


def _tensor(fields: Message) -> tuple[str, Tensor]:
    name, shape = _text(fields, 8), _integers(fields.get(1, []))
    kind = _integers(fields.get(2, [0]))[0]
    if kind not in TENSOR_TYPES or 14 in fields or 13 in fields:
        raise ValueError(f"the numbers '{name}' are of the type {kind}, or lie in another file")
    if len(shape) > MAX_RANK or any(length < 0 for length in shape):
        raise ValueError(f"the numbers '{name}' have the shape {shape}")
    dtype = TENSOR_TYPES[kind]
    values: Tensor
    if 9 in fields:
        values = np.frombuffer(fields[9][0], dtype)
    elif kind == 1:
        values = np.array(_floats(fields.get(4, [])), dtype)
    else:
        values = np.array(_integers(fields.get(7 if kind == 7 else 5, [])), dtype)
    if dtype in (np.float32, np.float64) and not np.isfinite(values).all():
        raise ValueError(f"the numbers '{name}' are not all finite; its training diverged")
    return name, values.reshape(shape)


def _input(fields: Message) -> tuple[str, tuple[int, ...]]:
    shape: list[int] = []
    kinds = _message(fields[2][0]) if 2 in fields else {}
    tensor = _message(kinds[1][0]) if 1 in kinds else {}
    for entry in _message(tensor[2][0]).get(1, []) if 2 in tensor else []:
        length = _integers(_message(entry).get(1, []))
        shape.append(length[0] if length else -1)
    return _text(fields, 1), tuple(shape)
