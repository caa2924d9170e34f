"""Names of photos: their order, and how they are written where COLMAP cannot take them as they are."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from datetime import datetime
from urllib.parse import unquote

_COPY_MARK = "%."
"""Stands before the suffix that a converted photo gets after its own; escaped names hold no other such pair."""


def natural_key(name: str) -> list[tuple[int, int, str]]:
    """Return a sort key that puts photo2 before photo10."""
    parts = re.findall(r"\d+|\D+", name.lower())
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts]


def file_name(name: str, copied_as: str = "") -> str:
    """Return a name that COLMAP's lists can hold: white space ends a name there, and # a line.

    Args:
        name: of the photo, as its owner knows it.
        copied_as: suffix, without the dot, of the format that a converted photo is written in.
    """
    escaped = re.sub(r"[\s%#]", lambda found: "".join(f"%{byte:02X}" for byte in found.group().encode()), name)
    return f"{escaped}{_COPY_MARK}{copied_as}" if copied_as else escaped


def name_of(file: str) -> str:
    """Return the name that `file_name` was given."""
    return unquote(file.split(_COPY_MARK)[0])


def order(taken: dict[str, datetime | None]) -> list[str]:
    """Return the names in the order the photos were taken.

    Names are in natural order. Photos whose names differ in one counter alone are sorted by time where every one of
    them has it, else a counter that rolled over (9999, then 0001) goes on where it did.

    Args:
        taken: for each name, when the photo was taken.
    """
    names = sorted(taken, key=natural_key)
    ordered: list[str] = []
    for _, group in itertools.groupby(names, key=_before_counter):
        run = list(group)
        times = {name: time for name in run if (time := taken[name]) is not None}
        ordered += sorted(run, key=times.__getitem__) if len(times) == len(run) else _unrolled(run)
    return ordered


def _before_counter(name: str) -> str:
    found = re.fullmatch(r"(.*?)\d+\D*", name.lower())
    return found.group(1) if found else name


def _unrolled(names: Sequence[str]) -> list[str]:
    """Return names in natural order, begun after the widest gap where the counter passed from 9999 to 0000 or 0001."""
    digits = [re.findall(r"\d+", name)[-1] if re.search(r"\d", name) else "" for name in names]
    counts = [int(text) for text in digits if text]
    width = len(digits[0])
    has_rolled = width >= 3 and all(len(text) == width for text in digits) and counts[-1] == 10**width - 1
    if not has_rolled or counts[0] > 1:
        return list(names)
    gaps = [after - before for before, after in itertools.pairwise(counts)]
    start = 1 + gaps.index(max(gaps)) if max(gaps, default=1) > 1 else 0
    return [*names[start:], *names[:start]]
