"""Curves for TensorBoard: scalars in an event file, through tensorboardX, which needs no TensorBoard."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from tensorboardX.proto.event_pb2 import Event

FILE = "events.out.tfevents.0.aquanav"
"""TensorBoard reads every file of such a name."""


class EventFile:
    """Appends scalars to an event file, which TensorBoard can follow while it grows."""

    def __init__(self, folder: Path) -> None:
        """Begin an empty file in a folder, made when absent."""
        from tensorboardX.proto.event_pb2 import Event
        from tensorboardX.record_writer import RecordWriter

        folder.mkdir(parents=True, exist_ok=True)
        self._writer = RecordWriter(str(folder / FILE))  # of one name, so that a resumed run begins it anew
        self._write(Event(wall_time=0.0, file_version="brain.Event:2"))

    def add(self, step: int, seconds: float, scalars: dict[str, float]) -> None:
        """Append numbers, by their tags, for one step; `seconds` is the time that TensorBoard shows."""
        from tensorboardX.proto.event_pb2 import Event
        from tensorboardX.proto.summary_pb2 import Summary

        values = [Summary.Value(tag=tag, simple_value=value) for tag, value in scalars.items()]
        self._write(Event(wall_time=seconds, step=step, summary=Summary(value=values)))

    def _write(self, event: Event) -> None:
        self._writer.write(event.SerializeToString())
        self._writer.flush()

    def close(self) -> None:
        """Close the file, which is complete already."""
        self._writer.close()
