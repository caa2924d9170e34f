"""Keeping what the stages of long work make, so that a later run takes up what an earlier one finished.

Each stage writes into a folder STAGE-KEY of its own. The key is a hash of all that the result rests on: settings, the
content of inputs (for an earlier stage its folder's name, which holds its key), and the code that makes it. A changed
option thus changes the keys of the stages that depend on it, and of no other. A stage that was killed finds its folder
as it left it, and goes on there.
"""

from __future__ import annotations

import contextlib
import errno
import json
import os
import platform
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any

from aquanav_tools.errors import AquanavError, InputError, ResourceError
from aquanav_tools.machine import exclusive, sync
from aquanav_tools.provenance import code_digest, digest
from aquanav_tools.types import Progress, Stages, silent

MIN_FREE = 100_000_000
"""Bytes that must stay free on the disk. More than any library writes between two looks: SQLite within COLMAP ends the
process where the disk is full, instead of raising an error."""
FORMAT = 1
"""Of what stages write into their folders; raised where that is laid out anew while the code that makes it stays."""
KEPT = 2
"""Results kept of each stage: of this choice of options, and of the one before."""
_DONE_FILE = "done.json"
NO_RIGHT = (errno.EACCES, errno.EPERM, errno.EROFS)
NO_PLACE = (errno.ENOENT, errno.ENOTDIR, errno.EEXIST)
"""What systems answer where a folder cannot be made or written to: no right, or no place for it."""
LOCK_FILE = "lock"
"""In a folder that a build has begun to work in."""


class StageStore:
    """The folder in which the stages keep what they make. It may be deleted at any time: that costs time only."""

    def __init__(self, folder: Path, display: Stages = silent) -> None:
        self.folder = folder
        self._display = watched(display, folder)

    @contextlib.contextmanager
    def stage(
        self, title: str, name: str, maker: Callable[..., object], *inputs: object
    ) -> Iterator[tuple[Path, Progress]]:
        """Open the folder of one stage as `open` does, and show its progress under a title."""
        with self._display(title) as progress, self.open(name, maker, *inputs) as folder:
            yield folder, progress

    @contextlib.contextmanager
    def open(self, name: str, maker: Callable[..., object], *inputs: object) -> Iterator[Path]:
        """Open the folder of one stage; leaving it without an error marks the stage as finished.

        Args:
            name: A word for the stage.
            maker: The function that makes the result: its code, and what that uses, is part of the key.
            inputs: All that the result depends on: plain values, dataclasses, arrays, and names of other stages'
                folders.

        Raises:
            ResourceError: the disk is full; what was written so far is taken up by a later run.
        """
        folder = self.folder / f"{name}-{digest(FORMAT, code_digest(maker), inputs)}"
        with told_when_full(self.folder):
            folder.mkdir(parents=True, exist_ok=True)
            now = time.time_ns()  # finer than the kernel's ticks, within which several small stages may end
            os.utime(folder, ns=(now, now))
            check_room(self.folder)
            yield folder
            if is_finished(folder):
                return
            check_room(self.folder)  # libraries that ignore what the disk answers left torn files
            flush(folder)
            write_whole(folder / _DONE_FILE, json.dumps({"stage": name}) + "\n")
        self._forget_older(name, folder)

    def _forget_older(self, name: str, newest: Path) -> None:
        others = [path for path in self.folder.glob(f"{name}-*") if path.is_dir() and path != newest]
        others.sort(key=lambda path: path.stat().st_mtime_ns, reverse=True)
        for path in others[KEPT - 1 :]:
            (path / _DONE_FILE).unlink(missing_ok=True)  # first: half a result must not pass for a whole one
            shutil.rmtree(path)


def is_finished(folder: Path) -> bool:
    """Return whether the stage that a folder of a store belongs to was finished."""
    return (folder / _DONE_FILE).is_file()


@contextlib.contextmanager
def locked(folder: Path, *, waits: bool = False) -> Iterator[None]:
    """Hold a folder (made when absent) for this process alone; the lock ends with the process, however that ends.

    Args:
        folder: To be held.
        waits: Until another process that holds it lets go.

    Raises:
        InputError: another process holds it.
        ResourceError: there is no right to write there.
    """
    path = folder / LOCK_FILE
    while True:
        with _opened(path) as stream:
            with contextlib.ExitStack() as stack:
                try:
                    stack.enter_context(exclusive(stream, waits=waits))
                except BlockingIOError as error:
                    raise InputError(
                        f"Another process is at work in {folder}{_holder(path)}. Wait until it has ended, or name "
                        "another folder with -o."
                    ) from error
                if holds_path(stream, path):
                    _sign(stream)
                    yield
                    return


def _opened(path: Path) -> IO[bytes]:
    """Open a file to be locked, in a folder that is made when absent."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return path.open("a+b", buffering=0)
    except OSError as error:
        if error.errno not in NO_RIGHT + NO_PLACE:
            raise
        cause = "Its owner may be another user, or its disk mounted to be read only."
        if error.errno in NO_PLACE:
            cause = "A file lies where a folder must, or no folder can be made there."
        raise (ResourceError if error.errno in NO_RIGHT else InputError)(
            f"{path.parent} cannot be written to: {error.strerror}. {cause} Name another folder: with -o, or, where "
            "that is the cache, with the variable AQUANAV_CACHE."
        ) from error


def holds_path(stream: IO[Any], path: Path) -> bool:
    """Return whether an open file still is the one at a path: who waits for a lock may get it on a deleted file."""
    try:
        return os.path.samestat(os.fstat(stream.fileno()), path.stat())
    except FileNotFoundError:
        return False


def _sign(stream: IO[bytes]) -> None:
    """Write down who holds a lock."""
    since = time.strftime("%Y-%m-%d %H:%M:%S")
    with contextlib.suppress(OSError):  # on a full disk nobody learns who holds it, and it holds none the less
        stream.truncate(0)
        stream.write(f"process {os.getpid()} on {platform.node()} since {since}".encode())


def _holder(path: Path) -> str:
    told = path.read_text(encoding="utf-8", errors="replace")
    return f": {told}" if told else ""


def check_room(folder: Path) -> None:
    """Check that the disk under a folder has MIN_FREE bytes left.

    Raises:
        ResourceError: it has less.
    """
    if free_bytes(folder) < MIN_FREE:
        raise full_disk(folder)


def watched(stages: Stages, folder: Path) -> Stages:
    """Return the same display of stages; it looks at the room on the disk whenever progress is made."""

    @contextlib.contextmanager
    def stage(title: str) -> Iterator[Progress]:
        with stages(title) as progress:

            def looking(done: int, total: int) -> None:
                check_room(folder)
                progress(done, total)

            yield looking

    return stage


@contextlib.contextmanager
def told_when_full(folder: Path) -> Iterator[None]:
    """Turn what libraries say about a full disk into a sentence.

    Raises:
        ResourceError: the body failed, and the disk under the folder, or the one it names, is full.
    """
    try:
        yield
    except AquanavError:
        raise
    except Exception as error:
        is_told = isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT)
        if not is_told and free_bytes(folder) >= MIN_FREE:
            raise
        path = Path(error.filename) if isinstance(error, OSError) and error.filename else folder
        raise full_disk(path) from error


def full_disk(path: Path) -> ResourceError:
    """Return the error that tells of a full disk."""
    return ResourceError(
        f"The disk under {path} is full: {free_bytes(path) / 1e6:.0f} MB are free, and {MIN_FREE / 1e6:.0f} MB must "
        "stay so. Make room there (of a build, the folder work may go too: that costs time only) and run the same "
        "command again: it goes on where it stopped."
    )


def copied(source: Path, target: Path) -> Path:
    """Return a file after copying it from a source, unless it is there; it is there as a whole or not at all."""
    if not target.exists():
        partial = target.with_name(f"{target.name}.partial")
        shutil.copyfile(source, partial)
        os.replace(partial, target)
    return target


def free_bytes(path: Path) -> int:
    """Return the free bytes on the disk under a path, which need not exist."""
    return shutil.disk_usage(next(place for place in (path, *path.resolve().parents) if place.is_dir())).free


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file so that it is there as a whole or not at all, even when the machine loses power."""
    partial = path.with_name(f"{path.name}.partial")
    with partial.open("wb") as stream:
        stream.write(content.encode() if isinstance(content, str) else content)
        stream.flush()
        os.fsync(stream.fileno())
    os.replace(partial, path)
    sync(path.parent)


def flush(folder: Path) -> None:
    """Bring all that is in a folder onto the disk: after a power cut it must be whole."""
    for place, _, names in os.walk(folder):
        for name in names:
            path = Path(place) / name
            if not path.is_symlink():
                sync(path)
        sync(Path(place))
