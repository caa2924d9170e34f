"""The depth buffer against closed forms."""

from __future__ import annotations

import numpy as np

from aquanav_tools.report.raster import NO_FACE, rasterise


def test_neighbours_leave_no_gap_and_cover_no_more_than_their_area() -> None:
    corners = np.array([[2.3, 1.1, 0.0], [40.7, 3.2, 0.0], [37.9, 28.4, 0.0], [1.2, 25.6, 0.0]])
    faces, _ = rasterise(corners[[[0, 1, 2], [0, 2, 3]]], 50, 30)
    x, y = corners[:, 0], corners[:, 1]
    area = 0.5 * abs(x @ np.roll(y, -1) - y @ np.roll(x, -1))
    is_covered = faces != NO_FACE
    assert abs(is_covered.sum() - area) < 12  # the border is 120 pixels long: the root of its number of pixels
    assert all(np.diff(np.flatnonzero(row)).max(initial=1) == 1 for row in is_covered)


def test_the_triangle_in_front_is_shown_whatever_the_order_and_the_turn(rng: np.random.Generator) -> None:
    corners = rng.uniform(0.0, 20.0, (30, 3, 3))
    faces, heights = rasterise(corners, 20, 20)
    mirrored = corners[::-1, ::-1].copy()
    others, same_heights = rasterise(mirrored, 20, 20)
    np.testing.assert_allclose(heights, same_heights, atol=1e-9)
    np.testing.assert_array_equal(faces, np.where(others == NO_FACE, NO_FACE, 29 - others))


def test_heights_are_those_of_the_plane() -> None:
    def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 3.0 + 0.25 * x - 0.5 * y

    flat = np.array([[-10.0, -10.0], [100.0, 0.0], [0.0, 100.0]])
    faces, heights = rasterise(np.column_stack([flat, height(*flat.T)])[None], 16, 12)
    assert (faces == 0).all()
    column, row = np.meshgrid(np.arange(16) + 0.5, np.arange(12) + 0.5)
    np.testing.assert_allclose(heights, height(column, row), atol=1e-9)


def test_what_is_edge_on_or_beside_the_picture_is_not_shown() -> None:
    edge_on = [[1.0, 1.0, 0.0], [5.0, 5.0, 0.0], [3.0, 3.0, 9.0]]
    beside = [[-9.0, 1.0, 0.0], [-1.0, 5.0, 0.0], [-5.0, 9.0, 0.0]]
    faces, heights = rasterise(np.array([edge_on, beside]), 8, 8)
    assert (faces == NO_FACE).all()
    assert np.isneginf(heights).all()
