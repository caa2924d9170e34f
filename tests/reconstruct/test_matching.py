"""All keypoints are compared where the coarse ones show something in common, and where groups would stay apart."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from aquanav_tools.reconstruct import matching
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.matching import MatchOptions, match_features, verified_matches

NUM_COARSE, NUM_FINE = 60, 120
IN_ROUNDS = MatchOptions(exhaustive_up_to=0, overlap=1, alike=3)
"""Few photos too are not compared completely."""


def unlike(rng: np.random.Generator, count: int) -> np.ndarray:
    """Return descriptors that resemble no others."""
    rows = rng.gamma(0.3, size=(count, 128))
    return np.minimum(np.round(512.0 * rows / np.linalg.norm(rows, axis=1, keepdims=True)), 255.0).astype(np.uint8)


def write_wall(database: Path, seen: list[list[tuple[int, int]]], rng: np.random.Generator) -> Any:
    """Write photos of a flat wall, each of which shows ranges of its points; the rest is in no other photo.

    The even points are coarse, the odd ones fine.
    """
    pycolmap = load_pycolmap()
    wall, places = unlike(rng, 1000), rng.uniform(0.0, 900.0, (1000, 2))
    names = [f"{number}.jpg" for number in range(len(seen))]
    with pycolmap.Database.open(database) as store:
        camera_id = store.write_camera(pycolmap.Camera.create_from_model_name(0, "SIMPLE_RADIAL", 900.0, 1000, 1000))
        for number, (name, ranges) in enumerate(zip(names, seen, strict=True)):
            shown = np.concatenate([np.arange(*one, 2) for one in ranges])
            is_coarse = shown % 2 == 0
            spare = [NUM_COARSE - is_coarse.sum(), NUM_FINE - (~is_coarse).sum()]
            sizes = np.concatenate((np.where(is_coarse, 9.0, 2.0), np.repeat((9.0, 2.0), spare)))
            at = np.concatenate((places[shown] + 30.0 * number, rng.uniform(0.0, 900.0, (sum(spare), 2))))
            keypoints = np.column_stack((at, sizes, np.zeros((len(at), 2)), sizes)).astype(np.float32)
            image_id = store.write_image(pycolmap.Image(name=name, camera_id=camera_id))
            store.write_keypoints(image_id, keypoints)
            descriptors = np.concatenate((wall[shown], unlike(rng, sum(spare))))
            store.write_descriptors(
                image_id, pycolmap.FeatureDescriptors(pycolmap.FeatureExtractorType.SIFT, descriptors)
            )
    return SimpleNamespace(photos=[SimpleNamespace(file=name) for name in names])


def matched(database: Path, photos: Any) -> np.ndarray:
    match_features(photos, database, IN_ROUNDS)
    return verified_matches(database, [photo.file for photo in photos.photos])


def test_photos_with_no_coarse_keypoint_in_common_are_set_aside(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(matching, "_NUM_COARSE", NUM_COARSE)
    seen = [[(0, 50), (1, 61)], [(0, 50), (1, 61), (100, 150), (101, 161)], [(100, 150), (101, 161)]]
    photos = write_wall(tmp_path / "a.db", seen, rng)
    found = matched(tmp_path / "a.db", photos)
    np.testing.assert_array_equal(found > 0, [[0, 1, 0], [1, 0, 1], [0, 1, 0]])
    assert found[0, 1] > 40  # of the 55 points that both show
    with load_pycolmap().Database.open(tmp_path / "a.db") as store:
        assert store.exists_matches(1, 2) and store.exists_matches(2, 3)
        assert not store.exists_matches(1, 3)


def test_groups_tied_by_fine_keypoints_alone_are_found_to_hang_together(
    tmp_path: Path, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(matching, "_NUM_COARSE", NUM_COARSE)
    photos = write_wall(tmp_path / "a.db", [[(0, 50), (201, 261)], [(0, 50)], [(100, 150), (201, 261)]], rng)
    found = matched(tmp_path / "a.db", photos)
    assert found[0, 2] > 20  # of the 30 fine points that both show
