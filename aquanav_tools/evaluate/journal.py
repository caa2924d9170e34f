"""The journal of an evaluation: each episode reaches the disk as it ends, so that a stopped one can go on.

`episodes.jsonl` begins with a line that says what is evaluated, and has a line per finished episode, in the order in
which they ended. What belongs to an episode is written before its line, and a line that was cut off is dropped, so that
a line stands for a whole episode.
"""

from __future__ import annotations

import bisect
import contextlib
import dataclasses
import json
import os
from array import array
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.episode_table import EpisodeTable
from aquanav_tools.evaluate.metrics import EpisodeMetrics
from aquanav_tools.report.trajectory import TrajectorySummary
from aquanav_tools.store import LOCK_FILE, locked

JOURNAL = "episodes.jsonl"
TRAJECTORIES = "trails"
COLUMNS = ("times", "positions", "clearances", "collided", "progress")
NOWHERE = -1


class Journal:
    """Finished episodes on disk, in the order in which they ended."""

    def __init__(self, folder: Path, identity: dict[str, Any], is_resumed: bool) -> None:
        """Open the journal in an output folder.

        Args:
            folder: Of the evaluation.
            identity: What is evaluated and how; a stopped evaluation is only gone on with when it is the same.
            is_resumed: Whether to keep the episodes that are there.

        Raises:
            InputError: the episodes there are of another evaluation.
        """
        self._folder = folder
        self._path = folder / JOURNAL
        self._table = EpisodeTable()
        self._places = array("q")
        """Of each episode in the table; NOWHERE for those to come."""
        self._num = 0
        self._recordings: dict[int, str] = {}
        self._recorded: list[int] = []
        identity = json.loads(json.dumps(identity))
        lines = whole_lines(self._path) if is_resumed else iter(())
        first = next(lines, json_line(identity) + b"\n")
        check_identity(json.loads(first), identity, folder)
        (folder / TRAJECTORIES).mkdir(exist_ok=True)
        for path in (folder / TRAJECTORIES).glob("*.partial"):
            path.unlink()
        partial = self._path.with_name(self._path.name + ".partial")
        with partial.open("wb") as stream:
            stream.write(first)
            for line in lines:
                stream.write(line)
                self._keep(json.loads(line))
        os.replace(partial, self._path)

    def __len__(self) -> int:
        return self._num

    def __contains__(self, index: int) -> bool:
        return index < len(self._places) and self._places[index] != NOWHERE

    def add(self, row: dict[str, Any]) -> None:
        """Keep a finished episode, whose trail and recording are on disk, from its `journal_row`."""
        with self._path.open("ab", buffering=0) as stream:
            stream.write(json_line(row) + b"\n")
        self._keep(row)

    @property
    def episodes(self) -> EpisodeTable:
        """The metrics of the finished episodes, by their numbers in the evaluation."""
        places = np.array(self._places)
        order = places[places != NOWHERE]
        if not np.array_equal(order, np.arange(len(self._table))):
            self._table = self._table.rows(order)
            places[places != NOWHERE] = np.arange(len(order))
            self._places = array("q", places.tobytes())
        return self._table

    def episode(self, index: int) -> EpisodeMetrics:
        """Return the metrics of one finished episode."""
        return self._table[self._places[index]]

    @property
    def recordings(self) -> dict[int, str]:
        """Names of the recordings by episode, in the episodes' order."""
        return {index: self._recordings[index] for index in self._recorded}

    def num_recorded_before(self, index: int) -> int:
        """Return how many finished episodes with a smaller number have a recording."""
        return bisect.bisect_left(self._recorded, index)

    def trajectory(self, index: int) -> TrajectorySummary:
        """Return where a finished episode led, in single precision."""
        metrics = self.episode(index)
        with np.load(_trajectory_path(self._folder, index), allow_pickle=False) as columns:
            return TrajectorySummary(
                seed=metrics.seed,
                start_index=metrics.start,
                outcome=metrics.outcome,
                num_collisions=metrics.collisions,
                **{name: columns[name] for name in COLUMNS},
            )

    def _keep(self, row: dict[str, Any]) -> None:
        metrics = EpisodeMetrics(**row["metrics"])
        index, recording = metrics.index, row["recording"]
        if recording is not None and index not in self._recordings:
            bisect.insort(self._recorded, index)
        if recording is not None:
            self._recordings[index] = recording
        self._num += index not in self
        self._places.extend([NOWHERE] * (index + 1 - len(self._places)))
        self._places[index] = len(self._table)
        self._table.append(metrics)


@contextlib.contextmanager
def held_results(folder: Path) -> Iterator[None]:
    """Hold the folder of an evaluation (made when absent) for this process alone.

    Raises:
        InputError: another process holds it, or it cannot be made or written to.
    """
    with contextlib.ExitStack() as held:
        try:
            held.enter_context(locked(folder))
        except OSError as cause:
            raise InputError(f"Cannot write to the output folder {folder}: {cause}. Choose another with -o.") from cause
        held.callback((folder / LOCK_FILE).unlink, missing_ok=True)
        yield


def journal_row(metrics: EpisodeMetrics, recording: str | None) -> dict[str, Any]:
    """Return what a line of the journal holds."""
    return {"metrics": dataclasses.asdict(metrics), "recording": recording}


def write_trajectory(folder: Path, index: int, trajectory: TrajectorySummary) -> None:
    """Write where an episode led into the folder of its evaluation."""
    path = _trajectory_path(folder, index)
    partial = path.with_name(path.name + ".partial")
    with partial.open("wb") as stream:
        np.savez_compressed(stream, **{name: _small(getattr(trajectory, name)) for name in COLUMNS})
    os.replace(partial, path)


def clear_journal(folder: Path) -> None:
    """Remove a journal and what belongs to its episodes."""
    (folder / JOURNAL).unlink(missing_ok=True)
    for path in (folder / TRAJECTORIES).glob("*.npz*"):
        path.unlink()


def trajectory_name(index: int) -> str:
    """Return where an episode's trail lies in the folder of its evaluation."""
    return f"{TRAJECTORIES}/{index:06d}.npz"


def _trajectory_path(folder: Path, index: int) -> Path:
    return folder / trajectory_name(index)


def whole_lines(path: Path) -> Iterator[bytes]:
    """Yield the lines that were written to their end."""
    if path.is_file():
        with path.open("rb") as stream:
            yield from (line for line in stream if line.endswith(b"\n"))


def check_identity(found: dict[str, Any], wanted: dict[str, Any], folder: Path) -> None:
    """Refuse to go on with what was begun with other options or files than are wanted.

    Raises:
        InputError: they differ; the message says in what.
    """
    different = [_difference_text(key, found.get(key), wanted.get(key)) for key in sorted({*found, *wanted})]
    different = [told for told in different if told]
    if different:
        raise InputError(
            f"The episodes in {folder} are of another evaluation: {', '.join(different)} differ. Go on with the "
            "options and files it was begun with, or leave out --resume to begin anew."
        )


def _difference_text(key: str, found: Any, wanted: Any) -> str:
    """Return the name of a value that differs, of a table with what differs in it; empty where it does not."""
    if found == wanted:
        return ""
    if not isinstance(found, dict) or not isinstance(wanted, dict):
        return key
    parts = sorted(part for part in {*found, *wanted} if found.get(part) != wanted.get(part))
    return f"{key} ({', '.join(parts)})"


def json_line(table: dict[str, Any]) -> bytes:
    """Return a table as the line of a journal, without the line's end."""
    return json.dumps(table, allow_nan=False).encode()


def _small(values: Any) -> Any:
    return values.astype(np.float32) if values.dtype == np.float64 else values


def worst_first(episodes: EpisodeTable) -> list[int]:
    """Return the places of the episodes most worth a look: failures first, then collisions, then least clearance."""
    keys = (episodes.column("min_clearance"), -episodes.column("collisions"), episodes.are("outcome", "success"))
    places: list[int] = np.lexsort(keys).tolist()
    return places
