"""Reading the text files of Unity: prefabs and scenes, which are YAML documents with a class and an identity each.

Unity writes a small part of YAML: block tables and lists, flow tables such as {x: 1, y: 2}, plain and quoted texts.
That part is read here, and no more; anchors, tags within values and the like never occur.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from aquanav_tools.errors import InputError
from aquanav_tools.text_files import read_text

MAX_FILE_BYTES = 256 << 20
HEADER = re.compile(r"^--- !u!(\d+) &(-?\d+)( stripped)?\s*$", re.MULTILINE)
KEY = re.compile(r"(- )?([A-Za-z_][\w .\[\]]*):(?: (.*))?$")
MAX_DEPTH = 64
LFS_POINTER = "version https://git-lfs"


@dataclass(frozen=True)
class Document:
    """One object of a Unity file."""

    kind: int
    """Unity's class: 1 GameObject, 4 Transform, 114 MonoBehaviour, 1001 PrefabInstance."""
    identity: int
    """Its number in the file."""
    fields: dict[str, Any]


def read_documents(path: Path, kinds: Collection[int]) -> dict[int, Document]:
    """Return the objects of some classes in a Unity file, by their number in it.

    Raises:
        InputError: the file is too large, not Unity's YAML, or a pointer of Git LFS.
    """
    text = read_text(path, max_bytes=MAX_FILE_BYTES, encoding="utf-8-sig")
    if text.startswith(LFS_POINTER):
        raise InputError(f"{path} is only a pointer of Git LFS. Fetch the file itself: git lfs pull.")
    if not text.startswith("%YAML"):
        raise InputError(f"{path} is not a text file of Unity: it does not begin with %YAML. Set Unity to write text.")
    headers = list(HEADER.finditer(text))
    if not headers:
        raise InputError(f"{path} holds no object. It is damaged or was cut off; clone the project again.")
    ends = [*(header.start() for header in headers[1:]), len(text)]
    found: dict[int, Document] = {}
    for header, end in zip(headers, ends, strict=True):
        kind, identity = int(header[1]), int(header[2])
        if kind in kinds:
            found[identity] = Document(kind, identity, _fields(text[header.end() : end], path))
    return found


def _fields(body: str, path: Path) -> dict[str, Any]:
    lines = _joined(line for line in body.splitlines() if line.strip())
    try:
        value, used = _block(lines, 0, 0)
    except (ValueError, IndexError) as cause:
        raise InputError(f"{path} cannot be read as Unity's YAML: {cause}. It is damaged; clone it again.") from cause
    if used != len(lines) or not isinstance(value, dict) or len(value) != 1:
        raise InputError(f"{path} has an object that is not one table. It is damaged; clone it again.")
    (fields,) = value.values()
    return fields if isinstance(fields, dict) else {}


def _joined(lines: Iterator[str]) -> list[str]:
    """Return the lines with those joined that Unity broke within a flow table or a text."""
    joined: list[str] = []
    for line in lines:
        is_open = joined and joined[-1].count("{") > joined[-1].count("}")
        is_rest = joined and KEY.match(line.strip()) is None and not line.strip().startswith("- ")
        if is_open or (is_rest and line.strip() != "-"):
            joined[-1] += " " + line.strip()
        else:
            joined.append(line)
    return joined


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip(" "))


def _block(lines: list[str], first: int, depth: int) -> tuple[Any, int]:
    """Return the table or list that begins at a line, and the line after it."""
    if depth > MAX_DEPTH:
        raise ValueError(f"tables nested deeper than {MAX_DEPTH}")
    if lines[first].lstrip().startswith("- "):
        return _list(lines, first, depth)
    indent, table = _indent(lines[first]), {}
    n = first
    while n < len(lines) and _indent(lines[n]) == indent and not lines[n].lstrip().startswith("- "):
        match = KEY.match(lines[n].strip())
        if match is None:
            raise ValueError(f"'{lines[n].strip()[:60]}' is no field")
        n += 1
        if match[3]:
            table[match[2]] = _value(match[3], depth)
        elif n < len(lines) and _belongs(lines[n], indent):
            table[match[2]], n = _block(lines, n, depth + 1)
        else:
            table[match[2]] = ""
    return table, n


def _belongs(line: str, indent: int) -> bool:
    """Return whether a line is inside the field above it; Unity indents lists no deeper than their field."""
    return _indent(line) > indent or (_indent(line) == indent and line.lstrip().startswith("- "))


def _list(lines: list[str], first: int, depth: int) -> tuple[list[Any], int]:
    indent, items = _indent(lines[first]), []
    n = first
    while n < len(lines) and _indent(lines[n]) == indent and lines[n].lstrip().startswith("- "):
        head = lines[n].lstrip()[2:]
        if head.startswith("{") or KEY.match(head) is None:
            items.append(_value(head, depth))
            n += 1
            continue
        last = n + 1
        while last < len(lines) and _indent(lines[last]) > indent:
            last += 1
        rows = [" " * (indent + 2) + head, *lines[n + 1 : last]]
        item, used = _block(rows, 0, depth + 1)
        if used != len(rows):
            raise ValueError(f"'{rows[used].strip()[:60]}' is indented like no other line")
        items.append(item)
        n = last
    return items, n


def _value(text: str, depth: int) -> Any:
    text = text.strip()
    if text.startswith("{") and text.endswith("}"):
        if depth > MAX_DEPTH:
            raise ValueError(f"tables nested deeper than {MAX_DEPTH}")
        parts = (part.partition(":") for part in _split(text[1:-1]) if part.strip())
        return {key.strip(): _value(value, depth + 1) for key, _, value in parts}
    if text == "[]":
        return []
    if len(text) >= 2 and text[0] == text[-1] and text[0] in "'\"":
        return text[1:-1]
    return text


def _split(text: str) -> Iterator[str]:
    """Yield the parts of a flow table between its own commas."""
    depth, first = 0, 0
    for n, sign in enumerate(text):
        depth += (sign == "{") - (sign == "}")
        if sign == "," and depth == 0:
            yield text[first:n]
            first = n + 1
    yield text[first:]
