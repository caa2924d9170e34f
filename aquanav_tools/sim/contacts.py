"""Who solves contacts with a cave's walls: PyBullet, the reference, or our own solver, which is held to the same.

PyBullet has no wheels for Python 3.12 and newer, so it may be missing. What takes its place is decided here alone. The
contacts of boats are always our own.
"""

from __future__ import annotations

import importlib.util
from typing import TYPE_CHECKING, Literal

from aquanav_tools.libraries import require, stderr_silenced

if TYPE_CHECKING:
    from aquanav_tools.sim.bullet import BulletContacts

Contacts = Literal["own", "bullet"]
"""Solvers of contacts."""
Backend = Literal["pybullet", "own", "batch"]
"""What runs episodes: one by one with PyBullet's contacts or with our own, or side by side with our own."""
INSTALL = "pip install 'aquanav[bullet]'"
OTHERWISE = (
    " (compiled from source on Python 3.12 and newer: 20 minutes, with a C++ compiler), or take our own contacts: "
    "contacts='own', --backend own"
)


def default_contacts() -> Contacts:
    """Return "bullet" where PyBullet is installed, else "own"."""
    return "own" if importlib.util.find_spec("pybullet") is None else "bullet"


def default_backend() -> Backend:
    """Return what runs episodes one by one with the default contacts."""
    return "own" if default_contacts() == "own" else "pybullet"


def contacts_of(backend: Backend) -> Contacts:
    """Return who solves the contacts of a backend."""
    return "bullet" if backend == "pybullet" else "own"


def load_bullet() -> type[BulletContacts]:
    """Return PyBullet's contacts.

    Raises:
        LibraryError: it is not installed, or does not load.
    """
    with stderr_silenced():  # it greets
        require("A contact that PyBullet solves", "pybullet", otherwise=OTHERWISE)
    from aquanav_tools.sim.bullet import BulletContacts

    return BulletContacts
