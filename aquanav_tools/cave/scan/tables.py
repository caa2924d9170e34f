"""Points in texts: tables of `x y z`, and PTS and PTX, which terrestrial scanners' programs write."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import IO

import numpy as np

from aquanav_tools.cave.scan.announced import check_count
from aquanav_tools.cave.scan.stationed import CHUNK_POINTS, cloud_of_tables, stationed_table
from aquanav_tools.cave.scan.surface_file import SurfaceFile, unit_vectors, unreadable
from aquanav_tools.errors import InputError
from aquanav_tools.text_files import check_utf8
from aquanav_tools.types import Array, PointCloud

LEAST_ROW_BYTES = 6
"""Of a point: three digits, each with what parts it from the next."""
MAX_DIGITS = 18
PTX_HEAD = 8
"""Lines after the two counts: the scanner's place, its three axes, and the four rows of the transformation."""


def read_table(path: Path) -> SurfaceFile:
    """Read rows of x y z, with nx ny nz after them when those are unit vectors; other columns are left out.

    Raises:
        InputError: it is no such table.
        ResourceError: it has too many points.
    """
    with path.open("rb") as stream:
        start = stream.read(65536)
    if not start.strip():
        raise InputError(f"{path} is empty: it has 0 points, and a surface needs at least 4. Export the scan again.")
    check_count(path, path.stat().st_size * len(start.splitlines()) // len(start))
    check_utf8(path)
    delimiter = "," if b"," in start.splitlines()[0] else None
    try:
        rows = np.loadtxt(path, delimiter=delimiter, ndmin=2, comments=("#", "//"), encoding="utf-8")
    except ValueError as cause:
        raise InputError(
            f"{path} is not a table of numbers 'x y z [nx ny nz]': {cause}. Correct the file there."
        ) from cause
    if rows.shape[1] < 3:
        raise InputError(f"{path} has {rows.shape[1]} columns; a point needs x y z. Export it again with coordinates.")
    has_normals = rows.shape[1] >= 6 and np.allclose(np.linalg.norm(rows[:, 3:6], axis=1), 1.0, atol=0.01)
    return SurfaceFile(PointCloud(rows[:, :3], unit_vectors(rows[:, 3:6]) if has_normals else None))


def read_pts(path: Path) -> SurfaceFile:
    """Return the points of a PTS file: a count, then so many rows `x y z [intensity] [r g b]`, once or several times.

    One without counts is read as any table.

    Raises:
        InputError: it is damaged or cut off.
        ResourceError: it has no counts, and too many points.
    """
    with path.open("rb") as stream:
        first = stream.readline(1000)
    if len(first.split()) != 1:
        return read_table(path)
    check_utf8(path)
    return cloud_of_tables(path, _pts_tables(path), metres_per_unit=None)


def _pts_tables(path: Path) -> Iterator[Array]:
    with path.open("rb") as stream:
        while line := stream.readline():
            if line.strip():
                for rows in _rows(path, stream, _count(path, line)):
                    yield stationed_table(rows[:, :3], _colours(rows), None)


def read_ptx(path: Path) -> SurfaceFile:
    """Return the points of all scans in a PTX file, each by its own transformation, with colours and stations.

    Raises:
        InputError: it is damaged or cut off.

    Source: Leica Geosystems, Cyclone PTX format: counts of columns and rows, the scanner's place and axes, a matrix for
    row vectors, then `x y z intensity [r g b]` in the scanner's frame; 0 0 0 stands for a direction without return.
    """
    check_utf8(path)
    return cloud_of_tables(path, _ptx_tables(path))


def _ptx_tables(path: Path) -> Iterator[Array]:
    with path.open("rb") as stream:
        while line := stream.readline():
            if not line.strip():
                continue
            count = _count(path, line) * _count(path, stream.readline())
            place, *_, first, second, third, moved = _head(path, stream)
            matrix = np.array([first[:3], second[:3], third[:3]])
            offset = np.array(moved[:3])
            is_turned = bool(offset.any() or not np.allclose(matrix, np.eye(3)))
            station = offset if is_turned else np.array(place[:3])
            for rows in _rows(path, stream, count):
                rows = rows[rows[:, :3].any(axis=1)]
                points = rows[:, :3] @ matrix + offset
                yield stationed_table(points, _colours(rows), station if station.any() or is_turned else None)


def _head(path: Path, stream: IO[bytes]) -> list[list[float]]:
    """Return the numbers in the lines between the counts and the points of a PTX."""
    lines = [stream.readline(1000).split() for _ in range(PTX_HEAD)]
    wanted = (3, 3, 3, 3, 4, 4, 4, 4)
    try:
        numbers = [[float(word) for word in line] for line in lines]
    except ValueError as cause:
        raise unreadable(path, f"{cause} in the scanner's place, axes and matrix") from cause
    if any(len(line) < least for line, least in zip(numbers, wanted, strict=True)) or not all(
        np.isfinite(line).all() for line in numbers
    ):
        raise unreadable(
            path, "after the counts of columns and rows there must be 8 lines: place, 3 axes, 4 rows of a matrix"
        )
    return numbers


def _count(path: Path, line: bytes) -> int:
    """Return the number that stands alone in a line."""
    word = line.strip()
    if not word.isdigit() or len(word) > MAX_DIGITS:
        raise unreadable(path, f"{word[:30]!r} stands where a number of points should")
    return int(word)


def _rows(path: Path, stream: IO[bytes], count: int) -> Iterator[Array]:
    """Yield so many rows of numbers, some at a time; the count is held against the file's size before."""
    left = path.stat().st_size - stream.tell()
    if count * LEAST_ROW_BYTES > left + 1:
        raise unreadable(
            path, f"it announces {count:,} points, and the {left:,} bytes that follow hold "
            f"{(left + 1) // LEAST_ROW_BYTES:,} at most"
        )  # fmt: skip
    for begin in range(0, count, CHUNK_POINTS):
        wanted = min(CHUNK_POINTS, count - begin)
        lines = [line for line in (raw.decode().strip() for raw in islice(stream, wanted)) if line]
        if len(lines) != wanted:
            raise unreadable(path, f"it announces {count:,} points and ends after {begin + len(lines):,}")
        try:
            rows = np.loadtxt(lines, ndmin=2, comments=None)
        except ValueError as cause:
            raise unreadable(path, f"a point is not numbers: {cause}") from cause
        if rows.shape[1] < 3:
            raise unreadable(path, f"its points have {rows.shape[1]} columns, and need x y z")
        yield rows


def _colours(rows: Array) -> Array | None:
    """Return the (N, 3) red, green and blue behind the intensity, or in its place; None without."""
    if rows.shape[1] >= 7:
        return rows[:, 4:7]
    if rows.shape[1] == 6 and ((rows[:, 3:] >= 0) & (rows[:, 3:] <= 255) & (rows[:, 3:] % 1 == 0)).all():
        return rows[:, 3:]
    return None
