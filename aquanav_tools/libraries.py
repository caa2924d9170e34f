"""Importing libraries that need help to import."""

from __future__ import annotations

import ctypes
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
