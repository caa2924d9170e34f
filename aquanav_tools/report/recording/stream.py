"""A recording's file: it appears under its name only when complete, and a repeated run replaces it in the viewer."""

from __future__ import annotations

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

APPLICATION = "aquanav"


@contextmanager
def recording(path: Path, identity: str, blueprint: Any) -> Iterator[Any]:
    """Open a stream into a file; the recording's id follows from `identity`."""
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
