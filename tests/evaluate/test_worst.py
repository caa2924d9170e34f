"""The worst episodes: which are chosen, and which moments are shown."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from aquanav_tools.errors import InputError
from aquanav_tools.evaluate.options import WorstOptions
from aquanav_tools.evaluate.worst import shown_rows, worst_of
from aquanav_tools.report.trajectory import Trajectory
from tests.evaluate.test_metrics import episode


def test_the_worst_of_each_condition_are_chosen() -> None:
    base = episode()
    clean = replace(base, outcome="success", collisions=0, min_clearance=0.5, condition="easy")
    touched = replace(clean, collisions=3, min_clearance=0.0)
    failed = replace(clean, outcome="timeout")
    rows = [clean, touched, failed, replace(touched, collisions=5), replace(touched, condition="hard")]
    episodes = [replace(row, index=index) for index, row in enumerate(rows)]
    assert worst_of(episodes, 10) == {"easy": [2, 3, 1], "hard": [4]}
    assert worst_of(episodes, 1) == {"easy": [2], "hard": [4]}


@pytest.mark.parametrize(("contact", "expected"), [(50, (30, 50, 65)), (5, (0, 5, 20)), (None, (80, 100, 100))])
def test_the_moments_before_the_first_contact_are_shown(contact: int | None, expected: tuple[int, int, int]) -> None:
    states = 101  # 10 s of decisions of a tenth
    collided = np.zeros(states, dtype=bool)
    if contact is not None:
        collided[contact : contact + 3] = True
    trajectory = object.__new__(Trajectory)
    for name, value in (("times", 0.1 * np.arange(states)), ("collided", collided)):
        object.__setattr__(trajectory, name, value)
    assert shown_rows(trajectory, 2.0) == expected


@pytest.mark.parametrize("changes", [{"worst": 0}, {"seconds": 0.1}, {"seconds": float("inf")}])
def test_senseless_options_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(InputError, match="choose"):
        WorstOptions(Path("out"), **changes)  # type: ignore[arg-type]
