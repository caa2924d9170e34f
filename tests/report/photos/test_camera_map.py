"""Plan and long section with the cameras."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.ndimage import center_of_mass, label

from aquanav_tools.report.cave_map import CaveMap
from aquanav_tools.report.labels import Labels
from aquanav_tools.report.photos import camera_map
from aquanav_tools.report.photos.camera_map import PhotoTrail, draw_camera_cloud, draw_camera_map, wedges_of
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import Array, PointCloud
from tests.caves import TUBE_LENGTH, TUBE_RADIUS

DPI = 100
PIXELS_PER_METRE = DPI * (11.0 - 2 * 0.7) / TUBE_LENGTH


@pytest.fixture(scope="module")
def cave(tube: Scenario) -> CaveMap:
    return CaveMap("tube", tube.cavity, tube.guide.centreline, ())


def trail(position: tuple[float, float, float], ahead: tuple[float, float, float]) -> PhotoTrail:
    return PhotoTrail(("a.jpg",), np.array([1]), np.array([position]), np.array([ahead]))


def drawn(cave: CaveMap, one: PhotoTrail, path: Path, monkeypatch: pytest.MonkeyPatch) -> Array:
    monkeypatch.setattr(camera_map, "DPI", DPI)
    monkeypatch.setattr(Labels, "add", lambda *args, **kwargs: True)
    draw_camera_map(cave, one, (), path)
    return np.asarray(Image.open(path.with_suffix(".png")).convert("L"), float)


def test_a_camera_stands_in_the_plan_where_it_was_to_a_pixel(
    cave: CaveMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    down, places = (0.0, 0.0, -1.0), ((4.0, 1.2, 0.0), (15.5, -0.7, 0.3))  # looking down, a camera is a dot
    pictures = [drawn(cave, trail(place, down), tmp_path / "map.svg", monkeypatch) for place in places]
    upper = slice(0, pictures[0].shape[0] // 2)
    spots, count = label(np.abs(pictures[0] - pictures[1])[upper] > 20.0)
    assert count == 2
    (row_a, column_a), (row_b, column_b) = sorted(center_of_mass(spots > 0, spots, [1, 2]), key=lambda spot: spot[1])
    assert column_a == pytest.approx(DPI * 0.7 + PIXELS_PER_METRE * places[0][0], abs=1.0)
    assert column_b == pytest.approx(DPI * 0.7 + PIXELS_PER_METRE * places[1][0], abs=1.0)
    wall = np.flatnonzero(pictures[0][upper, int(DPI * 0.7 + PIXELS_PER_METRE * 10.0)] < 100.0)
    middle = 0.5 * (wall[0] + wall[-1])
    assert wall[-1] - wall[0] == pytest.approx(2 * TUBE_RADIUS * PIXELS_PER_METRE, abs=3.0)  # two lines of ink
    assert row_a == pytest.approx(middle - PIXELS_PER_METRE * places[0][1], abs=1.0)
    assert row_b == pytest.approx(middle - PIXELS_PER_METRE * places[1][1], abs=1.0)


def test_a_view_along_the_route_points_right_in_both_drawings(
    cave: CaveMap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ahead = drawn(cave, trail((10.0, 0.0, 0.0), (1.0, 0.0, 0.0)), tmp_path / "a.svg", monkeypatch)
    back = drawn(cave, trail((10.0, 0.0, 0.0), (-1.0, 0.0, 0.0)), tmp_path / "b.svg", monkeypatch)
    half = ahead.shape[0] // 2
    for part in (slice(0, half), slice(half, None)):
        columns = np.flatnonzero((ahead - back)[part].min(axis=0) < -40.0)  # darker where the wedge ahead is
        assert columns.min() > DPI * 0.7 + PIXELS_PER_METRE * (9.0 if part.start else 10.0) - 3.0
        assert np.ptp(columns) == pytest.approx(DPI * camera_map.WEDGE_IN, abs=5.0)


def test_wedges_open_along_the_view() -> None:
    (corners,) = wedges_of(np.array([[2.0, 3.0]]), np.array([[0.0, 1.0]]), 2.0)
    np.testing.assert_allclose(corners[0], [2.0, 3.0])
    np.testing.assert_allclose(corners[1:].mean(axis=0), [2.0, 5.0])


def test_photos_that_did_not_register_are_shown_between_their_neighbours() -> None:
    positions = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [4.0, 0.0, 2.0]])
    missing = ((3, "c"), (4, "d"), (7, "g"))
    gaps = PhotoTrail(("a", "b", "e"), np.array([1, 2, 6]), positions, positions, missing).gaps()
    assert [text for _, text in gaps] == ["3 to 4", "7"]
    np.testing.assert_allclose(gaps[0][0], [2.5, 0.0, 1.0])
    np.testing.assert_allclose(gaps[1][0], positions[2])


def test_without_a_cave_cameras_stand_before_the_points(tmp_path: Path, rng: np.random.Generator) -> None:
    positions = np.stack([np.arange(5.0), np.zeros(5), np.zeros(5)], axis=1)
    ahead = np.tile([0.0, 1.0, 0.0], (5, 1))
    cloud = PointCloud(rng.uniform(0.0, 5.0, (1000, 3)))
    one = PhotoTrail(tuple("abcde"), np.arange(1, 6), positions, ahead, ((6, "f"),))
    draw_camera_cloud("facade", cloud, one, tmp_path / "cameras.svg")
    assert (tmp_path / "cameras.svg").stat().st_size > 5000
