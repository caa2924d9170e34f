from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.cave.guide import Guide
from tests.caves import tube_guide


def swim(guide: Guide, points: np.ndarray) -> list[float]:
    gate = guide.locate(points[0])
    progress = []
    for point in points:
        gate = guide.track(point, gate)
        progress.append(guide.progress(point, gate))
    return progress


def test_progress_in_a_straight_tube_is_the_distance_along_it() -> None:
    points = np.stack([np.linspace(1, 19, 200), np.full(200, 0.7), np.full(200, -0.4)], axis=1)
    assert np.allclose(swim(tube_guide(), points), points[:, 0] - 1.0)


def test_progress_does_not_jump_at_panels_away_from_their_centres() -> None:
    points = np.stack([np.linspace(1, 19, 2000), np.full(2000, 1.5), np.zeros(2000)], axis=1)
    steps = np.diff(swim(tube_guide(), points))
    assert np.allclose(steps, 18.0 / 1999)


def test_swimming_back_takes_back_all_progress() -> None:
    there = np.stack([np.linspace(2, 17, 300)] + [np.zeros(300)] * 2, axis=1)
    progress = swim(tube_guide(), np.concatenate([there, there[::-1]]))
    assert progress[-1] == pytest.approx(progress[0])


def test_progress_is_zero_before_the_first_panel_and_full_after_the_last() -> None:
    guide = tube_guide()
    assert guide.progress(np.array([0.2, 0.0, 0.0]), 0) == 0.0
    assert guide.remaining(np.array([19.9, 0.0, 0.0]), guide.num_gates - 1) == 0.0


def test_a_start_is_located_in_the_gate_around_it() -> None:
    guide = tube_guide()
    for gate in range(guide.num_gates):
        middle = 0.5 * (guide.centres[gate] + guide.centres[gate + 1])
        assert guide.locate(middle + [0.0, 0.8, 0.0]) == gate


def test_a_guide_of_one_panel_is_refused() -> None:
    guide = tube_guide()
    with pytest.raises(ValueError, match="at least 2 panels"):
        Guide(guide.centreline, guide.panels[:1])
