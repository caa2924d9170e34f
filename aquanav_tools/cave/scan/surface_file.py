"""What a file with a scan holds: its surface, and what it says of units, axes and scanners."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from aquanav_tools.errors import InputError
from aquanav_tools.types import Array, Mesh, PointCloud


@dataclass(frozen=True, eq=False)
class SurfaceFile:
    """A surface in its file's own coordinates."""

    surface: Mesh | PointCloud
    cautions: tuple[tuple[str, str], ...] = ()
    """Codes and sentences about what was changed while reading."""
    metres_per_unit: float | None = None
    """As the file says, or its format's specification; None where neither does."""
    up: str | None = None
    """Axis that points up, likewise: x, y or z, or -x, -y or -z."""


def unit_vectors(vectors: Array) -> Array:
    """Return (N, 3) vectors at unit length; what has no length stays."""
    unit: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)
    return unit


def unreadable(path: Path, why: str) -> InputError:
    """Return the error that a scan is damaged, and why; its ending names its format."""
    return InputError(
        f"{path} cannot be read as {path.suffix[1:].upper()}: {why}. The file is damaged, cut off or of another "
        "format. Copy or export it again."
    )
