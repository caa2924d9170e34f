from __future__ import annotations

import numpy as np
import pytest

from aquanav_tools.geometry.polyline import arc_lengths, length_of, point_at, resample

CORNER = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0], [3.0, 4.0, 0.0]])


def test_lengths_are_those_of_the_legs() -> None:
    assert arc_lengths(CORNER).tolist() == [0.0, 3.0, 7.0]
    assert length_of(CORNER) == pytest.approx(7.0)
    assert length_of(CORNER[:1]) == 0.0


def test_points_lie_so_far_along_the_legs_and_not_beyond_the_ends() -> None:
    found = point_at(CORNER, arc_lengths(CORNER), np.array([-1.0, 1.5, 5.0, 9.0]))
    assert np.allclose(found, [[0, 0, 0], [1.5, 0, 0], [3, 2, 0], [3, 4, 0]])


def test_a_resampled_helix_keeps_ends_and_length_in_equal_steps() -> None:
    """Of radius 2 m and pitch 1 m per radian: a radian is sqrt(5) m long."""
    angles = np.linspace(0.0, 6.0, 4000)
    helix = np.stack([2.0 * np.cos(angles), 2.0 * np.sin(angles), angles], axis=1)
    points = resample(helix, 0.1)
    assert np.allclose(points[[0, -1]], helix[[0, -1]])
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    assert np.allclose(steps, 0.1, rtol=0.01)
    assert length_of(points) == pytest.approx(6.0 * np.sqrt(5.0), rel=1e-3)
