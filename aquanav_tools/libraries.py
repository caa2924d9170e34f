"""Importing libraries that need help to import."""

from __future__ import annotations

import contextlib
import ctypes
import os
import sys
from collections.abc import Iterator
from typing import Any


def load_open3d() -> Any:
    """Return the open3d module on a machine with or without libusb-1.0.

    open3d's binary links to libusb-1.0 (for depth cameras we do not use). Loading the copy that the package
    libusb-package ships first makes the dynamic linker take it by its name, so no system package is needed.
    """
    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    import open3d

    open3d.utility.set_verbosity_level(open3d.utility.VerbosityLevel.Error)
    return open3d


@contextlib.contextmanager
def stderr_silenced() -> Iterator[None]:
    """Drop what native code writes to stderr meanwhile, such as PyBullet's greeting at import. Exceptions pass."""
    sys.stderr.flush()
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(kept)
        os.close(nowhere)
