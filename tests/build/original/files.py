"""Tiny FBX files, prefabs and Unity projects, written by the tests."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.synthetic.caves import sweep
from aquanav_tools.types import Array, Mesh

MAGIC = b"Kaydara FBX Binary  \x00\x1a\x00"
Record = tuple[str, Sequence[Any], Sequence[Any]]


def write_fbx(
    path: Path,
    mesh: Mesh,
    version: int = 7400,
    is_packed: bool = True,
    globals_: dict[str, Any] | None = None,
    model: Mapping[str, Sequence[float]] | None = None,
) -> None:
    """Write a mesh under one model, as Blender's exporter lays a file out."""
    indices = mesh.faces.copy()
    indices[:, 2] = -indices[:, 2] - 1
    rows: list[Record] = [
        ("P", [name.encode(), b"int", b"Integer", b"", value], []) for name, value in (globals_ or {}).items()
    ]
    placed: list[Record] = [
        ("P", [name.encode(), name.encode(), b"", b"A", *row], []) for name, row in (model or {}).items()
    ]
    records: list[Record] = [
        ("GlobalSettings", [], [("Properties70", [], rows)]),
        (
            "Objects",
            [],
            [
                (
                    "Geometry",
                    [11, b"Cube\x00\x01Geometry", b"Mesh"],
                    [
                        ("Vertices", [mesh.vertices.ravel().astype(np.float64)], []),
                        ("PolygonVertexIndex", [indices.ravel().astype(np.int32)], []),
                    ],
                ),
                ("Model", [12, b"Cube\x00\x01Model", b"Mesh"], [("Properties70", [], placed)]),
            ],
        ),
        ("Connections", [], [("C", [b"OO", 12, 0], []), ("C", [b"OO", 11, 12], [])]),
    ]
    content = MAGIC + struct.pack("<I", version)
    for record in records:
        content += _record(record, len(content), version, is_packed)
    path.write_bytes(content + bytes(25 if version >= 7500 else 13))


def _record(record: Record, offset: int, version: int, is_packed: bool) -> bytes:
    name, properties, children = record
    counts = "<QQQ" if version >= 7500 else "<III"
    packed = b"".join(_property(value, is_packed) for value in properties)
    head = struct.calcsize(counts) + 1 + len(name)
    body = packed
    for child in children:
        body += _record(child, offset + head + len(body), version, is_packed)
    if children:
        body += bytes(struct.calcsize(counts) + 1)
    sizes = struct.pack(counts, offset + head + len(body), len(properties), len(packed))
    return sizes + bytes([len(name)]) + name.encode() + body


def _property(value: Any, is_packed: bool) -> bytes:
    if isinstance(value, np.ndarray):
        content = value.tobytes()
        stored = zlib.compress(content) if is_packed else content
        kind = b"d" if value.dtype == np.float64 else b"i"
        return kind + struct.pack("<III", len(value), int(is_packed), len(stored)) + stored
    if isinstance(value, bytes):
        return b"S" + struct.pack("<I", len(value)) + value
    if isinstance(value, int):
        return b"L" + struct.pack("<q", value)
    return b"D" + struct.pack("<d", value)


def winding_line() -> Array:
    """A passage of 45 units along x that winds sideways and up and down."""
    x = np.linspace(0.0, 45.0, 91)
    return np.stack([x, 2.0 * np.sin(0.17 * x) + 0.02 * x, 0.8 * np.cos(0.11 * x)], axis=1)


def write_cave(path: Path, line: Array) -> None:
    """Write an open tube of radius 1 around a line, which is in metres, as a model in centimetres."""
    tube = sweep(line, 1.0, 16)
    write_fbx(path, Mesh(100.0 * tube.mesh.vertices, tube.mesh.faces), globals_={"UpAxis": 2})


def prefab_of(centres: Array, scale: float = 2.0) -> str:
    """A DistanceRewarder in Unity's YAML with upright panels at (P, 3) centres in OUR frame, under a moved root."""
    root = np.array([3.0, -2.0, 7.0])
    unity = np.stack([centres[:, 1], centres[:, 2], -centres[:, 0]], axis=1)
    links = "".join(f"  - {{fileID: {1000 + n}}}\n" for n in range(len(centres)))
    text = "%YAML 1.1\n%TAG !u! tag:unity3d.com,2011:\n"
    text += f"--- !u!114 &1\nMonoBehaviour:\n  m_GameObject: {{fileID: 2}}\n  m_targetRewarders:\n{links}"
    text += "--- !u!1 &2\nGameObject:\n  m_Component:\n  - component: {fileID: 3}\n  m_Name: 'Panels: all'\n"
    text += _transform(3, 2, root, (0.0, 0.0, 0.0, 1.0), 1.0, 0)
    upright = (np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5))
    for n, centre in enumerate(unity):
        text += f"--- !u!114 &{1000 + n}\nMonoBehaviour:\n  m_GameObject: {{fileID: {2000 + n}}}\n"
        text += f"--- !u!1 &{2000 + n}\nGameObject:\n  m_Component:\n  - component: {{fileID: {3000 + n}}}\n"
        text += f"  - component: {{fileID: {1000 + n}}}\n  m_Name: Panel ({n})\n"
        text += _transform(3000 + n, 2000 + n, centre - root, upright, scale, 3)
    return text


def _transform(identity: int, owner: int, place: Array, turn: Sequence[float], scale: float, father: int) -> str:
    x, y, z = (float(value) for value in place)
    return (
        f"--- !u!4 &{identity}\nTransform:\n  m_GameObject: {{fileID: {owner}}}\n"
        f"  m_LocalRotation: {{x: {turn[0]}, y: {turn[1]}, z: {turn[2]},\n    w: {turn[3]}}}\n"
        f"  m_LocalPosition: {{x: {x}, y: {y}, z: {z}}}\n  m_LocalScale: {{x: {scale}, y: {scale}, z: {scale}}}\n"
        f"  m_Children: []\n  m_Father: {{fileID: {father}}}\n"
    )
