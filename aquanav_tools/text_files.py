"""Reading text files (TOML, JSON, CSV and others) that anybody may have written: bounded, and UTF-8 or refused."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from aquanav_tools.errors import AquanavError, InputError

MAX_BYTES = 1 << 30
"""Bound on a text file where its reader names none: a million episodes, ten times the largest cave built."""
NOT_A_TABLE = (KeyError, IndexError, TypeError, ValueError, OverflowError)
"""What a table of another form raises where its values are taken: int(inf) and float(10**400) overflow."""


def read_text(
    path: Path, error: type[AquanavError] = InputError, max_bytes: int = MAX_BYTES, encoding: str = "utf-8"
) -> str:
    """Return the text of a file.

    Args:
        path: Of the file.
        error: Class to raise.
        max_bytes: Larger files are refused before they are read.
        encoding: "utf-8", or "utf-8-sig" where a byte order mark may stand before the text.

    Raises:
        error: the file is missing, cannot be opened, is too large, or is not UTF-8; the message names the first byte
            that is not, and its line.
    """
    try:
        size = path.stat().st_size
        if size > max_bytes:
            raise error(f"{path} has {size:,} bytes; such a file has at most {max_bytes:,}. Check the path.")
        content = path.read_bytes()
    except OSError as cause:
        raise error(f"{path} cannot be read: {cause.strerror}. Check the path.") from cause
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as cause:
        line = content.count(b"\n", 0, cause.start) + 1
        raise _not_utf8(path, cause.start, line, content[cause.start], error) from cause


def check_utf8(path: Path, error: type[AquanavError] = InputError) -> None:
    """Check a text of any size, line by line.

    Raises:
        error: it is not UTF-8; the message names the first byte that is not, and its line.
    """
    begins = 0
    with path.open("rb") as stream:
        for number, line in enumerate(stream, 1):
            try:
                line.decode("utf-8")
            except UnicodeDecodeError as cause:
                raise _not_utf8(path, begins + cause.start, number, line[cause.start], error) from cause
            begins += len(line)


def _not_utf8(path: Path, at: int, line: int, value: int, error: type[AquanavError]) -> AquanavError:
    return error(
        f"{path} is not text in UTF-8: byte {at:,} (line {line:,}) is 0x{value:02x}. It was damaged, or saved in "
        "another encoding. Save it again as UTF-8."
    )


def read_json(path: Path, error: type[AquanavError] = InputError, max_bytes: int = MAX_BYTES) -> Any:
    """Return what a JSON file holds.

    Raises:
        error: as `read_text`; or it is not JSON, and the message names the place.
    """
    text = read_text(path, error, max_bytes)
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as cause:  # a number of 5000 digits is a ValueError of its own
        raise error(f"{path} is not valid JSON: {cause}. It was damaged or cut off. Make it again.") from cause
