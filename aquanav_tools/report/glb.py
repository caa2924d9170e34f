"""Binary glTF 2.0: scenes of coloured triangles and lines in one file."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from aquanav_tools.types import Array, IntArray

_FLOAT, _UNSIGNED_SHORT, _UNSIGNED_INT = 5126, 5123, 5125
_ARRAY_BUFFER, _ELEMENT_ARRAY_BUFFER = 34962, 34963
_LINE_STRIP, _TRIANGLES = 3, 4
"""Constants of glTF 2.0, section 5."""
_ROUGH = {"doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0.0, "roughnessFactor": 0.9}}


@dataclass(frozen=True, eq=False)
class Part:
    """Triangles, or a line from point to point."""

    name: str
    points: Array
    """(N, 3) world, m."""
    colours: Array
    """(N, 3) sRGB, 0 to 255."""
    faces: IntArray | None = None
    """(F, 3) of triangles, counter-clockwise from outside; None for a line."""
    normals: Array | None = None
    """(N, 3) of triangles, unit vectors."""


def glb(parts: Sequence[Part]) -> bytes:
    """Return a scene as a file; (x, y, z) of the world becomes (x, z, -y), as glTF has y up."""
    scene = _Scene()
    for part in parts:
        scene.add(part)
    return scene.file()


class _Scene:
    """A document under way, with its binary part."""

    def __init__(self) -> None:
        self._body: list[bytes] = []
        self._offset = 0
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []
        self._nodes: list[dict[str, Any]] = []
        self._meshes: list[dict[str, Any]] = []

    def add(self, part: Part) -> None:
        """Add a part as a node of its own."""
        points = _turned(part.points)
        limits = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
        opaque = np.round(65535 * np.column_stack([_linear(part.colours), np.ones(len(points))])).astype("<u2")
        attributes = {"POSITION": self._store(points, "VEC3", _FLOAT, limits)}
        if part.normals is not None:
            attributes["NORMAL"] = self._store(_turned(part.normals), "VEC3", _FLOAT)
        attributes["COLOR_0"] = self._store(opaque, "VEC4", _UNSIGNED_SHORT, {"normalized": True})
        primitive: dict[str, Any] = {"attributes": attributes, "material": 0}
        if part.faces is None:
            primitive["mode"] = _LINE_STRIP
        else:
            corners = part.faces.astype("<u4").ravel()
            primitive["indices"] = self._store(corners, "SCALAR", _UNSIGNED_INT, target=_ELEMENT_ARRAY_BUFFER)
        self._nodes.append({"mesh": len(self._meshes), "name": part.name})
        self._meshes.append({"name": part.name, "primitives": [primitive]})

    def file(self) -> bytes:
        """Return the finished file."""
        document = {
            "asset": {"version": "2.0", "generator": "aquanav"},
            "scene": 0,
            "scenes": [{"nodes": list(range(len(self._nodes)))}],
            "nodes": self._nodes,
            "meshes": self._meshes,
            "materials": [_ROUGH],
            "accessors": self._accessors,
            "bufferViews": self._views,
            "buffers": [{"byteLength": self._offset}],
        }
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text + struct.pack("<II", self._offset, 0x004E4942)
        head = struct.pack("<III", 0x46546C67, 2, 12 + len(chunks) + self._offset)
        return head + chunks + b"".join(self._body)

    def _store(
        self,
        values: npt.NDArray[Any],
        shape: str,
        component: int,
        more: dict[str, Any] | None = None,
        target: int = _ARRAY_BUFFER,
    ) -> int:
        """Keep values, which take a multiple of four bytes, and return their accessor."""
        view = {"buffer": 0, "byteOffset": self._offset, "byteLength": values.nbytes, "target": target}
        accessor = {"bufferView": len(self._views), "componentType": component, "count": len(values), "type": shape}
        self._views.append(view)
        self._accessors.append(accessor | (more or {}))
        self._body.append(values.tobytes())
        self._offset += values.nbytes
        return len(self._accessors) - 1


def _turned(rows: Array) -> npt.NDArray[np.float32]:
    return np.stack([rows[:, 0], rows[:, 2], -rows[:, 1]], axis=1).astype("<f4")


def _linear(colours: Array) -> Array:
    """Return sRGB values of 0 to 255 as linear light in [0, 1], which glTF's vertex colours are (IEC 61966-2-1)."""
    share = colours / 255.0
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
