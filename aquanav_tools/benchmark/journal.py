"""The journal of a benchmark's run: a line for each cave as it is done, so that a stopped run can go on."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from aquanav_tools.evaluate.journal import check_identity, json_line, whole_lines

JOURNAL = "caves.jsonl"


class CaveJournal:
    """Finished caves on disk, in the order in which they were done."""

    def __init__(self, folder: Path, identity: dict[str, Any], *, is_resumed: bool) -> None:
        """Open the journal in an output folder; with `is_resumed` keep what is there.

        Raises:
            InputError: what is there is of another run.
        """
        self._path = folder / JOURNAL
        self._rows: dict[int, dict[str, Any]] = {}
        identity = json.loads(json.dumps(identity))
        lines = list(whole_lines(self._path)) if is_resumed else []
        if lines:
            check_identity(json.loads(lines[0]), identity, folder)
        partial = self._path.with_name(self._path.name + ".partial")
        partial.write_bytes(b"".join([json_line(identity) + b"\n", *lines[1:]]))
        os.replace(partial, self._path)
        for line in lines[1:]:
            self._keep(json.loads(line))

    def __len__(self) -> int:
        return len(self._rows)

    def __contains__(self, number: int) -> bool:
        return number in self._rows

    def add(self, row: dict[str, Any]) -> None:
        """Keep what a worker returned of a cave."""
        with self._path.open("ab", buffering=0) as stream:
            stream.write(json_line(row) + b"\n")
        self._keep(row)

    @property
    def rows(self) -> list[dict[str, Any]]:
        """What is known of each cave, in the benchmark's order."""
        return [self._rows[number] for number in sorted(self._rows)]

    def _keep(self, row: dict[str, Any]) -> None:
        self._rows[row["number"]] = row
