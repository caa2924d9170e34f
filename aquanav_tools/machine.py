"""What systems differ in: cores, memory, priority, locks. Only this module asks which one it is.

Linux and macOS have what POSIX has; Windows has no `fcntl`, `resource` and `os.nice`, and macOS no affinity.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any

CACHE_VARIABLE = "AQUANAV_CACHE"
WAIT_S = 0.05
"""Between two tries for a lock, where the system cannot wait for one for as long as it takes."""
FAR = 2**30
"""The byte that is locked on Windows, where others can neither read nor write what is: behind all that is written."""


def num_cores() -> int:
    """Return how many cores this process may use."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def user_cache() -> Path | None:
    """Return the folder in which programs of this user keep what they can make again; None where there is no home."""
    if sys.platform == "win32":
        given = os.environ.get("LOCALAPPDATA")
    else:
        given = os.environ.get("XDG_CACHE_HOME") if sys.platform != "darwin" else None
    if given:
        return Path(given)
    try:
        home = Path.home()
    except RuntimeError:  # a user without a name, as in containers
        return None
    return home / {"win32": "AppData/Local", "darwin": "Library/Caches"}.get(sys.platform, ".cache")


def cache_folder() -> Path | None:
    """Return the folder for what this package can make again: AQUANAV_CACHE, or aquanav in the user's cache, if any."""
    given, base = os.environ.get(CACHE_VARIABLE), user_cache()
    return Path(given) if given else None if base is None else base / "aquanav"


def lower_priority(niceness: int) -> None:
    """Let other processes go first: by so many steps of 19, or on Windows before all of normal priority."""
    if niceness <= 0:
        return
    if hasattr(os, "nice"):
        os.nice(niceness)
        return
    import psutil

    psutil.Process().nice(psutil.BELOW_NORMAL_PRIORITY_CLASS)


def free_memory() -> int:
    """Return the bytes of memory that can be had without swapping."""
    import psutil

    return int(psutil.virtual_memory().available)


def peak_memory() -> float:
    """Return the most memory that this process has held, MiB."""
    try:
        import resource
    except ModuleNotFoundError:
        import psutil

        return float(psutil.Process().memory_info().peak_wset) / 2**20
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return float(peak) / (2**20 if sys.platform == "darwin" else 2**10)  # getrusage(2): bytes on macOS, else KiB


@contextlib.contextmanager
def exclusive(stream: IO[Any], *, waits: bool) -> Iterator[None]:
    """Lock an open file for this process; the lock ends with the body, or with the process, however that ends.

    Args:
        stream: Of the file, open for writing.
        waits: Until another process lets go.

    Raises:
        BlockingIOError: another process holds it.
    """
    try:
        import fcntl
    except ModuleNotFoundError:
        with _exclusive_on_windows(stream, waits):
            yield
        return
    fcntl.flock(stream, fcntl.LOCK_EX | (0 if waits else fcntl.LOCK_NB))
    try:
        yield
    finally:
        fcntl.flock(stream, fcntl.LOCK_UN)


def sync(path: Path) -> None:
    """Bring a file, or the names in a folder, onto the disk; Windows opens no folder, and NTFS logs names by itself."""
    is_windows = sys.platform == "win32"
    if is_windows and path.is_dir():
        return
    descriptor = os.open(path, os.O_RDWR if is_windows else os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def _exclusive_on_windows(stream: IO[Any], waits: bool) -> Iterator[None]:
    msvcrt: Any = importlib.import_module("msvcrt")  # typed for Windows alone
    while True:
        stream.seek(FAR)
        try:
            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
            break
        except OSError as error:
            if not waits:
                raise BlockingIOError(*error.args) from error
            time.sleep(WAIT_S)
    try:
        yield
    finally:
        stream.seek(FAR)
        msvcrt.locking(stream.fileno(), msvcrt.LK_UNLCK, 1)
