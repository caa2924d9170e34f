"""Putting a new scenario in the place of an old one: whenever a process is killed, one of the two is whole.

The new files are written into the folder .new inside of the scenario's own, which needs no other disk and no rights
beside it. Renaming that to .ready is the moment from which the new files count; until then the old ones are untouched.
The files are then moved into place, and whoever next opens a folder with .ready in it finishes that.
"""

from __future__ import annotations

import contextlib
import json
import os
import shutil
from pathlib import Path
from typing import Any

from aquanav_tools.machine import exclusive, sync
from aquanav_tools.scenario.shipped import SETTINGS_FILE
from aquanav_tools.store import LOCK_FILE, flush, holds_path

STAGED_DIR = ".new"
"""Where a build writes; whatever lies there may be deleted."""
READY_DIR = ".ready"
"""Complete files that wait to be moved into place."""
FAILED_DIR = "failed"
"""What is known of a build that failed where a scenario was to be replaced."""
RECORD_FILE = "build.json"
"""Lists the files of a build under "outputs"."""


def replace_content(folder: Path) -> None:
    """Put the files in `folder`/.new in the place of what an earlier build left; other files in the folder stay.

    The new build.json must list all new files under "outputs".
    """
    flush(folder / STAGED_DIR)  # after a power cut .ready must be whole
    os.replace(folder / STAGED_DIR, folder / READY_DIR)
    sync(folder)
    finish_replacing(folder)


def finish_replacing(folder: Path) -> None:
    """Finish what a process began that was killed while it moved files into place; mostly there is nothing to do.

    Raises:
        OSError: the folder cannot be written to.
    """
    ready = folder / READY_DIR
    while ready.is_dir():
        try:
            stream = (ready / LOCK_FILE).open("a")
        except FileNotFoundError:  # another process has just finished
            continue
        with stream, exclusive(stream, waits=True):
            if holds_path(stream, ready / LOCK_FILE):
                _move_all(ready, folder)
                (ready / LOCK_FILE).unlink()
                ready.rmdir()


def _move_all(ready: Path, folder: Path) -> None:
    """Move everything into place. Each step may be repeated: a killed process may have done any number of them."""
    old = read_record(folder)
    for name in _outputs(old) - _outputs(read_record(ready) or old):
        (folder / name).unlink(missing_ok=True)
        for place in (folder / name).relative_to(folder).parents:
            if place.parts:
                with contextlib.suppress(OSError):  # it holds something, or is gone
                    (folder / place).rmdir()
    shutil.rmtree(folder / FAILED_DIR, ignore_errors=True)
    # The record goes first, since it says which files are ours; what makes the folder a scenario goes last.
    order = {RECORD_FILE: 0, SETTINGS_FILE: 2}
    for path in sorted(ready.iterdir(), key=lambda path: (order.get(path.name, 1), path.name)):
        if path.name == LOCK_FILE:
            continue
        if path.is_dir() and (folder / path.name).exists():
            shutil.rmtree(folder / path.name)
        os.replace(path, folder / path.name)


def _outputs(record: dict[str, Any]) -> set[str]:
    """Return the files that a record lists; none outside of its folder, whatever was written into it."""
    listed = record.get("outputs")
    names = listed if isinstance(listed, dict) else {}
    return {name for name in names if not Path(name).is_absolute() and ".." not in Path(name).parts}


def read_record(folder: Path) -> dict[str, Any]:
    """Return build.json of a folder; nothing where it is absent or not ours."""
    try:
        record = json.loads((folder / RECORD_FILE).read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return record if isinstance(record, dict) else {}
