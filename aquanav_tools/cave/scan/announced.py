"""What the header of a scan announces, held against the file's size before anything is loaded."""

from __future__ import annotations

import json
import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from aquanav_tools.errors import InputError, ResourceError
from aquanav_tools.text_files import NOT_A_TABLE

MAX_LOADED = 20_000_000
"""More points than this take over 4 GB; LAS files are thinned while they are read, other formats are refused before."""
MAX_HEADER_BYTES = 1 << 20
"""Of a PLY."""
BYTES_PER_POINT = {".stl": 100, ".obj": 60, ".off": 60}
"""At least: an STL has two triangles of 50 bytes per vertex, a text 25 characters for each vertex and triangle."""
PLY_BYTES = {
    "char": 1, "uchar": 1, "int8": 1, "uint8": 1, "short": 2, "ushort": 2, "int16": 2, "uint16": 2, "int": 4, "uint": 4,
    "int32": 4, "uint32": 4, "float": 4, "float32": 4, "double": 8, "float64": 8,
}  # fmt: skip
GLB_JSON = b"JSON"


@dataclass
class Element:
    """A kind of rows that a PLY announces."""

    name: str
    count: int
    row_bytes: list[int] = field(default_factory=list)
    """At least, of each property in binary; a list may be empty."""


def check_announced(path: Path, suffix: str) -> None:
    """Refuse a mesh or cloud by what its header or its size announces.

    Raises:
        InputError: the file is too small for what it announces.
        ResourceError: it has more points than can be loaded.
    """
    size = path.stat().st_size
    announced = size // BYTES_PER_POINT[suffix] if suffix in BYTES_PER_POINT else 0
    if suffix == ".ply":
        announced = _check_ply(path, size)
    elif suffix in (".glb", ".gltf"):
        announced = _num_placeholders(path, suffix)
    check_count(path, announced)


def check_count(path: Path, count: int) -> None:
    """Refuse a number of points.

    Raises:
        ResourceError: it is more than MAX_LOADED.
    """
    if count > MAX_LOADED:
        raise ResourceError(
            f"{path} has about {count / 1e6:.0f} million points, more than the {MAX_LOADED / 1e6:.0f} million that fit "
            "into 4 GB. Thin it to one point per centimetre first, or save it as LAS, which is thinned while it is "
            "read."
        )


def _check_ply(path: Path, size: int) -> int:
    """Return how many vertices a PLY announces; nought where it has no header that can be read."""
    with path.open("rb") as stream:
        head, end, _ = stream.read(MAX_HEADER_BYTES).partition(b"end_header")
    elements = list(_elements(head.decode("ascii", "replace")))
    is_binary = b"format binary" in head
    # In a text every value takes a digit and what parts it from the next.
    least = sum(each.count * (sum(each.row_bytes) if is_binary else 2 * len(each.row_bytes)) for each in elements)
    if end and least > size - len(head):
        counts = ", ".join(f"{each.count:,} of {each.name}" for each in elements)
        raise InputError(
            f"{path} cannot be read as '.ply': its header announces {counts}, which take {least:,} bytes or more, and "
            f"the file has {size:,}. It was damaged or cut off. Copy or export it again."
        )
    return max((each.count for each in elements if each.name == "vertex"), default=0)


def _elements(head: str) -> Iterator[Element]:
    """Yield the elements that a PLY's header announces."""
    element = None
    for words in map(str.split, head.splitlines()):
        if words[:1] == ["element"] and len(words) == 3 and words[2].isdecimal():
            if element is not None:
                yield element
            element = Element(words[1], int(words[2][:30]))
        elif words[:1] == ["property"] and len(words) > 2 and element is not None:
            element.row_bytes.append(PLY_BYTES.get(words[2 if words[1] == "list" else 1], 1))
    if element is not None:
        yield element


def _num_placeholders(path: Path, suffix: str) -> int:
    """Return how many values a glTF announces without holding them: they stand for zeros, and take memory all the same.

    A file that cannot be read so is left to its parser, which says what is wrong.
    """
    try:
        accessors = json.loads(_gltf_text(path, suffix))["accessors"]
        return sum(math.ceil(float(one["count"])) for one in accessors if "bufferView" not in one)
    except (*NOT_A_TABLE, RecursionError, AttributeError, struct.error):
        return 0


def _gltf_text(path: Path, suffix: str) -> Any:
    with path.open("rb") as stream:
        if suffix == ".gltf":
            return stream.read()
        _, _, _, num_bytes, kind = struct.unpack("<4sIII4s", stream.read(20))
        return stream.read(num_bytes) if kind == GLB_JSON else b""
