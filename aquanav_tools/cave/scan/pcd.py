"""Reading PCD, the format of the Point Cloud Library: as text, binary, or packed with LZF.

Source: Point Cloud Library, The PCD (Point Cloud Data) file format, version 0.7.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import IO, Any

import numba
import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.scan.announced import check_count
from aquanav_tools.cave.scan.surface_file import SurfaceFile, unit_vectors, unreadable
from aquanav_tools.types import Array, PointCloud

MAX_HEADER_LINES, MAX_LINE_BYTES = 40, 10_000
MAX_RECORD_BYTES = 1 << 16
KINDS = {"I": "i", "U": "u", "F": "f"}
SIZES = {"i": (1, 2, 4, 8), "u": (1, 2, 4, 8), "f": (4, 8)}
LZF_RATIO = 88
"""At most 264 bytes out of 3."""
SIZES_BEFORE = struct.Struct("<II")
"""Packed and unpacked size, before packed points."""
NORMALS = ("normal_x", "normal_y", "normal_z")
AXES = ("x", "y", "z")


@dataclass(frozen=True)
class PcdHeader:
    """What a header says of the points."""

    record: np.dtype[Any]
    """Of one point."""
    num_points: int
    encoding: str
    """ascii, binary or binary_compressed."""


def read_pcd(path: Path) -> SurfaceFile:
    """Return the points with finite coordinates, with normals and colours where the file has them.

    Raises:
        InputError: it is empty, damaged, cut off or of another format.
        ResourceError: it has too many points.
    """
    with path.open("rb") as stream:
        try:
            header = _read_header(stream)
            check_count(path, header.num_points)
            table = _READERS[header.encoding](stream, header, path.stat().st_size - stream.tell())
        except ValueError as cause:
            raise unreadable(path, str(cause)) from cause
    points = _columns(table, AXES)
    is_kept = np.isfinite(points).all(axis=1)  # organised clouds have NaN where nothing was measured
    normals = _columns(table, NORMALS)[is_kept] if set(NORMALS) <= set(header.record.names or ()) else None
    if normals is not None and not np.isfinite(normals).all():
        normals = None
    colours = _colours(table)
    return SurfaceFile(
        PointCloud(
            points[is_kept],
            None if normals is None else unit_vectors(normals),
            None if colours is None else colours[is_kept],
        )
    )


def _read_header(stream: IO[bytes]) -> PcdHeader:
    """Return the header at a stream's beginning.

    Raises:
        ValueError: it is none.
    """
    entries: dict[str, list[str]] = {}
    for line in islice(iter(lambda: stream.readline(MAX_LINE_BYTES), b""), MAX_HEADER_LINES):
        words = line.decode("ascii", "replace").split()
        if words and not words[0].startswith("#"):
            entries[words[0].upper()] = words[1:]
        if "DATA" in entries:
            break
    lacking = [name for name in ("FIELDS", "SIZE", "TYPE", "WIDTH", "HEIGHT", "DATA") if not entries.get(name)]
    if lacking:
        raise ValueError(f"its header has no {', '.join(lacking)}")
    encoding = entries["DATA"][0].lower()
    if encoding not in _READERS:
        raise ValueError(f"its points are stored as {encoding[:30]!r}, not as ascii, binary or binary_compressed")
    num_points = _whole(entries["WIDTH"][0]) * _whole(entries["HEIGHT"][0])
    return PcdHeader(_record(entries), _whole((entries.get("POINTS") or [str(num_points)])[0]), encoding)


def _record(entries: dict[str, list[str]]) -> np.dtype[Any]:
    """Return the fields of a point."""
    names, counts = entries["FIELDS"], entries.get("COUNT", ["1"] * len(entries["FIELDS"]))
    fields: list[tuple[str, str, tuple[int]]] = []
    if not len(names) == len(entries["SIZE"]) == len(entries["TYPE"]) == len(counts):
        raise ValueError("FIELDS, SIZE, TYPE and COUNT of its header have not the same number of entries")
    for n, (name, size, kind, count) in enumerate(zip(names, entries["SIZE"], entries["TYPE"], counts, strict=True)):
        code = KINDS.get(kind.upper(), "")
        if not code or _whole(size) not in SIZES[code] or not 1 <= _whole(count) <= MAX_RECORD_BYTES:
            raise ValueError(
                f"its field {name[:30]!r} has the type {kind[:9]!r}, size {size[:9]!r}, count {count[:9]!r}"
            )
        is_new = name not in {field[0] for field in fields}
        fields.append((name if is_new and name != "_" else f"_{n}", f"<{code}{size}", (_whole(count),)))
    record = np.dtype(fields)
    if record.itemsize > MAX_RECORD_BYTES:
        raise ValueError(f"its points have {record.itemsize:,} bytes each")
    if not set(AXES) <= set(record.names or ()):
        raise ValueError(f"its points have no x, y and z, only {' '.join(names)[:100]}")
    return record


def _whole(word: str) -> int:
    if not word.isdecimal() or len(word) > 18:
        raise ValueError(f"{word[:30]!r} stands in its header where a number should")
    return int(word)


def _read_ascii(stream: IO[bytes], header: PcdHeader, size: int) -> npt.NDArray[Any]:
    widths = [header.record[name].shape[0] for name in header.record.names or ()]
    _check_size(header, 2 * sum(widths) * header.num_points, size + 1)
    lines = [line for line in (raw.decode("ascii", "replace").strip() for raw in stream) if line]
    if len(lines) != header.num_points:
        raise ValueError(f"its header announces {header.num_points:,} points, and it has {len(lines):,} lines of them")
    rows = np.loadtxt(lines, ndmin=2, comments=None)
    if rows.shape[1] != sum(widths):
        raise ValueError(f"its points have {rows.shape[1]} columns, and its header announces {sum(widths)}")
    table = np.zeros(len(rows), header.record)
    begins = np.cumsum([0, *widths])
    for name, begin, end in zip(header.record.names or (), begins[:-1], begins[1:], strict=True):
        with np.errstate(invalid="ignore", over="ignore"):  # what does not fit is no coordinate that is used
            table[name] = rows[:, begin:end].astype(header.record[name].base)
    return table


def _read_binary(stream: IO[bytes], header: PcdHeader, size: int) -> npt.NDArray[Any]:
    _check_size(header, header.record.itemsize * header.num_points, size)
    return np.frombuffer(stream.read(header.record.itemsize * header.num_points), header.record)


def _read_packed(stream: IO[bytes], header: PcdHeader, size: int) -> npt.NDArray[Any]:
    """Return points that were stored field by field, then packed."""
    num_bytes = header.record.itemsize * header.num_points
    head = stream.read(SIZES_BEFORE.size)
    if len(head) < SIZES_BEFORE.size:
        raise ValueError("it ends before its points")
    packed, unpacked = SIZES_BEFORE.unpack(head)
    if packed > size - SIZES_BEFORE.size or unpacked != num_bytes or unpacked > LZF_RATIO * packed:
        raise ValueError(
            f"its header announces {header.num_points:,} points of {header.record.itemsize} bytes, packed into "
            f"{packed:,} bytes that unpack to {unpacked:,}, and the file has {size:,} after the header"
        )
    content = np.zeros(unpacked, dtype=np.uint8)
    if _unpack_lzf(np.frombuffer(stream.read(packed), dtype=np.uint8), content) != unpacked:
        raise ValueError("its packed points are damaged")
    table = np.zeros(header.num_points, header.record)
    begin = 0
    for name in header.record.names or ():
        field = header.record[name]
        end = begin + field.itemsize * header.num_points
        table[name] = content[begin:end].view(field.base).reshape(header.num_points, *field.shape)
        begin = end
    return table


@numba.njit(cache=True)
def _unpack_lzf(packed: npt.NDArray[np.uint8], content: npt.NDArray[np.uint8]) -> int:
    """Fill the content and return how many bytes there are; -1 where the packed bytes are damaged.

    Source: M. Lehmann, LibLZF: a byte below 32 is followed by that many and one bytes as they are; another tells how
    many bytes are repeated, and how far back they begin.
    """
    at, end = 0, 0
    while at < len(packed):
        control = int(packed[at])
        at += 1
        if control < 32:
            count = control + 1
            if at + count > len(packed) or end + count > len(content):
                return -1
            content[end : end + count] = packed[at : at + count]
            at += count
        else:
            count = (control >> 5) + 2
            if count == 9:
                if at >= len(packed):
                    return -1
                count += int(packed[at])
                at += 1
            if at >= len(packed):
                return -1
            begin = end - ((control & 31) << 8) - int(packed[at]) - 1
            at += 1
            if begin < 0 or end + count > len(content):
                return -1
            for n in range(count):  # one by one: they may overlap
                content[end + n] = content[begin + n]
        end += count
    return end


_READERS = {"ascii": _read_ascii, "binary": _read_binary, "binary_compressed": _read_packed}


def _check_size(header: PcdHeader, least: int, size: int) -> None:
    if least > size:
        raise ValueError(
            f"its header announces {header.num_points:,} points, which take {least:,} bytes or more, and the file has "
            f"{size:,} after it"
        )


def _columns(table: npt.NDArray[Any], names: tuple[str, ...]) -> Array:
    return np.stack([table[name][:, 0].astype(np.float64) for name in names], axis=1)


def _colours(table: npt.NDArray[Any]) -> npt.NDArray[np.uint8] | None:
    """Return the RGB in a field `rgb` or `rgba`: four bytes, 0xAARRGGBB, of a float or an integer."""
    name = next((each for each in ("rgb", "rgba") if each in (table.dtype.names or ())), None)
    if name is None or table[name].dtype.itemsize != 4:
        return None
    bits = np.ascontiguousarray(table[name][:, 0]).view(np.uint32)
    return np.stack([(bits >> shift).astype(np.uint8) for shift in (16, 8, 0)], axis=1)
