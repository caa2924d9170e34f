"""A recording's file: it appears under its name only when complete, and a repeated run replaces it in the viewer."""

from __future__ import annotations

import os
import tempfile
import uuid
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from aquanav_tools.libraries import lack_of, require

APPLICATION = "aquanav"
NO_RECORDING = "no-recording"
"""Code of the warning where something else than a recording is asked for, and goes without."""
RECORDER = "A recording (.rrd)", "rerun"


def require_recorder() -> None:
    """Check that recordings can be written, before work whose end is one.

    Raises:
        LibraryError: rerun is not installed, or does not load.
    """
    require(*RECORDER)


def lack_of_recorder() -> str:
    """Return why there can be no recording; empty where there can."""
    return lack_of(*RECORDER)


@contextmanager
def recording(path: Path, identity: str, blueprint: Any) -> Iterator[Any]:
    """Open a stream into a file; the recording's id follows from `identity`."""
    require_recorder()
    import rerun as rr

    recording_id = uuid.uuid5(uuid.NAMESPACE_OID, identity)
    stream = rr.RecordingStream(APPLICATION, recording_id=recording_id, send_properties=False)
    partial = path.with_name(path.name + ".partial")
    stream.save(partial, default_blueprint=blueprint)
    try:
        yield stream
    finally:
        stream.disconnect()
    os.replace(partial, path)


class Template:
    """What many recordings have in common, made once: chunks to send into each, and a layout."""

    def __init__(self, fill: Callable[[Any], None], blueprint: Any) -> None:
        """Keep what `fill` logs to a stream."""
        require_recorder()
        from rerun.chunk import RrdReader

        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "template.rrd"
            with recording(path, "template", blueprint) as stream:
                fill(stream)
            reader = RrdReader(path)
            (data,), (layout,) = reader.recordings(), reader.blueprints()
            self._chunks = reader.stream(store=data).to_chunks()
            self.layout = _KeptLayout(reader.stream(store=layout).to_chunks())

    def send(self, stream: Any) -> None:
        """Send what was kept, except the layout, with which a recording is opened."""
        stream.send_chunks(self._chunks)


def kept_layout(blueprint: Any) -> Any:
    """Return a layout to open many recordings with, made once."""
    return Template(lambda stream: stream.send_recording_name("layout"), blueprint).layout


class _KeptLayout:
    """Stands for a blueprint: building one takes longer than the rest of a short recording."""

    def __init__(self, chunks: list[Any]) -> None:
        self._chunks = chunks

    def to_blueprint(self) -> _KeptLayout:
        """Return itself, as rerun asks of what it takes for a blueprint."""
        return self

    def _log_to_stream(self, stream: Any) -> None:
        stream.send_chunks(self._chunks)
