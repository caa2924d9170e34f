"""The caves that ship, as parameters of slow tests."""

from __future__ import annotations

from typing import Any

import pytest

from aquanav_tools.scenario.shipped import CONTENT
from aquanav_tools.shipped import shipped_names

FIRST = "cave-test-1"
"""Its tests run in `.ci/run`. Those of the others are nightly: each cave is built first, a minute on a free core."""


def shipped_caves() -> list[Any]:
    """Return a parameter for each cave's name."""
    names = shipped_names(CONTENT)
    assert FIRST in names
    return [pytest.param(name, marks=[pytest.mark.slow, *[pytest.mark.nightly] * (name != FIRST)]) for name in names]
