"""Points of LAS files in chunks, and of LAZ files, whose decoder (lazrs) may end its process, out of another one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from aquanav_tools.cave.scan.decoder_process import DecodingError, decoded
from aquanav_tools.errors import InputError
from aquanav_tools.types import Array

LEAST_SECONDS, POINTS_PER_SECOND = 10, 100_000
"""Processor time granted: that of the start, and a twentieth of the speed measured."""


def prepare() -> None:
    """Load what `decode` needs."""
    import laspy  # noqa: F401


def decode(path: Path, chunk: str, *columns: str) -> Iterator[Array]:
    """Yield `las_tables` in the process that unpacks."""
    return las_tables(path, columns, int(chunk))


def las_tables(path: Path, columns: Sequence[str], chunk: int) -> Iterator[Array]:
    """Yield the points of a LAS or LAZ file: (N, 3 + C) x, y, z and the named columns, `chunk` points at a time."""
    import laspy

    with laspy.open(path, read_evlrs=False, laz_backend=laspy.LazBackend.Lazrs) as reader:
        for points in reader.chunk_iterator(chunk):
            parts = [points.x, points.y, points.z, *(points[name] for name in columns)]
            yield np.stack(parts, axis=1).astype(np.float64)


def unpacked_tables(path: Path, columns: Sequence[str], chunk: int, num_points: int) -> Iterator[Array]:
    """Yield `las_tables` of a LAZ file that another process unpacks.

    Args:
        path: Of the file.
        columns: Names of further columns.
        chunk: Points at a time.
        num_points: How many are announced; the time allowed grows with them.

    Raises:
        InputError: the other process failed, was killed, or took too long.
    """
    num_read = 0
    try:
        for table in decoded(__name__, path, (str(chunk), *columns), LEAST_SECONDS + num_points // POINTS_PER_SECOND):
            num_read += len(table)
            yield table
    except DecodingError as cause:
        raise InputError(
            f"{path} cannot be read as LAZ: {cause}, after {num_read:,} of {num_points:,} points. The file is "
            "damaged or cut off. Copy or export it again."
        ) from cause
