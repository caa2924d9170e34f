from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

from aquanav_tools.report.figures import new_figure
from aquanav_tools.report.labels import Labels


@pytest.fixture
def sheet() -> tuple[Any, Any]:
    figure = new_figure(8.0, 4.0)
    axes = figure.add_axes((0.1, 0.1, 0.8, 0.8))
    axes.set_xlim(0.0, 10.0)
    axes.set_ylim(0.0, 5.0)
    return figure, axes


def boxes(figure: Any, axes: Any) -> list[np.ndarray]:
    """Left, bottom, right and top of every text, as matplotlib lays it out."""
    renderer = figure.canvas.get_renderer()
    return [text.get_window_extent(renderer).extents for text in axes.texts if text.get_text()]


def overlap(a: np.ndarray, b: np.ndarray) -> bool:
    return bool((a[:2] < b[2:]).all() and (b[:2] < a[2:]).all())


def test_labels_of_crowded_points_do_not_overlap(sheet: tuple[Any, Any], rng: np.random.Generator) -> None:
    figure, axes = sheet
    labels = Labels(figure, axes)
    points = rng.normal([5.0, 2.5], 0.4, (30, 2))
    written = [labels.add(point, f"place {n}", must=n < 8) for n, point in enumerate(points)]
    assert all(written[:8])
    assert sum(written) < 30  # there is no room for all of them next to their points
    laid_out = boxes(figure, axes)
    assert len(laid_out) == sum(written)
    assert not any(overlap(a, b) for a, b in itertools.combinations(laid_out, 2))


def test_labels_stay_on_the_page_and_off_what_is_to_be_seen(sheet: tuple[Any, Any]) -> None:
    figure, axes = sheet
    labels = Labels(figure, axes)
    points = np.stack([np.linspace(0.0, 10.0, 12), np.zeros(12)], axis=1)
    labels.keep_free(points, 4.0)
    for point in points:
        assert labels.add(point, "a label")
    pixels = axes.transData.transform(points)
    for box in boxes(figure, axes):
        assert (box > 0).all()
        assert (box[2:] < [800, 400]).all()
        assert not ((pixels > box[:2]) & (pixels < box[2:])).all(axis=1).any()


def test_a_label_may_be_kept_off_the_left(sheet: tuple[Any, Any]) -> None:
    figure, axes = sheet
    labels = Labels(figure, axes)
    labels.keep_inside(1.0, 8.0)
    labels.add(np.array([0.0, 2.0]), "Entrance")
    assert boxes(figure, axes)[0][0] >= 100.0  # an inch at 100 dots


def test_a_label_far_from_its_point_has_a_leader(sheet: tuple[Any, Any]) -> None:
    figure, axes = sheet
    labels = Labels(figure, axes)
    for _ in range(40):
        labels.add(np.array([5.0, 2.5]), "here", must=True)
    assert sum(text.get_text() == "" for text in axes.texts) > 0
