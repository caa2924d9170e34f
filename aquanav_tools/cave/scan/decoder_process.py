"""Decoding files in a process of its own, with bounded memory and time.

Native decoders end their process where a damaged file makes them: a panic in Rust, a failed assertion in C++, or memory
that is not there. Here that is a sentence. The child is this module:
`python -m aquanav_tools.cave.scan.decoder_process MODULE SECONDS MEMORY FILE [ARGUMENT ...]`. It imports MODULE, which
has `prepare()`, to load its libraries before the bound on memory, and `decode(path, *arguments)`, which yields tables
of numbers.
"""

from __future__ import annotations

import importlib
import os
import signal
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from aquanav_tools.errors import AquanavError, InputError, ResourceError

CLOUD_MEMORY, MODEL_MEMORY = 2 << 30, 4 << 30
"""Address space beyond that of Python and its libraries, bytes: a cloud's chunk takes 0.2 GB, a model is read whole."""
WALL_FACTOR = 20
"""A busy machine may take this many times the processor time."""
LEAST_SECONDS, BYTES_PER_SECOND = 20, 1_000_000
"""Processor time granted where a file's size is all that is known: that of the start, and a twentieth of the speed."""
HEAD = struct.Struct("<2sQQ")
"""Before each array: the kind of its numbers (NumPy's, as f8), rows and columns."""
STATM = Path("/proc/self/statm")
TOLD = {error.exit_code: error for error in (InputError, ResourceError)}
"""Errors whose sentence the child writes; its exit code tells which."""


class DecodingError(Exception):
    """The decoder failed, was killed, or took too long: the reason, without the file and without advice."""


def seconds_for(path: Path) -> int:
    """Return the processor time that a file of its size may take to decode, s."""
    return LEAST_SECONDS + path.stat().st_size // BYTES_PER_SECOND


def decoded(
    module: str, path: Path, arguments: Sequence[str], seconds: int, memory: int = CLOUD_MEMORY
) -> Iterator[Any]:
    """Yield the arrays that a module's `decode` yields in another process.

    Args:
        module: its full name.
        path: of the file to decode.
        arguments: further ones of `decode`.
        seconds: of processor time that it may take.
        memory: address space that it may take, bytes.

    Raises:
        DecodingError: the other process failed, was killed, or took too long.
        InputError: its decoder raised one.
        ResourceError: likewise.
    """
    command = [sys.executable, "-m", __name__, module, str(seconds), str(memory), str(path.resolve()), *arguments]
    with tempfile.TemporaryFile() as errors:
        child = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors)
        timer = threading.Timer(WALL_FACTOR * seconds, child.kill)
        timer.start()
        try:
            assert child.stdout is not None
            yield from _arrays(child.stdout)
            code = child.wait()
            is_late = not timer.is_alive()
        finally:
            timer.cancel()
            child.kill()
            child.wait()
        if code in TOLD:
            raise TOLD[code](_last_line(errors))
        if code:
            late = f"unpacking it took more than {seconds} s of processor time"
            is_late |= code == -getattr(signal, "SIGXCPU", 0)
            raise DecodingError(late if is_late else _reason(code, errors))


def _arrays(stream: IO[bytes]) -> Iterator[Any]:
    """Yield the arrays in a stream, each behind its kind and shape, until it ends, or breaks off with its writer."""
    while len(head := stream.read(HEAD.size)) == HEAD.size:
        kind, num_rows, num_columns = HEAD.unpack(head)
        dtype = np.dtype(kind.decode())
        content = stream.read(dtype.itemsize * num_rows * num_columns)
        if len(content) == dtype.itemsize * num_rows * num_columns:
            yield np.frombuffer(content, dtype=dtype).reshape(num_rows, num_columns)


def _write(array: Any, stream: IO[bytes]) -> None:
    """Write a table of numbers as `_arrays` reads it."""
    stream.write(HEAD.pack(array.dtype.str[1:].encode(), *array.shape))
    stream.write(array.tobytes())


def _reason(code: int, errors: IO[bytes]) -> str:
    """Return how the child ended: by a signal, or by an error whose last line it left."""
    if code < 0:
        return f"the decoder ended with {signal.Signals(-code).name}"
    return _last_line(errors).rstrip(".") or f"the decoder ended with code {code}"


def _last_line(errors: IO[bytes]) -> str:
    errors.seek(0)
    lines = errors.read().decode(errors="replace").strip().splitlines()
    return lines[-1] if lines else ""


def _limit(seconds: int, memory: int) -> None:
    """Bound this process's processor time and, where the system tells how much it has, its memory; leave no core.

    Windows has no such bounds; there only the wall time ends a decoder that goes on for ever.
    """
    try:
        import resource
    except ModuleNotFoundError:
        return
    limits = {resource.RLIMIT_CPU: seconds, resource.RLIMIT_CORE: 0}
    if STATM.exists():
        limits[resource.RLIMIT_AS] = int(STATM.read_text().split()[0]) * resource.getpagesize() + memory
    for kind, bound in limits.items():
        hard = resource.getrlimit(kind)[1]
        resource.setrlimit(kind, (bound if hard == resource.RLIM_INFINITY else min(bound, hard), hard))


def _main(arguments: Sequence[str]) -> None:
    """Write the arrays of a file to standard output, as `_arrays` reads them."""
    name, seconds, memory, path, *others = arguments
    module = importlib.import_module(name)
    with os.fdopen(os.dup(1), "wb") as stream:
        os.dup2(2, 1)  # whatever a library prints is not taken for an array
        module.prepare()
        _limit(int(seconds), int(memory))
        try:
            for array in module.decode(Path(path), *others):
                _write(array, stream)
        except tuple(TOLD.values()) as error:
            assert isinstance(error, AquanavError)
            print(error, file=sys.stderr)
            sys.exit(error.exit_code)


if __name__ == "__main__":
    _main(sys.argv[1:])
