"""Loading pycolmap. Only SIFT is ever asked of it: its learned features abort the process (no ONNX in the wheel)."""

from __future__ import annotations

from typing import Any


def load_pycolmap() -> Any:
    """Return the pycolmap module with its progress log switched off; errors still reach stderr."""
    import numpy  # noqa: F401 - where pycolmap comes before numpy, Pillow aborts the process when it writes a PNG
    import pycolmap

    pycolmap.logging.minloglevel = int(pycolmap.logging.ERROR)
    return pycolmap
