"""Reading binary FBX 7 files: their nodes, and the triangles of their meshes in the file's own world.

Everything is bounded before it is unpacked, since the files come from strangers. Materials, normals, animation and
skinning are left out: a cave needs none of them.

Source: the layout of records, as the Blender Foundation documented it ("FBX binary file format specification").
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.cave.scan.surface_file import SurfaceFile, unreadable
from aquanav_tools.errors import InputError
from aquanav_tools.types import Array, IntArray, Mesh

MAGIC = b"Kaydara FBX Binary  \x00"
HEADER_BYTES = 27
MIN_VERSION, MAX_VERSION = 7000, 7999
WIDE_VERSION = 7500
"""From here on a record's three counts have 8 bytes each, before 4."""
MAX_FILE_BYTES = 512 << 20
MAX_ARRAY_BYTES = 512 << 20
"""Twenty million vertices."""
MAX_NODES = 200_000
MAX_DEPTH = 32
SCALARS = {b"Y": "<h", b"C": "<?", b"I": "<i", b"F": "<f", b"D": "<d", b"L": "<q"}
ARRAYS = {b"b": np.uint8, b"i": np.int32, b"l": np.int64, b"f": np.float32, b"d": np.float64}
METRES_PER_UNIT = 0.01
"""The file's unit is the centimetre, times its UnitScaleFactor."""


@dataclass(frozen=True, eq=False)
class Node:
    """A record: its name, its properties, and the records in it."""

    name: str
    properties: list[Any]
    children: list[Node]

    def find(self, name: str) -> Node | None:
        """Return the first record of a name in this one."""
        return next(self.find_all(name), None)

    def find_all(self, name: str) -> Iterator[Node]:
        """Yield the records of a name in this one."""
        return (child for child in self.children if child.name == name)

    def settings(self) -> dict[str, list[Any]]:
        """Return the values of the table Properties70 by their names."""
        table = self.find("Properties70")
        rows = [] if table is None else [row.properties for row in table.find_all("P")]
        return {_text(row[0]): row[4:] for row in rows if len(row) > 4}


def read_fbx(path: Path) -> SurfaceFile:
    """Return the triangles of all meshes of an FBX file, each where its models place it.

    Raises:
        InputError: it is no binary FBX 7, damaged, too large, or holds no mesh.
    """
    try:
        root = _read_nodes(path)
        mesh = _meshes(root)
        metres, up = _frame(root)
    except (struct.error, zlib.error, IndexError, ValueError, KeyError, TypeError, OSError, RecursionError) as cause:
        raise unreadable(path, str(cause)) from cause
    if mesh is None:
        raise InputError(f"{path} holds no mesh of triangles. Export the cave as a mesh, in binary FBX 7.")
    return SurfaceFile(mesh, (), metres, up)


def _read_nodes(path: Path) -> Node:
    size = path.stat().st_size
    if size > MAX_FILE_BYTES:
        raise InputError(f"{path} has {size} bytes, more than {MAX_FILE_BYTES}. Thin the mesh out first.")
    content = path.read_bytes()
    if not content.startswith(MAGIC):
        what = (
            "a pointer of Git LFS; run: git lfs pull" if content.startswith(b"version https://git-lfs") else "no such"
        )
        raise InputError(
            f"{path} should be a binary FBX file, but is {what}. Text FBX is not read; export it as binary."
        )
    (version,) = struct.unpack_from("<I", content, HEADER_BYTES - 4)
    if not MIN_VERSION <= version <= MAX_VERSION:
        raise InputError(
            f"{path} is FBX of version {version}; {MIN_VERSION} to {MAX_VERSION} are read. Export it again as FBX 7.4."
        )
    return _Reader(content, version).read()


class _Reader:
    """Reads the records of one file."""

    def __init__(self, content: bytes, version: int) -> None:
        self._content = content
        self._counts = struct.Struct("<QQQ" if version >= WIDE_VERSION else "<III")
        self._num_nodes = 0
        self._num_bytes = 0

    def read(self) -> Node:
        """Return the file as one record without a name."""
        children, offset = [], HEADER_BYTES
        while offset < len(self._content):
            child, offset = self._node(offset, len(self._content), 0)
            if child is None:
                break
            children.append(child)
        return Node("", [], children)

    def _node(self, offset: int, limit: int, depth: int) -> tuple[Node | None, int]:
        """Return the record at an offset, and where the next one begins; None for the empty one that ends a list."""
        self._num_nodes += 1
        if self._num_nodes > MAX_NODES or depth > MAX_DEPTH:
            raise ValueError(f"more than {MAX_NODES} records, or nested deeper than {MAX_DEPTH}")
        end, num_properties, _ = self._counts.unpack_from(self._content, offset)
        offset += self._counts.size
        length = self._content[offset]
        name = self._content[offset + 1 : offset + 1 + length].decode("ascii", "replace")
        offset += 1 + length
        if end == 0:
            return None, offset
        if not offset <= end <= limit:
            raise ValueError(f"the record '{name}' ends at byte {end}, outside [{offset}, {limit}]")
        properties = []
        for _ in range(num_properties):
            value, offset = self._property(offset, end)
            properties.append(value)
        children = []
        while offset < end:
            child, offset = self._node(offset, end, depth + 1)
            if child is None:
                break
            children.append(child)
        return Node(name, properties, children), end

    def _property(self, offset: int, end: int) -> tuple[Any, int]:
        kind = self._content[offset : offset + 1]
        offset += 1
        if kind in SCALARS:
            (value,) = struct.unpack_from(SCALARS[kind], self._content, offset)
            return value, offset + struct.calcsize(SCALARS[kind])
        if kind in ARRAYS:
            return self._array(ARRAYS[kind], offset, end)
        if kind in (b"S", b"R"):
            (length,) = struct.unpack_from("<I", self._content, offset)
            after = offset + 4 + length
            if after > end:
                raise ValueError(f"a text of {length} bytes does not fit its record")
            return self._content[offset + 4 : after], after
        raise ValueError(f"a property of the unknown type {kind!r}")

    def _array(self, dtype: Any, offset: int, end: int) -> tuple[Any, int]:
        count, encoding, stored = struct.unpack_from("<III", self._content, offset)
        first, after = offset + 12, offset + 12 + stored
        num_bytes = count * np.dtype(dtype).itemsize
        self._num_bytes += num_bytes
        if after > end or self._num_bytes > MAX_ARRAY_BYTES:
            raise ValueError(
                f"an array of {count} values does not fit its record, or all take over {MAX_ARRAY_BYTES} B"
            )
        packed = self._content[first:after]
        content = zlib.decompressobj().decompress(packed, num_bytes + 1) if encoding else packed
        if len(content) != num_bytes:
            raise ValueError(f"an array should hold {num_bytes} bytes and holds {len(content)}")
        return np.frombuffer(content, dtype), after


def _meshes(root: Node) -> Mesh | None:
    objects, links = root.find("Objects"), root.find("Connections")
    if objects is None or links is None:
        return None
    parents = {row.properties[1]: row.properties[2] for row in links.find_all("C") if row.properties[0] == b"OO"}
    models = {model.properties[0]: model for model in objects.find_all("Model")}
    vertices: list[Array] = []
    faces: list[IntArray] = []
    for geometry in objects.find_all("Geometry"):
        points, indices = geometry.find("Vertices"), geometry.find("PolygonVertexIndex")
        if points is None or indices is None:
            continue
        corners = np.asarray(points.properties[0], dtype=np.float64).reshape(-1, 3)
        triangles = triangulate(np.asarray(indices.properties[0], dtype=np.int64))
        if not len(triangles):
            continue
        if not np.isfinite(corners).all() or triangles.min() < 0 or triangles.max() >= len(corners):
            raise ValueError("a mesh has corners that are not finite, or faces with corners that it has not")
        faces.append(triangles + sum(map(len, vertices)))
        vertices.append(_placed(corners, parents.get(geometry.properties[0]), models, parents))
    if not faces:
        return None
    return Mesh(np.concatenate(vertices), np.concatenate(faces))


def triangulate(indices: IntArray) -> IntArray:
    """Return the (F, 3) triangles of polygons: their corners in a row, the last of each as -corner - 1."""
    ends = np.flatnonzero(indices < 0)
    corners = np.where(indices < 0, -indices - 1, indices)
    starts = np.concatenate([[0], ends[:-1] + 1]) if len(ends) else ends
    fans = [
        np.stack([np.full(n - 2, first), np.arange(first + 1, first + n - 1), np.arange(first + 2, first + n)], axis=1)
        for first, n in zip(starts, ends - starts + 1, strict=True)
        if n >= 3
    ]
    return corners[np.concatenate(fans)] if fans else np.zeros((0, 3), dtype=np.int64)


def _placed(corners: Array, model_id: Any, models: dict[Any, Node], parents: dict[Any, Any]) -> Array:
    """Return a mesh's corners in the file's world: through its model, and all models that one hangs in."""
    is_first = True
    for _ in range(MAX_DEPTH):
        model = models.get(model_id)
        if model is None:
            return corners
        settings = model.settings()
        if is_first:
            corners = _moved(corners, settings, "Geometric{}", "")
            is_first = False
        corners = _moved(corners, settings, "Lcl {}", "PreRotation")
        model_id = parents.get(model_id)
    raise ValueError(f"models hang in each other deeper than {MAX_DEPTH}")


def _moved(corners: Array, settings: dict[str, list[Any]], name: str, before: str) -> Array:
    scale = _triple(settings, name.format("Scaling"), 1.0)
    turn = _turn(_triple(settings, before, 0.0)) @ _turn(_triple(settings, name.format("Rotation"), 0.0))
    moved: Array = (corners * scale) @ turn.T + _triple(settings, name.format("Translation"), 0.0)
    return moved


def _triple(settings: dict[str, list[Any]], name: str, default: float) -> Array:
    values = np.array(settings.get(name, [default] * 3)[:3], dtype=np.float64)
    if values.shape != (3,) or not np.isfinite(values).all():
        raise ValueError(f"'{name}' is not three numbers")
    return values


def _turn(degrees: Array) -> Array:
    """Return the (3, 3) rotation by angles about the fixed axes x, y, z in turn, FBX's usual order."""
    from scipy.spatial.transform import Rotation

    matrix: Array = Rotation.from_euler("xyz", degrees, degrees=True).as_matrix()
    return matrix


def _frame(root: Node) -> tuple[float, str]:
    """Return the metres in a unit of the file, and its axis that points up."""
    settings = root.find("GlobalSettings")
    table = {} if settings is None else settings.settings()
    axis = int(table.get("UpAxis", [1])[0])
    sign = "" if table.get("UpAxisSign", [1])[0] >= 0 else "-"
    unit = float(table.get("UnitScaleFactor", [1.0])[0])
    if axis not in (0, 1, 2) or not 1e-6 < unit < 1e6:
        raise ValueError(f"the up axis {axis} or the unit {unit} makes no sense")
    return METRES_PER_UNIT * unit, sign + "xyz"[axis]


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
