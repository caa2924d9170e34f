"""Loading pycolmap. Only SIFT is ever asked of it: its learned features abort the process (no ONNX in the wheel)."""

from __future__ import annotations

import os
from typing import Any

LOG_LEVEL = "GLOG_minloglevel"
"""Environment variable of COLMAP's logging library: the least level that it writes to stderr."""


def load_pycolmap() -> Any:
    """Return the pycolmap module, its log set to LOG_LEVEL; where nothing sets that, to errors."""
    import numpy  # noqa: F401 - where pycolmap comes before numpy, Pillow aborts the process when it writes a PNG
    import pycolmap

    pycolmap.logging.minloglevel = int(os.environ.get(LOG_LEVEL, int(pycolmap.logging.ERROR)))
    return pycolmap
