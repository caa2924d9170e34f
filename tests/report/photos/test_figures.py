"""Matrix of matches, histograms, depth maps and bars of stages."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from aquanav_tools.report.figures import BLUE
from aquanav_tools.report.photos.depth_sheet import DepthExample, draw_depths, normal_colours
from aquanav_tools.report.photos.histograms import Misfits, ModelQuality, ScaleSource, bin_counts, draw_quality
from aquanav_tools.report.photos.matches import MATRIX, draw_matches, groups_of
from aquanav_tools.report.stage_bars import draw_stages
from aquanav_tools.types import IntArray


def two_groups() -> IntArray:
    """Matches of nine photos: five in a chain, three all with each other, one with nobody enough."""
    matches = np.zeros((9, 9), np.int64)
    for i, j in ((0, 3), (3, 4), (4, 6), (6, 7)):
        matches[i, j] = matches[j, i] = 150
    for i, j in ((1, 2), (1, 8), (2, 8)):
        matches[i, j] = matches[j, i] = 40
    matches[5, 4] = matches[4, 5] = 12
    return matches


def test_photos_that_hang_together_by_others_are_one_group_the_largest_first() -> None:
    np.testing.assert_array_equal(groups_of(two_groups()), [0, 1, 1, 0, 0, 2, 0, 0, 1])


def test_the_matrix_is_dark_where_photos_match_and_blank_elsewhere(tmp_path: Path) -> None:
    matches = two_groups()
    draw_matches([f"p{n}" for n in range(9)], matches, np.ones(9, bool), tmp_path / "matches.png")
    picture = np.asarray(Image.open(tmp_path / "matches.png").convert("L"), float)
    height, width = picture.shape
    left, below, across, tall = MATRIX
    left, right = left * width, (left + across) * width
    top, bottom = (1.0 - below - tall) * height, (1.0 - below) * height
    rows = (top + (np.arange(9) + 0.5) / 9 * (bottom - top)).astype(int)
    columns = (left + (np.arange(9) + 0.5) / 9 * (right - left)).astype(int)
    shown = picture[np.ix_(rows, columns)]
    np.testing.assert_array_equal(shown < 240, matches > 0)
    assert shown[0, 3] < shown[1, 2] < shown[4, 5]  # the more, the darker


@pytest.mark.parametrize("count", [0, 1, 5000])
def test_histograms_count_every_point_once(count: int, rng: np.random.Generator) -> None:
    values = rng.exponential(1.0, count)
    counts, edges = bin_counts(values)
    assert counts.sum() == count
    if count > 1:
        inside = (values >= edges[3]) & (values < edges[4])
        assert counts[3] == inside.sum()
        assert counts[-1] == (values >= edges[-2]).sum()


def test_the_histograms_are_drawn_with_and_without_scale(tmp_path: Path, rng: np.random.Generator) -> None:
    quality = ModelQuality(
        rng.exponential(0.5, 900), rng.integers(2, 30, 900), rng.uniform(0, 40, 900), rng.uniform(0.3, 0.6, 20),
        np.arange(1, 21),
    )  # fmt: skip
    sources = [ScaleSource("camera positions", 0.0, 0.4, True), ScaleSource("markers", 3.0, 1.0, False)]
    draw_quality(quality, [], [], tmp_path / "plain.svg")
    draw_quality(quality, sources, [Misfits("camera positions", rng.rayleigh(0.02, 20))], tmp_path / "scaled.svg")
    heights = [Image.open(tmp_path / name).height for name in ("plain.png", "scaled.png")]
    assert heights[1] == pytest.approx(1.5 * heights[0], abs=2)


def test_normals_have_the_colours_that_the_key_names() -> None:
    towards, right, up = [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, -1.0, 0.0]
    colours = normal_colours(np.array([[towards, right, up]]))[0]
    np.testing.assert_allclose(colours, [[0.5, 0.5, 1.0], [1.0, 0.5, 0.5], [0.5, 1.0, 0.5]])


def test_examples_of_depth_show_photo_depth_normals_and_confidence(tmp_path: Path) -> None:
    size = (60, 80)
    depth = np.broadcast_to(np.linspace(1.0, 3.0, 80), size)
    normals = np.broadcast_to([0.0, 0.0, -1.0], (*size, 3))
    is_sure = np.broadcast_to(np.arange(80) >= 40, size)
    photo = np.full((*size, 3), (250, 10, 10), np.uint8)
    draw_depths([DepthExample("a.jpg", photo, depth, normals, np.ones(size), is_sure)] * 2, tmp_path / "depths.jpg")
    picture = np.asarray(Image.open(tmp_path / "depths.jpg").convert("RGB"), int)
    height, width, _ = picture.shape
    row = picture[int(0.28 * height)]
    photo_seen, unsure, sure = row[width // 8], row[int(0.51 * width)], row[int(0.72 * width)]
    assert photo_seen[0] > 200 and photo_seen[1] < 60
    assert (unsure > 220).all()
    np.testing.assert_allclose(sure, [127, 127, 255], atol=12)  # JPEG


def test_bars_are_as_long_as_their_stages(tmp_path: Path) -> None:
    seconds = [60.0, 15.0, 30.0]
    draw_stages(["a", "b", "c"], seconds, [100.0, 900.0, 900.0], tmp_path / "stages.svg")
    picture = np.asarray(Image.open(tmp_path / "stages.png").convert("RGB"), int)
    blue = [int(BLUE[n : n + 2], 16) for n in (1, 3, 5)]
    lengths = (np.abs(picture - blue).max(axis=2) < 8).sum(axis=1)
    bars = [int(lengths[rows].max()) for rows in np.array_split(np.flatnonzero(lengths > 20), 3)]
    np.testing.assert_allclose(np.array(bars) / bars[0], np.array(seconds) / 60.0, atol=0.01)
