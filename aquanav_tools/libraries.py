"""Libraries that need not be installed, or need help to import: which extra brings one, said in one sentence."""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import importlib.util
import os
import sys
from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from typing import Any, NamedTuple

from aquanav_tools.errors import LibraryError


class Library(NamedTuple):
    """What to install for a module."""

    package: str
    """As pip calls it."""
    extra: str
    """Of aquanav, in pyproject.toml."""
    entry: str = ""
    """What is loaded instead of a module that is a mere folder (PEP 420)."""


OPTIONAL = {
    "av": Library("av", "films"),
    "cmaes": Library("cmaes", "stress"),
    "collada": Library("pycollada", "formats"),
    "cv2": Library("opencv-python-headless", "photos"),
    "laspy": Library("laspy", "build"),
    "lazrs": Library("lazrs", "build"),
    "libusb_package": Library("libusb-package", "build"),
    "lxml": Library("lxml", "formats"),
    "open3d": Library("open3d", "build"),
    "pi_heif": Library("pi-heif", "heic"),
    "pyarrow": Library("pyarrow", "parquet"),
    "pybullet": Library("pybullet", "bullet"),
    "pycolmap": Library("pycolmap", "photos"),
    "pxr": Library("usd-core", "formats"),
    "pye57": Library("pye57", "formats"),
    "ray": Library("ray", "cluster"),
    "rerun": Library("rerun-sdk", "record"),
    "rosbags": Library("rosbags", "ros", "rosbags.rosbag2"),
    "sb3_contrib": Library("sb3-contrib", "recurrent"),
    "stable_baselines3": Library("stable-baselines3", "train"),
    "tensorboardX": Library("tensorboardx", "train"),
    "torch": Library("torch", "train"),
}
"""Modules that the core does without, by the name they are imported by."""
LEARNING = ("torch", "stable_baselines3", "tensorboardX")
"""What any training needs."""
OURS = ("aquanav", "aquanav_tools")


def require(purpose: str, *modules: str, otherwise: str = "") -> None:
    """Load libraries of `OPTIONAL`, before a plain import of them or before work that needs them all.

    Args:
        purpose: what needs them; begins the sentence where one is missing.
        modules: the names they are imported by.
        otherwise: what else can be done; follows the advice to install it, from the comma on.

    Raises:
        LibraryError: one is not installed, with the extra that brings it; or it is and does not load, with its own
            error.
    """
    for module in modules:
        _load(module, purpose, otherwise)


def _load(module: str, purpose: str, otherwise: str) -> None:
    try:
        entry = OPTIONAL[module].entry if module in OPTIONAL else ""
        library = importlib.import_module(entry or module)
    except ModuleNotFoundError as cause:
        raise _error_of(cause, module, purpose, otherwise) from cause
    except Exception as cause:  # whatever half of a library, or one for another machine, raises
        raise _broken(module, purpose, f"{type(cause).__name__}: {cause}") from cause
    if getattr(library, "__file__", None) is None:  # Python imports any folder of that name
        place = ", ".join(getattr(library, "__path__", []))
        raise _broken(module, purpose, f"there is only a folder of its name, {place}, without the library in it")


def is_installed(module: str) -> bool:
    """Return whether a library is there, without loading it: half of one counts, and is told of when it is loaded."""
    try:
        return importlib.util.find_spec(module) is not None
    except (ImportError, ValueError):  # it is kept from being imported, by a finder or by None in sys.modules
        return False


def installed_version(package: str) -> str:
    """Return the version of a package, by the name that pip has for it, or that it is not installed."""
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed"


def check_installed(purpose: str, *modules: str) -> None:
    """Check that libraries are there that are loaded much later.

    Raises:
        LibraryError: one is not.
    """
    for module in modules:
        if not is_installed(module):
            raise _missing(module, purpose, "")


def lack_of(purpose: str, module: str) -> str:
    """Return the sentence of `require` where the work can do without the library; empty where it loads."""
    try:
        require(purpose, module)
    except LibraryError as error:
        return str(error)
    return ""


@contextlib.contextmanager
def explained_imports(purpose: str) -> Iterator[None]:
    """Turn an import that fails in the body into a sentence.

    Raises:
        LibraryError: a library is missing or does not load; a module of ours that does not is our mistake, and passes.
    """
    try:
        yield
    except ImportError as cause:
        module = (cause.name or "").split(".")[0]
        if module in OURS:
            raise
        raise _error_of(cause, module, purpose, "") from cause


def _error_of(cause: ImportError, module: str, purpose: str, otherwise: str) -> LibraryError:
    """Return what a failed import of a library, or of what it imports itself, comes to."""
    lacking = (cause.name or "").split(".")[0]
    is_missing = isinstance(cause, ModuleNotFoundError) and cause.name == lacking
    if is_missing and (lacking == module or lacking in OPTIONAL):
        return _missing(lacking, purpose, otherwise)
    return _broken(module, purpose, f"{type(cause).__name__}: {cause}")


def _missing(module: str, purpose: str, otherwise: str) -> LibraryError:
    library = OPTIONAL.get(module)
    package, install = (module, "aquanav") if library is None else (library.package, f"'aquanav[{library.extra}]'")
    return LibraryError(
        f"{purpose} needs the library {package}, which is not installed. Install it: pip install {install}{otherwise}."
    )


def _broken(module: str, purpose: str, reason: str) -> LibraryError:
    package = OPTIONAL[module].package if module in OPTIONAL else module or "that is named here"
    return LibraryError(
        f"{purpose} needs the library {package}, which is installed but does not load: {' '.join(reason.split())}. "
        "Likely an installation that broke off, or one for another Python or machine. Install it again: pip install "
        f"--force-reinstall {package if module else 'aquanav'}."
    )


def load_open3d(purpose: str = "This work") -> Any:
    """Return the open3d module on a machine with or without libusb-1.0; errors as in `require`.

    open3d's binary links to libusb-1.0 (for depth cameras we do not use). Loading the copy that the package
    libusb-package ships first makes the dynamic linker take it by its name, so no system package is needed.
    """
    check_installed(purpose, "open3d")
    require(purpose, "libusb_package")
    import libusb_package

    ctypes.CDLL(str(libusb_package.get_library_path()), mode=ctypes.RTLD_GLOBAL)
    require(purpose, "open3d")
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
