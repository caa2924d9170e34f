"""Who solves contacts with a cave's walls: PyBullet, the reference, or our own solver, which is held to the same.

PyBullet has wheels for Linux on x86-64 up to Python 3.11 only, so it may be missing. What takes its place is decided
here alone. The contacts of boats are always our own.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from aquanav_tools.libraries import is_installed, require, stderr_silenced

if TYPE_CHECKING:
    from aquanav_tools.sim.bullet import BulletContacts

Contacts = Literal["own", "bullet"]
"""Solvers of contacts."""
Backend = Literal["pybullet", "own", "batch"]
"""What runs episodes: one by one with PyBullet's contacts or with our own, or side by side with our own."""
OTHERWISE = (
    " (but for Linux on x86-64 up to Python 3.11 it is compiled from source: 20 minutes, with a C++ compiler), or take "
    "our own contacts: contacts='own', --backend own"
)
"""Follows the advice to install PyBullet."""


def default_contacts() -> Contacts:
    """Return "bullet" where PyBullet is installed, else "own"."""
    return "bullet" if is_installed("pybullet") else "own"


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
        require("PyBullet's contacts", "pybullet", otherwise=OTHERWISE)
    from aquanav_tools.sim.bullet import BulletContacts

    return BulletContacts
