"""Features and matches that a kill interrupted are completed to what an undisturbed run finds."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from aquanav_tools.reconstruct import features, matching
from aquanav_tools.reconstruct.colmap import load_pycolmap
from aquanav_tools.reconstruct.features import FeatureOptions, extract_features
from aquanav_tools.reconstruct.images import PhotoSet, read_photos
from aquanav_tools.reconstruct.matching import MatchOptions, match_features
from tests.reconstruct.pictures import pan, write


class Killed(BaseException):
    """As a kill, nothing catches it."""


def find_and_match(photos: PhotoSet, database: Path) -> None:
    extract_features(photos, database, FeatureOptions(max_features=200))
    match_features(photos, database, MatchOptions())


def contents(database: Path) -> list[tuple[object, ...]]:
    """Return ids, names, keypoints, and matches of all pairs in a database."""
    with load_pycolmap().Database.open(database) as store:
        images = sorted(store.read_all_images(), key=lambda image: image.image_id)
        ids = [image.image_id for image in images]
        found: list[tuple[object, ...]] = [(image.image_id, image.name, image.camera_id) for image in images]
        found += [(np.asarray(store.read_keypoints(i)).tobytes(),) for i in ids]
        for i, j in itertools.combinations(ids, 2):
            inliers = store.read_two_view_geometry(i, j).inlier_matches
            found.append((i, j, store.read_matches(i, j).tobytes(), inliers.tobytes()))
    return found


def killed_at(module: Any, name: str, call: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let one call of a function do its work and then kill."""
    original, calls = getattr(module, name), itertools.count()

    def work(*arguments: Any, **more: Any) -> Any:
        result = original(*arguments, **more)
        if next(calls) == call:
            raise Killed
        return result

    monkeypatch.setattr(module, name, work)


def test_a_run_killed_after_any_step_finds_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write(tmp_path / "in", {f"p{n}.png": picture for n, picture in enumerate(pan(4, 40, size=(150, 200)))})
    photos = read_photos(tmp_path / "in")
    monkeypatch.setattr(features, "_PHOTOS_AT_ONCE", 2)
    monkeypatch.setattr(matching, "_PAIRS_AT_ONCE", 2)
    find_and_match(photos, tmp_path / "undisturbed" / "a.db")
    expected = contents(tmp_path / "undisturbed" / "a.db")
    database = tmp_path / "killed" / "a.db"
    steps = [(features, "_camera_of_group"), (features, "_enter"), (features, "_write")]
    steps += [(matching, name) for name in ("_write_pairs", "_forget", "_match", "_write_pairs", "_match")]
    for module, name in steps:
        with monkeypatch.context() as patch, pytest.raises(Killed):
            killed_at(module, name, 0, patch)
            find_and_match(photos, database)
    find_and_match(photos, database)
    assert contents(database) == expected
