"""Unpacking LAZ in a process of its own, with bounded memory and time.

The decoder (lazrs) ends its process where a damaged file makes it: a panic in Rust, or memory that is not there. Here
that is a sentence. The child is this module: `python -m aquanav_tools.cave.scan.laz FILE CHUNK SECONDS [COLUMN ...]`.
"""

from __future__ import annotations

import signal
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.types import Array

MAX_MEMORY = 2 << 30
"""Address space beyond that of Python and its libraries; a chunk takes 0.2 GB."""
LEAST_SECONDS, POINTS_PER_SECOND = 10, 100_000
"""Processor time granted: that of the start, and a twentieth of the speed measured."""
WALL_FACTOR = 20
"""A busy machine may take this many times the processor time."""
ROWS = struct.Struct("<Q")
"""Before each table: its number of rows."""
STATM = Path("/proc/self/statm")


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
    seconds = LEAST_SECONDS + num_points // POINTS_PER_SECOND
    command = [sys.executable, "-m", __name__, str(path.resolve()), str(chunk), str(seconds), *columns]
    with tempfile.TemporaryFile() as errors:
        child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors)
        timer = threading.Timer(WALL_FACTOR * seconds, child.kill)
        timer.start()
        num_read = 0
        try:
            assert child.stdout is not None
            for table in _tables(child.stdout, 3 + len(columns)):
                num_read += len(table)
                yield table
            code = child.wait()
            is_late = not timer.is_alive()
        finally:
            timer.cancel()
            child.kill()
            child.wait()
        if code:
            late = f"unpacking it took more than {seconds} s of processor time"
            reason = late if is_late or code == -getattr(signal, "SIGXCPU", 0) else _reason(code, errors)
            raise InputError(
                f"{path} cannot be read as LAZ: {reason}, after {num_read:,} of {num_points:,} points. The file is "
                "damaged or cut off. Copy or export it again."
            )


def _tables(stream: IO[bytes], num_columns: int) -> Iterator[Array]:
    """Yield the tables in a stream, each behind its number of rows, until it ends, or breaks off with its writer."""
    while len(head := stream.read(ROWS.size)) == ROWS.size:
        (num_rows,) = ROWS.unpack(head)
        content = stream.read(8 * num_rows * num_columns)
        if len(content) == 8 * num_rows * num_columns:
            yield np.frombuffer(content, dtype=np.float64).reshape(num_rows, num_columns)


def _reason(code: int, errors: IO[bytes]) -> str:
    """Return how the child ended: by a signal, or by an error whose last line it left."""
    if code < 0:
        return f"the decoder ended with {signal.Signals(-code).name}"
    errors.seek(0)
    lines = errors.read().decode(errors="replace").strip().splitlines()
    return lines[-1].rstrip(".") if lines else f"the decoder ended with code {code}"


def _limit(seconds: int) -> None:
    """Bound this process's processor time and, where the system tells how much it has, its memory; leave no core.

    Windows has no such bounds; there only the wall time ends a decoder that goes on for ever.
    """
    try:
        import resource
    except ModuleNotFoundError:
        return
    limits = {resource.RLIMIT_CPU: seconds, resource.RLIMIT_CORE: 0}
    if STATM.exists():
        limits[resource.RLIMIT_AS] = int(STATM.read_text().split()[0]) * resource.getpagesize() + MAX_MEMORY
    for kind, bound in limits.items():
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (bound if hard == resource.RLIM_INFINITY else min(bound, hard), hard))


def _main(arguments: Sequence[str]) -> None:
    """Write the tables of a file to standard output, as `_tables` reads them."""
    import laspy  # noqa: F401  # before the bound on memory

    path, chunk, seconds, *columns = arguments
    _limit(int(seconds))
    for table in las_tables(Path(path), columns, int(chunk)):
        sys.stdout.buffer.write(ROWS.pack(len(table)) + table.tobytes())
    sys.stdout.buffer.flush()


if __name__ == "__main__":
    _main(sys.argv[1:])
