"""Tests that are about PyBullet, which is not there on every version of Python."""

from __future__ import annotations

import pytest

from aquanav_tools.sim.contacts import INSTALL, default_contacts

needs_bullet = pytest.mark.skipif(
    default_contacts() != "bullet", reason=f"It is about PyBullet, which is not installed: {INSTALL}."
)
ENGINES = ("own", pytest.param("bullet", marks=needs_bullet))
"""Values of a parameter for tests that hold for either solver of contacts."""
