"""Reading LAS and LAZ files in chunks, after what their header announces was held against the file's size."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from aquanav_tools.cave.scan.laz import las_tables, unpacked_tables
from aquanav_tools.cave.scan.surface_file import unreadable
from aquanav_tools.cave.scan.thinning import EvenThinner, thinned_caution
from aquanav_tools.errors import AquanavError, InputError
from aquanav_tools.libraries import require
from aquanav_tools.types import Array, PointCloud

CHUNK_POINTS = 1_000_000
CHUNK_BYTES = 64 << 20
COLOUR_NAMES = ("red", "green", "blue")
NORMAL_NAMES = (("nx", "ny", "nz"), ("normal_x", "normal_y", "normal_z"), ("normalx", "normaly", "normalz"))
HEADER_BYTES = {0: 227, 1: 227, 2: 227, 3: 235, 4: 375, 5: 393}
"""By the minor version."""
RECORD_HEADER_BYTES = 54
"""Of one of the variable length records between header and points."""
MAX_POINTS_PER_BYTE = 16
"""Of LAZ. Scans take a byte or more per point."""


@dataclass(frozen=True)
class LasLayout:
    """Where a file's points are, and how many."""

    is_packed: bool
    """Whether it is LAZ."""
    num_points: int
    record_bytes: int
    """Of a point, unpacked."""

    @property
    def chunk(self) -> int:
        """Points to read at a time."""
        return min(CHUNK_POINTS, CHUNK_BYTES // self.record_bytes)


def read_las(path: Path) -> tuple[PointCloud, tuple[tuple[str, str], ...]]:
    """Return the points of a LAS or LAZ file, of a large one an even choice, and a caution (code, sentence) if so.

    Raises:
        InputError: the file is empty, damaged, cut off or of another format.
    """
    layout = read_layout(path)
    require("Reading LAS and LAZ", "laspy", "lazrs")
    thinner = EvenThinner()
    try:
        normals, colours = _columns(path)
        names = (*normals, *colours)
        tables = (
            unpacked_tables(path, names, layout.chunk, layout.num_points)
            if layout.is_packed
            else las_tables(path, names, layout.chunk)
        )
        for table in tables:
            thinner.add(table)
    except AquanavError:
        raise
    except Exception as cause:  # laspy raises its own and struct's errors on damaged files
        raise unreadable(path, str(cause)) from cause
    if not thinner.num_seen:
        raise InputError(f"{path} has 0 points; a surface needs at least 4. The file is empty or cut off.")
    table = thinner.result()
    cloud = PointCloud(table[:, :3], _unit(table[:, 3:6]) if normals else None, _rgb(table[:, -3:], colours))
    return cloud, thinned_caution(path.name, thinner, len(table))


def read_layout(path: Path) -> LasLayout:
    """Return what a header says of the points.

    Raises:
        InputError: it is no header of LAS, or the file is too small for what it announces.

    Source: ASPRS, LAS Specification 1.4 - R15 (2019), table 3.
    """
    with path.open("rb") as stream:
        head = stream.read(max(HEADER_BYTES.values()))
    size = path.stat().st_size
    minor = head[25] if len(head) > 25 else 0
    if head[:4] != b"LASF" or minor not in HEADER_BYTES or len(head) < HEADER_BYTES[minor]:
        raise unreadable(path, f"its {size:,} bytes do not begin with a header of LAS 1.0 to 1.5")
    header_bytes, points_at, num_records, kind, record_bytes, num_points = struct.unpack_from("<HIIBHI", head, 94)
    if minor >= 4:
        (num_points,) = struct.unpack_from("<Q", head, 247)
    layout = LasLayout(kind & 0xC0 == 0x80, num_points, max(record_bytes, 1))
    if not header_bytes + RECORD_HEADER_BYTES * num_records <= points_at <= size:
        raise unreadable(
            path,
            f"a header of {header_bytes:,} bytes and {num_records:,} records before the points, which begin at byte "
            f"{points_at:,}, do not fit its {size:,} bytes",
        )
    most = (size - points_at) * MAX_POINTS_PER_BYTE if layout.is_packed else (size - points_at) // layout.record_bytes
    if num_points > most:
        raise unreadable(
            path, f"its header announces {num_points:,} points, and its {size:,} bytes hold {most:,} at most"
        )
    return layout


def _columns(path: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of the columns with normals and with colours, as the file writes them; empty if none."""
    import laspy

    with laspy.open(path, read_evlrs=False) as reader:
        names = {name.lower(): name for name in reader.header.point_format.dimension_names}
        if not np.isfinite([*reader.header.scales, *reader.header.offsets]).all():
            raise ValueError("the scales or offsets of its coordinates are not finite")
    normals = next((keys for keys in NORMAL_NAMES if all(key in names for key in keys)), ())
    colours = COLOUR_NAMES if all(key in names for key in COLOUR_NAMES) else ()
    return tuple(names[key] for key in normals), tuple(names[key] for key in colours)


def _rgb(channels: Array, names: tuple[str, ...]) -> npt.NDArray[np.uint8] | None:
    """Return the (N, 3) RGB of three channels; LAS means 16 bits, many programs write 8."""
    if not names or not channels.any():
        return None
    return (channels // 256 if channels.max() > 255 else channels).astype(np.uint8)


def _unit(vectors: Array) -> Array:
    unit: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    return unit
