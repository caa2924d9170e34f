"""The recording of a reconstruction as it grew, read back."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from aquanav_tools.report.recording.cave import CaveModel
from aquanav_tools.report.recording.growth import Growth, PlacedPhoto, record_growth, thumbnail
from aquanav_tools.scenario.schema import Scenario
from aquanav_tools.types import PointCloud
from tests.report.test_recording import rerun

NUM_PHOTOS = 7
MATRIX = np.array([[300.0, 0.0, 320.0], [0.0, 300.0, 240.0], [0.0, 0.0, 1.0]])


@pytest.fixture(scope="module")
def growth(tmp_path_factory: pytest.TempPathFactory) -> Growth:
    rng = np.random.default_rng(0)
    picture = tmp_path_factory.mktemp("photos") / "p.png"
    cv2.imwrite(str(picture), rng.integers(0, 255, (480, 640, 3), dtype=np.uint8))
    photos = tuple(
        PlacedPhoto(f"p{n}.png", np.array([2.0 + n, 0.0, 0.0]), np.eye(3), MATRIX, (640, 480), picture)
        for n in range(NUM_PHOTOS)
    )
    pairs = [(point, photo) for point in range(60) for photo in (point % 6, point % 6 + 1)]
    observations = np.array(pairs)[rng.permutation(len(pairs))]
    cloud = PointCloud(rng.uniform(0.0, 4.0, (500, 3)), None, rng.integers(0, 255, (500, 3), dtype=np.uint8))
    return Growth(
        photos, rng.uniform(0, 4, (60, 3)), rng.integers(0, 255, (60, 3), dtype=np.uint8), observations, cloud
    )


@pytest.fixture(scope="module")
def path(growth: Growth, tube: Scenario, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "reconstruction.rrd"
    record_growth(growth, CaveModel(tube), path)
    return path


def test_a_point_appears_with_the_second_photo_that_sees_it(growth: Growth) -> None:
    np.testing.assert_array_equal(growth.steps, np.arange(60) % 6 + 1)


def test_rerun_accepts_it_and_reads_back_every_camera_in_its_place_in_time(path: Path) -> None:
    assert "verified without error" in rerun("verify", path)
    listing = rerun("print", "-v", path)
    assert {int(n) for n in re.findall(r"/cameras/(\d{4})\b", listing)} == set(range(NUM_PHOTOS))
    assert {int(n) for n in re.findall(r"/sparse/(\d{4})\b", listing)} == set(range(1, NUM_PHOTOS))
    for entity in ("/dense", "/cave", "/newest", "/plots/points", "/log"):
        assert re.search(rf"{entity}\b", listing)


def test_the_cloud_comes_after_the_photos_and_the_cavity_after_the_cloud(path: Path) -> None:
    def first(entity: str) -> int:
        times = re.findall(r"row_\w+ +┆ [\dT:.-]+ +┆ (\d+) +┆", rerun("print", "-vvv", "--entity", entity, path))
        return min(int(time) for time in times)

    assert first("/cameras/0006") <= NUM_PHOTOS < first("/dense") < first("/cave")


def test_thumbnails_keep_the_shape_of_the_photo(growth: Growth) -> None:
    jpeg, shrink = thumbnail(growth.photos[0])
    picture = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape == (120, 160, 3)
    assert shrink == 0.25


def test_a_long_dive_stays_small(growth: Growth, tube: Scenario, tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    photos = tuple(growth.photos[n % NUM_PHOTOS] for n in range(300))
    points = rng.uniform(0, 4, (100_000, 3))
    observations = np.stack([np.repeat(np.arange(100_000), 2), rng.integers(0, 300, 200_000)], axis=1)
    cloud = PointCloud(rng.uniform(0, 4, (1_000_000, 3)), None, rng.integers(0, 255, (1_000_000, 3), dtype=np.uint8))
    many = Growth(photos, points, rng.integers(0, 255, (100_000, 3), dtype=np.uint8), observations, cloud)
    record_growth(many, CaveModel(tube), tmp_path / "long.rrd")
    # Pictures of noise are the largest that there are.
    assert (tmp_path / "long.rrd").stat().st_size < 8_000_000 + 300 * 4_000
